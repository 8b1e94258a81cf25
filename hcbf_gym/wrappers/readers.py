"""A plant's readers at every step: one that raises is one that knows nothing."""

from copy import copy
from typing import Any

import numpy as np

from hcbf_gym.arrays import Info
from hcbf_gym.errors import SafetyWarning, warn_caller
from hcbf_gym.models.plant import Estimate, Plant


class Readers:
    """Reads barriers and state of a plant; what raises is warned of once, and nothing is known.

    Args:
        plant: whose readers they are.
    """

    def __init__(self, plant: Plant):
        self._barriers: Any = plant.barriers
        self._moving, self._state = callable(plant.barriers), plant.state
        self._said: set[str] = set()

    def __call__(self, env: object, observation: object, info: Info) -> tuple[object, Estimate]:
        """Return the barriers and the state as the plant gives them now."""
        barriers: Any = None
        state: Any = None
        name = "barriers"
        try:
            barriers = self._barriers
            if self._moving:
                barriers = barriers(env, observation, info)
            name = "state"
            state = self._state(env, observation, info)
        except Exception as error:  # whatever a user's sensor raises, the robot has to stop
            self._say(name, error)
        return barriers, state if isinstance(state, Estimate) else Estimate(state)

    def _say(self, name: str, error: Exception) -> None:
        """Warn of a reader that raised, once of each."""
        if name not in self._said:
            self._said.add(name)
            warn_caller(
                f"safety filter: the reader of the {name} raised {error!r}; the filter brakes "
                "until that ends",
                SafetyWarning,
            )


def copied(value: Any) -> Any:
    """Return a value with copies of the arrays in it, and of what holds them; the rest as it is."""
    if isinstance(value, dict):
        kept = copy(value)  # of its own kind
        kept.update((name, copied(one)) for name, one in value.items())
        return kept
    if isinstance(value, tuple):
        parts = map(copied, value)
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    if isinstance(value, list):
        return list(map(copied, value))
    if isinstance(value, np.ndarray):
        return value.copy()
    return value.clone() if callable(getattr(value, "clone", None)) else value  # a tensor
