r"""What a step may be called: whether rank 1 is proved, and the status that follows.

The proposition of `docs/guarantees.md` starts from h ≥ m and ψ ≥ 0 of every strict condition on
the position. A step at which both hold is *proved*. One at which they do not is VIOLATED, whatever
brought it there: a conflict, a push, a fix, barriers that are news. There is one exception. Where
the robot leans at a wall, the part of m that stands for its tracking error jumps, with nothing
entered. Such a step is not proved either, but it is VIOLATED only where h is below the rest of m,
or ψ stays below zero for longer than the robot takes to follow, or news left it so.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.barriers import class_k
from hcbf_gym.programs.result import FilterStatus

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NOMINAL, SAFE = int(FilterStatus.NOMINAL), int(FilterStatus.SAFE)
VIOLATED, UNSAFE = int(FilterStatus.VIOLATED), int(FilterStatus.UNSAFE)
BACKUP = int(FilterStatus.BACKUP)

SHORT = 1e-4
"""By how much h − m [m] and ψ [m/s] may be below zero: both return to it without end."""

MEMORY = [
    ("news", "i8"),  # whether barriers, or a state after none, came in unforeseen
    ("unproved", "i8"),  # whether news left something short, until nothing is
    ("closing", "f8"),  # for how long ψ has been below zero [s]
]
"""What is remembered from step to step; zeros at a reset."""


class Shortfall(NamedTuple):
    """What the strict conditions on the position lack at one sample.

    Attributes:
        near: whether h is below m.
        within: whether h is below the part of m that does not lean.
        fast: whether ψ is below zero.
    """

    near: bool
    within: bool
    fast: bool


@njit(cache=True, error_model="numpy")
def shortfall(
    strict: Mask, h: Array, margin: Array, leaning: Array, psi: Array, dip: float, alpha1: Array
) -> Shortfall:
    """Return what strict conditions lack; usual rows may dip between samples by what they reserve.

    Args:
        strict: (m,) which conditions are of rank 1 and on the position.
        h: (m,).
        margin: (m,) m.
        leaning: (m,) the tracking error's part of it.
        psi: (m,) ψ.
        dip: what usual rows reserve against dips between samples; 0 for held rows.
        alpha1: (4,) α₁.
    """
    near = within = fast = False
    for k in range(strict.size):
        if not strict[k]:
            continue
        kept = h[k] - margin[k]
        spare = psi[k]
        if dip > 0.0:
            spare += class_k.value(alpha1, kept + dip) - class_k.value(alpha1, kept)
        near |= kept + dip < -SHORT
        within |= kept + dip + leaning[k] < -SHORT
        fast |= spare < -SHORT
    return Shortfall(near, within, fast)


@njit(cache=True, error_model="numpy")
def is_violated(memory: Any, lacks: Shortfall, period: float, settles: float) -> bool:
    """Return whether a step is VIOLATED for what its strict conditions lack, and remember.

    Args:
        memory: a record with the fields of `MEMORY`, written to.
        lacks: of this sample.
        period: T [s]; 0 where it is not known.
        settles: how long a robot takes to follow [s]; 0 for one that is its model.
    """
    short = lacks.near or lacks.fast
    memory.unproved = 1 if short and (memory.news != 0 or memory.unproved != 0) else 0
    memory.news = 0
    memory.closing = memory.closing + period if lacks.fast else 0.0
    exact = settles == 0.0 or period == 0.0
    lasts = lacks.fast and (exact or memory.closing > settles)
    return memory.unproved != 0 or lacks.within or lasts


@njit(cache=True)
def conclude(status: int, moved: bool, unsafe: bool, violated: bool, slack: Array) -> int:
    """Return the status of a step.

    A guidance row that gives way is no violation, and an input that only guidance moved is SAFE.

    Args:
        status: the program's.
        moved: whether u is not u*.
        unsafe: whether a strict h is below zero.
        violated: as `is_violated` returns it.
        slack: (m,) of the safety rows.
    """
    if status == BACKUP:
        return status
    if unsafe:
        return UNSAFE
    met = True
    for k in range(slack.size):
        met = met and slack[k] == 0.0
    if met:
        status = SAFE if moved else NOMINAL
    return max(status, VIOLATED) if violated else status
