r"""Guidance without a goal: a row along the edge that stops the policy.

Where u* points into a region within 0.5 m, the row requests speed along the region's edge,

.. math::
    tᵀu ≥ −k\,(tᵀv − β), \qquad t = σ\,(n_y, −n_x),

where n is the unit gradient of the nearest such barrier and σ = ±1 the side. The side is that of u*
when the robot meets the edge. It is retained while a region stops the policy, and flipped when the
robot is at rest for `STUCK`. So the robot passes single convex regions. It may not pass a cluster
or a trap, for which there are fields.

Source: the circulation of Gonçalves, Krishnamurthy, Tzes and Khorrami, Control barrier functions
with circulation inequalities, IEEE TCST 2024, with a latched side.
"""

from collections.abc import Sequence

import numpy as np

from hcbf_gym import _core, errors
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import Barrier
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.guidance.field import Pull

STUCK: float = _core.CIRCULATION_STUCK
"""The time at rest after which the side is flipped [s]."""


class Local:
    """Circulation around the regions that stop the policies of N robots in N scenes.

    Args:
        count: N.

    Raises:
        InvalidInputError: if the count is below 1.

    Attributes:
        memory: (N, 2) the side σ, 0 if nothing stops the policy, and the time at rest [s].
        barriers: the barriers of the N scenes as they are now; None before the first reset.
    """

    def __init__(self, count: int = 1):
        self.memory = np.zeros((errors.count("count", count), 2))
        self.barriers: BarrierSet | None = None

    def reset(self, barriers: BarrierSet | Sequence[Barrier], *, mask: Mask | None = None) -> None:
        """Forget the sides in scenes that begin.

        Args:
            barriers: those of N scenes; a sequence of barriers where N is 1.
            mask: (N,) the scenes that begin; all unless given.

        Raises:
            InvalidInputError: if there are not N scenes.
        """
        scenes = barriers if isinstance(barriers, BarrierSet) else BarrierSet([barriers])
        if len(scenes.kind) != len(self.memory):
            raise InvalidInputError(
                f"barriers: got {len(scenes.kind)} scenes, expected {len(self.memory)}"
            )
        self.barriers = scenes
        self.memory[slice(None) if mask is None else mask] = 0.0

    def write_rows(self, x: Array, t: Array, u_nominal: Array, out: Array) -> None:
        """Write a_x, a_y, b of the rows at states x (N, 4), times t (N,), u* (N, 2) to out (N, 3).

        Raises:
            InvalidInputError: before the first reset.
        """
        if self.barriers is None:
            raise InvalidInputError("guidance: there is no scene yet, expected reset() first")
        kind, parameters = self.barriers.kind, self.barriers.parameters
        _core.circulation_rows(kind, parameters, x, t, u_nominal, Pull(), self.memory, out)
