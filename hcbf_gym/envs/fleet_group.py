"""One group of a fleet: environments that are stepped in turn and write down what they report.

What all environments report stands in one record array, a record for each environment. Its layout
is that of the first report: infos become nested fields.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from hcbf_gym.arrays import Info, Mask, Records
from hcbf_gym.errors import InvalidInputError

Maker = Callable[[], gym.Env]


def layout(report: Mapping[str, object], where: str = "") -> np.dtype:
    """Return the record that holds such a report.

    Args:
        report: numbers, arrays of numbers, and such reports.
        where: its name, for the message.

    Raises:
        InvalidInputError: if something else is in it.
    """
    fields = []
    for key, value in report.items():
        name = f"{where}[{key!r}]"
        if isinstance(value, Mapping):
            fields.append((key, layout(value, name)))
            continue
        array = np.asarray(value)
        if array.dtype.kind not in "fiub":
            raise InvalidInputError(
                f"{name}: got {value!r}, expected numbers, arrays of numbers, or dicts of these: "
                "what else an environment reports, Gymnasium's AsyncVectorEnv takes along"
            )
        fields.append((key, array.dtype, array.shape))
    return np.dtype(fields, align=True)


class Group:
    """Some environments of a fleet.

    Args:
        envs: the environments.
        mode: when they start over.
        actions: (n, …) where the fleet writes what they shall do.
        now: (n,) records of what they report.
        last: (n,) of what they reported at an episode's end, where they start over in that step.
    """

    def __init__(
        self,
        envs: Sequence[gym.Env],
        mode: AutoresetMode,
        actions: NDArray[Any],
        now: Records,
        last: Records,
    ):
        self._envs, self._mode, self._actions = envs, mode, actions
        self._now = [_places(now, i) for i in range(len(envs))]
        self._last = [_places(last, i) for i in range(len(envs))]
        self._ended = [False] * len(envs)

    def reset(
        self, seeds: Sequence[int | None], mask: Mask, options: dict[str, object] | None
    ) -> None:
        """Start new episodes in the masked environments (n,)."""
        for i in map(int, np.flatnonzero(mask)):
            self._begin(i, seeds[i], options)

    def step(self) -> None:
        """Let every environment do what its action says, or start over where its mode asks it."""
        for i, env in enumerate(self._envs):
            if self._ended[i] and self._mode is AutoresetMode.NEXT_STEP:
                self._begin(i)
                continue
            report = _report(*env.step(self._actions[i].copy()))
            ended = bool(report["terminated"] or report["truncated"])
            if ended and self._mode is AutoresetMode.SAME_STEP:
                _write(self._last[i], report)
                observation, info = env.reset()
                report |= {"observation": observation, "info": info}
            _write(self._now[i], report)
            self._ended[i] = ended

    def call(self, name: str, args: tuple[object, ...], kwargs: dict[str, object]) -> list[Any]:
        """Return each environment's attribute, or what it returns where it can be called."""
        found = [env.get_wrapper_attr(name) for env in self._envs]
        return [one(*args, **kwargs) if callable(one) else one for one in found]

    def close(self) -> None:
        """Close the environments."""
        for env in self._envs:
            env.close()

    def _begin(
        self, i: int, seed: int | None = None, options: dict[str, object] | None = None
    ) -> None:
        observation, info = self._envs[i].reset(seed=seed, options=options)
        _write(self._now[i], _report(observation, 0.0, False, False, info))
        self._ended[i] = False


def first_report(env: gym.Env) -> Info:
    """Return what an environment reports at a reset."""
    observation, info = env.reset()
    return _report(observation, 0.0, False, False, info)


def _report(
    observation: object, reward: object, terminated: object, truncated: object, info: Info
) -> Info:
    return {
        "observation": observation,
        "reward": reward,
        "terminated": terminated,
        "truncated": truncated,
        "info": info,
    }


def _places(records: Records, i: int) -> Info:
    """Return views of record i by the names of the fields, nested as these are."""
    return {
        name: _places(records[name], i) if records[name].dtype.names else records[name][i, ...]
        for name in records.dtype.names or ()
    }


def _write(places: Info, report: Info, where: str = "") -> None:
    """Write a report to its places.

    Raises:
        InvalidInputError: if it has other entries than the first report had.
    """
    if places.keys() != report.keys():
        raise InvalidInputError(
            f"report{where}: got {sorted(report)}, expected the entries that the first environment "
            f"reported at its first reset: {sorted(places)}"
        )
    for key, place in places.items():
        if type(place) is dict:
            _write(place, report[key], f"{where}[{key!r}]")
        else:
            place[...] = report[key]
