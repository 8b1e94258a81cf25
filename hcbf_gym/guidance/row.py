r"""The guidance row: keep moving down the field, as far as every safety row lets you.

With d the unit vector towards the point that lies `look_ahead` further down the field, the row is

.. math::
    dᵀu ≥ −k\,(dᵀv − β \min(1, r / r_0)),

r the distance from the goal. Where it holds, the speed along d does not fall below β. It has the
last rank of all, so that no safety row pays for it.
"""

from typing import NamedTuple

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Field, Ranks


class Pull(NamedTuple):
    """How the guidance row pulls.

    Attributes:
        gain: k [1/s].
        speed: β, the least speed along the path [m/s].
        look_ahead: how far down the field the row aims [m].
        ease: r₀, the distance from the goal within which β falls to zero [m]; short, as many a
            robot with legs stands where a slow velocity is commanded.
    """

    gain: float = 3.0
    speed: float = 0.4
    look_ahead: float = 0.6
    ease: float = 0.3


def descent(
    view: Field, geometry: Array, goal: Array, x: float, y: float, length: float
) -> tuple[float, float]:
    """Return the point that lies `length` further down the field, or the goal if that is nearer.

    Steps are one cell long and follow the gradient; one that would climb, in a valley narrower
    than two cells, goes to the lowest cell around instead. So T decreases at every step.
    """
    return _core.field_descent(view, geometry, goal, x, y, length)


def rows(field: Field, geometry: Array, goal: Array, x: Array, pull: Pull, out: Array) -> None:
    """Write a_x, a_y and b of N states, each in its own field: of rows ``a·u ≥ b``.

    At the goal, where the state is not finite, and where there is no field yet, a row requests
    nothing: a = 0, b = −1. Where the path turns back, as on the ridge between two ways round, a row
    goes on where the last one led if that is as near.

    Args:
        field: (N, capacity).
        geometry: (N, 7) of the grids, see `guidance.field`.
        goal: (N, 2) [m].
        x: (N, 4) positions [m] and velocities [m/s].
        pull: gain, speed and ranges.
        out: (N, 3) the rows before, or zeros; written to.
    """
    _core.guidance_rows(field, geometry, goal, x, pull, out)


def rank_at(ranks: Ranks, geometry: Array, x: float, y: float) -> int:
    """Return what stands at a point's cell in (capacity,) ranks, of paths or zones; 0 for none.

    There is none where no field was computed, or the point is not finite.
    """
    return _core.guidance_rank_at(ranks, geometry, x, y)


def ranks_at(
    through: Ranks, zones: Ranks, geometry: Array, x: Array, reachable: Array, zone: Array
) -> None:
    """Write through which ranks N states reach their goals, and in which zones they lie.

    Args:
        through: (N, capacity) as `Geodesic` holds it.
        zones: (N, capacity) likewise.
        geometry: (N, 7).
        x: (N, 4) positions first [m].
        reachable: (N,) of `through`, to be written.
        zone: (N,) of `zones`, to be written.
    """
    _core.guidance_ranks(through, zones, geometry, x, reachable, zone)
