"""Training of policies with the filter in the loop; needs the extra `rl`."""

from hcbf_gym.training.config import TrainingConfig
from hcbf_gym.training.train import train

__all__ = ["TrainingConfig", "train"]
