"""The environments: the reduced-order model alone, and robots in MuJoCo that follow one."""

from typing import TYPE_CHECKING, Any

from hcbf_gym import lazily
from hcbf_gym.errors import require_packages

if TYPE_CHECKING:
    from hcbf_gym.envs.a1_regions import A1RegionsEnv
    from hcbf_gym.envs.regions import RegionsEnv
    from hcbf_gym.envs.regions_vector import RegionsVectorEnv

__all__ = ["A1RegionsEnv", "RegionsEnv", "RegionsVectorEnv"]

_REQUIRED_PACKAGES = {"A1RegionsEnv": ("mujoco", "pinocchio")}
_import_class = lazily.names_of(
    __name__,
    {
        "A1RegionsEnv": "a1_regions",
        "RegionsEnv": "regions",
        "RegionsVectorEnv": "regions_vector",
    },
)


def __getattr__(name: str) -> Any:
    if name in _REQUIRED_PACKAGES:
        require_packages(name, *_REQUIRED_PACKAGES[name])
    return _import_class(name)
