r"""What a step may be called: whether rank 1 is proved, and the status that follows.

The proposition of `docs/guarantees.md` starts from h ≥ m and ψ ≥ 0 of every strict condition on
the position. A step at which both hold is *proved*. One at which they do not is VIOLATED, whatever
brought it there: a conflict, a push, a fix, barriers that are news.

There is one exception. m is also there to be used: by a robot that sways and leans beside its
model, and by the errors of a scan. With e what they may use of m without a word (the tracking
error's part, less what `cap` cuts off of it, half of the constant part d, and what a scan reserves
for its noise and for what walks), such a step is not proved, but VIOLATED only where h < m − e, or
ḣ − ṁ + α₁(h − m + e) stays below zero for longer than the robot takes to follow, or news left it
so. What is handed over anew is news where one of the two falls below what it was without it. Of a
robot that is its model, among what was not measured, e = 0.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Mask, Record
from hcbf_gym.barriers import class_k, layout
from hcbf_gym.barriers.margins import SHORT, is_fast
from hcbf_gym.barriers.shape import TINY
from hcbf_gym.compilation import kernel
from hcbf_gym.models.constants import ASKING, STANDING
from hcbf_gym.programs.result import FilterStatus

NOMINAL, SAFE = int(FilterStatus.NOMINAL), int(FilterStatus.SAFE)
VIOLATED, UNSAFE = int(FilterStatus.VIOLATED), int(FilterStatus.UNSAFE)
BACKUP = int(FilterStatus.BACKUP)

COMPARED, NEWS = 1, 2
"""What came in unforeseen: barriers that are compared with those before; whatever it is, others, or
a state after none."""

MEMORY = [
    ("news", "i8"),  # one of these, 0 for nothing
    ("kept", "f8"),  # the least h − m at this sample [m]; with news, of the barriers before
    ("headway", "f8"),  # likewise the least ψ [m/s]
    ("unproved", "i8"),  # whether news left something short, until nothing is
    ("closing", "f8"),  # for how long ψ has been below zero [s]
]
"""What is remembered from step to step; zeros at a reset."""


class Shortfall(NamedTuple):
    """What the strict conditions on the position lack at one sample.

    Attributes:
        kept: the least h − m [m].
        headway: the least ψ [m/s].
        kept_at_most: as `kept`, with m − e for m.
        headway_at_most: likewise.
    """

    kept: float
    headway: float
    kept_at_most: float
    headway_at_most: float


@kernel(error_model="numpy")
def shortfall(
    strict: Mask,
    h: Array,
    margin: Array,
    leaning: Array,
    psi: Array,
    dip: float,
    sway: float,
    alpha1: Array,
) -> Shortfall:
    """Return what strict conditions lack; usual rows may dip between samples by what they reserve.

    Args:
        strict: (m,) which conditions are of rank 1 and on the position.
        h: (m,).
        margin: (m,) m.
        leaning: (m,) what of it the tracking error and errors of measurement may use.
        psi: (m,) ψ.
        dip: what usual rows reserve against dips between samples; 0 for held rows.
        sway: what of the constant part a robot may use that is not its model.
        alpha1: (4,) α₁.
    """
    least = least_psi = at_most = psi_at_most = np.inf
    for k in range(strict.size):
        if not strict[k]:
            continue
        kept, spare, used = h[k] - margin[k] + dip, psi[k], leaning[k] + sway
        if dip > 0.0:
            spare += class_k.value(alpha1, kept) - class_k.value(alpha1, kept - dip)
        least, least_psi = min(least, kept), min(least_psi, spare)
        if used > 0.0:
            spare += class_k.value(alpha1, kept + used) - class_k.value(alpha1, kept)
        at_most, psi_at_most = min(at_most, kept + used), min(psi_at_most, spare)
    return Shortfall(least, least_psi, at_most, psi_at_most)


@kernel(inline="always")
def lacks(short: Shortfall) -> bool:
    """Return whether h is below m, or ψ below zero."""
    return short.kept < -SHORT or short.headway < -SHORT


@kernel(error_model="numpy")
def is_violated(memory: Record, short: Shortfall, period: float, settles: float) -> bool:
    """Return whether a step is VIOLATED for what its strict conditions lack, and remember.

    Args:
        memory: a record with the fields of `MEMORY`, written to.
        short: of this sample.
        period: T [s]; 0 where it is not known.
        settles: how long a robot takes to follow [s]; 0 for one that is its model.
    """
    fell = memory.news == NEWS
    if memory.news == COMPARED:
        fell = short.kept_at_most < memory.kept - SHORT
        fell |= short.headway_at_most < memory.headway - SHORT
    memory.unproved = 1 if lacks(short) and (fell or memory.unproved != 0) else 0
    memory.news, memory.kept, memory.headway = 0, short.kept, short.headway
    fast = short.headway_at_most < -SHORT
    memory.closing = memory.closing + period if fast else 0.0
    exact = settles == 0.0 or period == 0.0
    lasts = fast and (exact or memory.closing > settles)
    return memory.unproved != 0 or short.kept_at_most < -SHORT or lasts


@kernel()
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


@kernel(inline="always")
def speeds(kind: int, limit: float, h: float, x: Array, lag: Array) -> bool:
    """Return whether a body is faster than a speed limit, or than that of a zone in which it is.

    Rows read the model's velocity, and reserve what the body may differ while it follows. What it
    does when the limit comes, or when nobody knows what it was told, only its own velocity shows.
    h and x are of one point: the axle of a differential drive, all others' own.

    Args:
        kind: of the condition.
        limit: L, of a condition on the speed [m/s].
        h: of the condition, at the model's velocity.
        x: (4,) of the model.
        lag: (4,) the body's state minus the model's.
    """
    if kind != layout.SPEED_LIMIT and kind != layout.ZONES and kind != layout.ZONE:
        return False
    model2 = x[2] * x[2] + x[3] * x[3]
    away = 2.0 * limit * h - limit * limit + model2  # of a zone, times what brakes before it
    return away < TINY and is_fast(limit, x, lag)


@kernel(inline="always")
def stands(speed2: float, asked2: float) -> float:
    """Return 1 where a plant stands though u* asks it to move, by the squares of both."""
    return 1.0 if speed2 < STANDING * STANDING and asked2 > ASKING * ASKING else 0.0
