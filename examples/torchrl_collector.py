"""TorchRL's collector on a filtered batch, with costs by rank beside the data.

pip install torchrl
"""

import gymnasium as gym
import torch
from torchrl.collectors import Collector
from torchrl.data import Unbounded
from torchrl.envs import GymWrapper, default_info_dict_reader

import hcbf_gym.envs  # noqa: F401 - registers the environments
from hcbf_gym.wrappers import VectorHoldAction, VectorSafetyFilter


def collect(n=64, frames=64 * 64, batches=3, **options):
    """Yield batches of a random policy; TorchRL itself restarts what has ended."""
    robots = gym.make_vec(
        "HCBF-Regions-v0", n, scenario="random", autoreset_mode="Disabled", **options
    )
    robots = VectorHoldAction(VectorSafetyFilter(robots, "lex-cbf-qp"), 5, "Disabled")
    env = GymWrapper(robots)
    shapes = {"cost": (n,), "costs": (n, 3)}  # three ranks
    specs = [Unbounded(shape=shape, dtype=torch.float64) for shape in shapes.values()]
    env.set_info_dict_reader(default_info_dict_reader(list(shapes), spec=specs))
    env.set_seed(0)
    yield from Collector(env, None, frames_per_batch=frames, total_frames=batches * frames)


if __name__ == "__main__":
    for data in collect():
        reward, cost = (float(data["next", name].sum()) for name in ("reward", "cost"))
        print("reward", reward, "cost", cost)
