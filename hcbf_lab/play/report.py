"""The report of a tick of the playground: a record of readings and one plain sentence."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array, Info, Integers
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.mapped import Mapped
from hcbf_gym.programs import ConflictReport, FilterStatus
from hcbf_gym.scenarios import Scenario
from hcbf_lab.play.settings import Settings

if TYPE_CHECKING:
    import mujoco

UNFILTERED = "UNFILTERED"


class Snapshot(NamedTuple):
    """All that a page shows of one tick; its arrays are copies."""

    time: float  # since the restart [s]
    pace: float  # simulated seconds in a second of the clock
    running: bool  # whether time advances
    position: Array  # (2,) of the trunk [m]
    velocity: Array  # (2,) [m/s]
    reference: Array  # (2,) where the reference is now, or the goal [m]
    # the compiled MuJoCo scene, None for the reduced-order model; another object after another
    # start
    body: "mujoco.MjModel | None"
    poses: Array | None  # (k, 7) position and quaternion of its bodies
    h: dict[int, float]  # rank → the least h of its regions [m]
    # rank → the least h since the restart, the last push or the last change [m]
    least: dict[int, float]
    slack: dict[int, float]  # rank → the largest violation of its rows [m/s²]
    speed_margin: float | None  # h of the speed limit [m/s]; None without one
    intervention: float  # ‖u − u*‖ [m/s²]
    status: str  # a `FilterStatus`'s name, or "UNFILTERED"
    sentence: str  # the situation, in plain words
    conflict: str  # which rows conflict, or nothing
    details: dict[str, str]  # more of `info["safety_filter"]`, in words
    settings: Settings  # what was chosen
    scenario: Scenario  # the scene
    revision: int  # counts what changed settings or scene, or was refused
    message: str  # the last message to the person
    messages: int  # counts them


def details(report: Info, kept: float, derived: bool) -> dict[str, str]:
    """Return more of a filter's report, in words.

    Args:
        report: of the filter.
        kept: the largest margin of a condition on the position [m].
        derived: whether it follows from what is uncertain.
    """
    through = int(report["reachable"])
    return {
        "margin": f"{kept:.2f} m, {'derived' if derived else 'chosen'}",
        "model error": f"{float(report['model_error']):.2f} m/s² beside its model",
        "reachable": f"leads through rank {through}" if through else "enters nothing",
    }


def by_rank(values: Array, priority: Integers, pick: Any) -> dict[int, float]:
    """Return rank → the picked one of its values; `pick` is `np.min` or `np.max`."""
    ranks = np.unique(priority).tolist()
    return {rank: float(pick(values[priority == rank])) for rank in ranks}


def sentence(
    status: str,
    slack: Mapping[int, float],
    h: Mapping[int, float],
    intervention: float,
    reason: int = Reason.NONE,
) -> str:
    """Return the situation in a sentence.

    Args:
        status: a `FilterStatus`'s name, or "UNFILTERED".
        slack: rank → what it pays [m/s²].
        h: rank → its least h [m].
        intervention: ‖u − u*‖ [m/s²].
        reason: a `Reason` to brake.
    """
    inside = [rank for rank, value in h.items() if value < 0.0]
    paying = {rank: value for rank, value in slack.items() if value > 0.0}
    if status == UNFILTERED:
        where = f"the robot is inside a region of {_ranks(inside)}" if inside else "nothing is hit"
        return f"There is no filter, and {where}."
    if status == FilterStatus.NOMINAL.name:
        return "The policy decides: no region is near enough to matter."
    if status == FilterStatus.SAFE.name:
        return f"Every rank holds: the filter changes the input by {intervention:.1f} m/s²."
    if status == FilterStatus.UNSAFE.name:
        return "The robot is inside a region of rank 1: the filter brings it out."
    if status == FilterStatus.BACKUP.name:
        lasts = "; a restart ends that" if Reason(reason).lasts else ""
        return f"The filter brakes{lasts}: {Reason(reason).text.partition(':')[0]}."
    if status == FilterStatus.VIOLATED.name:
        return f"No input satisfies rank 1: it lacks {max(slack.values(), default=0.0):.1f} m/s²."
    held = [rank for rank in h if rank not in paying and rank < max(paying, default=0)]
    amounts = f"{max(paying.values(), default=0.0):.1f} m/s²"
    pay = f"{_ranks(list(paying))} {'pays' if len(paying) == 1 else 'pay'} {amounts}"
    hold = f"{_ranks(held)} {'holds' if len(held) == 1 else 'hold'}" if held else "rank 1 holds"
    return f"{pay[0].upper()}{pay[1:]} so that {hold}."


def conflict(found: ConflictReport | None, barriers: Sequence[Barrier], x: Array) -> str:
    """Return which conditions conflict at x (4,), with the nearest place of a map's class."""
    if found is None:
        return ""
    parts = []
    for k in found.rows:
        barrier = barriers[k]
        name = barrier.name
        if isinstance(barrier, Mapped):
            h, normal = barrier.nearest(x)
            place = x[:2] - h * normal
            name += f" at {place[0]:.1f}, {place[1]:.1f} m"
        parts.append(f"{name} (rank {barrier.priority})")
    if found.needs_input_set:
        parts.append("the limits of the input")
    return "In conflict: " + ", ".join(parts) + "."


def _ranks(ranks: list[int]) -> str:
    if len(ranks) == 1:
        return f"rank {ranks[0]}"
    *first, last = map(str, sorted(ranks))
    return f"ranks {', '.join(first)} and {last}"
