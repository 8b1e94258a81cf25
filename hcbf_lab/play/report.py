"""The record of a tick of the playground, and the sentences that describe it."""

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
    """All values of one tick that a page shows; its arrays are copies."""

    time: float  # since the restart [s]
    pace: float  # simulated seconds in a second of the clock
    running: bool  # whether time advances
    position: Array  # (2,) of the trunk [m]
    velocity: Array  # (2,) [m/s]
    reference: Array  # (2,) the reference's point now, or the goal [m]
    # the compiled MuJoCo scene, a new object after each start; None for the reduced-order model
    body: "mujoco.MjModel | None"
    poses: Array | None  # (k, 7) position and quaternion of its bodies
    h: dict[int, float]  # rank → the least h of its regions [m]
    # rank → the least h since the restart, the last push or the last edit of the scene [m]
    least: dict[int, float]
    slack: dict[int, float]  # rank → the largest violation of its rows [m/s²]
    speed_margin: float | None  # h of the speed limit [m/s]; None without a limit
    intervention: float  # ‖u − u*‖ [m/s²]
    status: str  # a `FilterStatus`'s name, or "UNFILTERED"
    sentence: str  # the situation, in plain words
    conflict: str  # the conditions that conflict, in words; "" for none
    details: dict[str, str]  # further readings of the filter's report, in words
    settings: Settings  # that are chosen
    scenario: Scenario  # the scene
    revision: int  # the number of changes of settings or scene, and of refused commands
    message: str  # the last message to the person; "" for none
    messages: int  # their number


def details(report: Info, margin: float, is_derived: bool) -> dict[str, str]:
    """Return further readings of a filter's report in words, by name.

    Args:
        report: of the filter.
        margin: the largest margin of a condition on the position [m].
        is_derived: whether the margin follows from the plant's uncertainty.
    """
    worst_rank = int(report["reachable"])  # on the path to the goal
    return {
        "margin": f"{margin:.2f} m, {'derived' if is_derived else 'chosen'}",
        "model error": f"{float(report['model_error']):.2f} m/s² beside its model",
        "reachable": f"leads through rank {worst_rank}" if worst_rank else "enters nothing",
    }


def by_rank(values: Array, priority: Integers, reduce: Any) -> dict[int, float]:
    """Return rank → `reduce` of the values (m,) of its conditions, such as `np.min`."""
    ranks = np.unique(priority).tolist()
    return {rank: float(reduce(values[priority == rank])) for rank in ranks}


def sentence(
    status: str,
    slack: Mapping[int, float],
    h: Mapping[int, float],
    intervention: float,
    reason: int = Reason.NONE,
) -> str:
    """Return one sentence about the filter's decision and its consequence.

    Args:
        status: a `FilterStatus`'s name, or "UNFILTERED".
        slack: rank → the largest violation of its rows [m/s²].
        h: rank → its least h [m].
        intervention: ‖u − u*‖ [m/s²].
        reason: a `Reason` to brake.
    """
    if status == UNFILTERED:
        inside = [rank for rank, value in h.items() if value < 0.0]
        where = f"the robot is inside a region of {_ranks(inside)}" if inside else "nothing is hit"
        return f"There is no filter, and {where}."
    if status == FilterStatus.NOMINAL.name:
        return "The policy decides: no region is near enough to matter."
    if status == FilterStatus.SAFE.name:
        return f"Every rank holds: the filter changes the input by {intervention:.1f} m/s²."
    if status == FilterStatus.UNSAFE.name:
        return "The robot is inside a region of rank 1: the filter brings it out."
    if status == FilterStatus.BACKUP.name:
        remedy = "; a restart ends that" if Reason(reason).lasts else ""
        return f"The filter brakes{remedy}: {Reason(reason).text.partition(':')[0]}."
    if status == FilterStatus.VIOLATED.name:
        return f"No input satisfies rank 1: it lacks {max(slack.values(), default=0.0):.1f} m/s²."
    paying = [rank for rank, value in slack.items() if value > 0.0]
    amount = f"{max((slack[rank] for rank in paying), default=0.0):.1f} m/s²"
    pay = f"{_ranks(paying)} {'pays' if len(paying) == 1 else 'pay'} {amount}"
    holding = [rank for rank in h if rank not in paying and rank < max(paying, default=0)] or [1]
    hold = f"{_ranks(holding)} {'holds' if len(holding) == 1 else 'hold'}"
    return f"{pay[0].upper()}{pay[1:]} so that {hold}."


def conflict(report: ConflictReport | None, barriers: Sequence[Barrier], x: Array) -> str:
    """Return in words which conditions conflict at x (4,); "" without a report.

    A class of a map is named with its place that is nearest to the robot.
    """
    if report is None:
        return ""
    parts = []
    for row in report.rows:
        barrier = barriers[row]
        name = barrier.name
        if isinstance(barrier, Mapped):
            h, normal = barrier.nearest(x)
            place = x[:2] - h * normal
            name += f" at {place[0]:.1f}, {place[1]:.1f} m"
        parts.append(f"{name} (rank {barrier.priority})")
    if report.needs_input_set:
        parts.append("the limits of the input")
    return "In conflict: " + ", ".join(parts) + "."


def _ranks(ranks: list[int]) -> str:
    """Return ranks in words, such as "rank 2" or "ranks 2 and 3"."""
    if len(ranks) == 1:
        return f"rank {ranks[0]}"
    *first, last = map(str, sorted(ranks))
    return f"ranks {', '.join(first)} and {last}"
