"""The safety filter as a differentiable layer: `layers.torch` and `layers.jax`."""

from hcbf_gym.layers.flat import Filtered

__all__ = ["Filtered"]
