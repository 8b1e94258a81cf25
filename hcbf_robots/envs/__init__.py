"""Environments of robots that accept velocities; they need MuJoCo."""

from hcbf_gym.errors import require_packages

require_packages("WalkerRegionsEnv", "mujoco")

from hcbf_robots.envs.walker_regions import WalkerRegionsEnv  # noqa: E402

__all__ = ["WalkerRegionsEnv"]
