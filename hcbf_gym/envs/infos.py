"""Infos of N environments in the form of Gymnasium's vector environments, in any autoreset mode.

Each entry ``key`` has a leading axis N. A mask ``_key`` (N,) marks the environments that report it.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

from hcbf_gym.arrays import Array, Info, Mask
from hcbf_gym.errors import choose

Entry = Array | Info
"""An array (N, …), or a dict of such arrays."""


def mode_of(mode: str | AutoresetMode) -> AutoresetMode:
    """Return Gymnasium's autoreset mode of a name, "NextStep", "SameStep" or "Disabled"."""
    if isinstance(mode, AutoresetMode):
        return mode
    return choose("autoreset_mode", mode, {known.value: known for known in AutoresetMode})


def with_masks(info: Info, reported: Mask) -> Info:
    """Return the infos, nested ones too, with the mask `reported` (N,) beside each entry."""
    infos: Info = {}
    for key, value in info.items():
        infos[key] = with_masks(value, reported) if isinstance(value, dict) else value
        infos[f"_{key}"] = reported.copy()
    return infos


def only_masked(infos: Info, mask: Mask) -> Info:
    """Return a copy in which all entries are zero, except those of the masked environments (N,)."""
    kept: Info = {}
    for key, value in infos.items():
        if isinstance(value, dict):
            kept[key] = only_masked(value, mask)
        else:
            kept[key] = np.zeros_like(value)
            kept[key][mask] = value[mask]
    return kept


def replace_masked(infos: Info, mask: Mask, reset_infos: Info) -> None:
    """Replace the entries of the masked environments (N,) in place by those of a reset."""
    for key, value in reset_infos.items():
        if isinstance(value, dict):
            replace_masked(infos[key], mask, value)
        else:
            infos[key][mask] = value[mask]


def move_to_final(infos: Info, done: Mask, last: Array, reset_infos: Info) -> None:
    """Put the infos of a reset within a step (mode SameStep) into those of the step, in place.

    The step's infos and observations `last` (N, …) of the environments `done` (N,), which were
    reset, move to ``final_info`` and ``final_obs``. The infos of the reset take their place.
    """
    final_obs = np.full(len(done), None, dtype=object)
    for i in np.flatnonzero(done):
        final_obs[i] = last[i].copy()
    final_info = only_masked(infos, done)
    replace_masked(infos, done, reset_infos)
    infos |= {"final_obs": final_obs, "_final_obs": done.copy()}
    infos |= {"final_info": final_info, "_final_info": done.copy()}


class Reporter:
    """Adds the entry of a wrapper to a vector environment's infos.

    Gymnasium's autoreset mode decides when an ended episode begins anew: in the step that ends it
    (SameStep), in the next step (NextStep), or in a reset by the caller (Disabled). An environment
    that is reset in a step reports the entry of the reset in the place of the step's. With SameStep
    the entry of the step goes to ``final_info``.

    Args:
        env: the vector environment.
        key: the name of the entry.
    """

    def __init__(self, env: VectorEnv, key: str):
        self._mode = env.metadata["autoreset_mode"]
        self._key = key
        self._ended = np.zeros(env.num_envs, dtype=np.bool_)  # in the step before

    def at_reset(self, infos: Info, entry: Entry, options: dict[str, Any] | None) -> None:
        """Add the entry of a reset in place, for ``options["reset_mask"]`` or for all."""
        everyone = np.ones_like(self._ended)
        mask = everyone if options is None else options.get("reset_mask", everyone)
        self._ended[mask] = False
        infos |= only_masked(with_masks({self._key: entry}, everyone), mask)

    def at_step(
        self, infos: Info, entry: Entry, entry_of_reset: Callable[[Mask], Entry], ended: Mask
    ) -> None:
        """Add the entry of a step in place.

        Args:
            infos: the infos of the step.
            entry: the entry of the step, which may be overwritten.
            entry_of_reset: returns the entry of the environments (N,) that were reset in the step.
            ended: (N,) the environments whose episodes ended in this step.
        """
        added = {self._key: entry}
        everyone = np.ones_like(ended)
        restarted = np.zeros_like(ended)
        if self._mode is AutoresetMode.NEXT_STEP:
            restarted = self._ended
        elif self._mode is AutoresetMode.SAME_STEP:
            restarted = ended
            if ended.any():
                infos["final_info"] |= only_masked(with_masks(added, everyone), ended)
        if restarted.any():
            replace_masked(added, restarted, {self._key: entry_of_reset(restarted)})
        infos |= with_masks(added, everyone)
        self._ended = ended
