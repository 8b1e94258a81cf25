"""A plant's readers at every step: one that raises is one that knows nothing."""

import warnings
from collections.abc import Callable
from typing import Any

from hcbf_gym.errors import SafetyWarning
from hcbf_gym.models.plant import Estimate, Plant, read


class Readers:
    """Reads barriers and state of a plant; what raises is warned of once, and nothing is known.

    Args:
        plant: whose readers they are.
    """

    def __init__(self, plant: Plant):
        self._plant = plant
        self._said: set[str] = set()

    def __call__(self, env: Any, observation: Any, info: dict[str, Any]) -> tuple[Any, Estimate]:
        """Return the barriers and the state as the plant gives them now."""
        plant = self._plant
        barriers = self._try("barriers", lambda: read(plant.barriers, env, observation, info))
        state = self._try("state", lambda: plant.state(env, observation, info))
        return barriers, state if isinstance(state, Estimate) else Estimate(state)

    def _try(self, name: str, reader: Callable[[], Any]) -> Any:
        try:
            return reader()
        except Exception as error:  # whatever a user's sensor raises, the robot has to stop
            if name not in self._said:
                self._said.add(name)
                warnings.warn(
                    f"safety filter: the reader of the {name} raised {error!r}; the filter brakes "
                    "until that ends",
                    SafetyWarning,
                    stacklevel=5,
                )
            return None
