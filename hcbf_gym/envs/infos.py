"""Info of N environments as Gymnasium's vector environments give them, in every autoreset mode.

Beside each entry ``key``, with a leading axis N, ``_key`` marks which environments report it.
"""

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

from hcbf_gym.arrays import Array, Info, Mask
from hcbf_gym.errors import choose


def mode_of(mode: str | AutoresetMode) -> AutoresetMode:
    """Return Gymnasium's mode "NextStep", "SameStep" or "Disabled"."""
    if isinstance(mode, AutoresetMode):
        return mode
    return choose("autoreset_mode", mode, {one.value: one for one in AutoresetMode})


def with_masks(info: Info, reported: Mask) -> Info:
    """Return the entries, those of nested infos too, each with its mask."""
    infos: Info = {}
    for key, value in info.items():
        infos[key] = with_masks(value, reported) if isinstance(value, dict) else value
        infos[f"_{key}"] = reported.copy()
    return infos


def only(infos: Info, mask: Mask) -> Info:
    """Return a copy in which the masked environments (N,) alone report; zero elsewhere."""
    kept: Info = {}
    for key, value in infos.items():
        if isinstance(value, dict):
            kept[key] = only(value, mask)
        else:
            kept[key] = np.zeros_like(value)
            kept[key][mask] = value[mask]
    return kept


def put(infos: Info, mask: Mask, fresh: Info) -> None:
    """Replace the masked environments' entries in place by those of `fresh`."""
    for key, value in fresh.items():
        if isinstance(value, dict):
            put(infos[key], mask, value)
        else:
            infos[key][mask] = value[mask]


def start_over(infos: Info, done: Mask, last: Array, fresh: Info) -> None:
    """Turn a step's infos into those of a step that ended with a reset (mode SameStep), in place.

    Episodes `done` (N,) ended with the observations `last` (N, …); `fresh` is of the reset.
    """
    final_obs = np.full(len(done), None, dtype=object)
    for i in np.flatnonzero(done):
        final_obs[i] = last[i].copy()
    final_info = only(infos, done)
    put(infos, done, fresh)
    infos |= {"final_obs": final_obs, "_final_obs": done.copy()}
    infos |= {"final_info": final_info, "_final_info": done.copy()}


class Reporter:
    """Adds the entry `key` to a vector environment's infos.

    An environment that was reset in a step reports the reset's entry, not the step's; with mode
    SameStep the step's own part goes to ``final_info``.
    """

    def __init__(self, env: VectorEnv, key: str):
        self._mode = env.metadata["autoreset_mode"]
        self._key = key
        self._ended = np.zeros(env.num_envs, dtype=np.bool_)

    def at_reset(self, infos: Info, fresh: Any, options: dict[str, Any] | None) -> None:
        """Add what a reset reports, for those of ``options["reset_mask"]`` or for all, in place.

        The entry `fresh` after a reset is (N, …), or a dict of such arrays.
        """
        everyone = np.ones_like(self._ended)
        mask = everyone if options is None else options.get("reset_mask", everyone)
        self._ended[mask] = False
        infos |= only(with_masks({self._key: fresh}, everyone), mask)

    def at_step(self, infos: Info, entry: object, fresh: Any, ended: Mask) -> Mask:
        """Add what a step reports, and return (N,) which environments were reset in it.

        Args:
            infos: of the step; added to in place.
            entry: (N, …) the entry, or a dict of such arrays; may be written to.
            fresh: as in `at_reset`, or a function of the environments (N,) that were reset.
            ended: (N,) whose episodes ended in this step.
        """
        added = {self._key: entry}
        everyone = np.ones_like(ended)
        restarted = np.zeros_like(ended)
        if self._mode is AutoresetMode.NEXT_STEP:
            restarted = self._ended
        elif self._mode is AutoresetMode.SAME_STEP:
            restarted = ended
            if ended.any():
                infos["final_info"] |= only(with_masks(added, everyone), ended)
        if restarted.any():
            put(added, restarted, {self._key: fresh(restarted) if callable(fresh) else fresh})
        infos |= with_masks(added, everyone)
        self._ended = ended
        return restarted
