r"""Guidance without a goal: a row that walks along the edge which stops the policy.

Where u* presses against a region within `REACH`, the row requests speed along the edge,

.. math::
    tᵀu ≥ −k\,(tᵀv − β), \qquad t = σ\,(n_y, −n_x),

n the unit gradient of the nearest such barrier and σ = ±1 the side. The side is the one that u*
leans to when the edge is met; it is retained while something stops the policy, and flipped when
the robot stands still for `STUCK` all the same. So single convex regions are passed; a cluster or
a trap may not be: that takes a field.

Source: the circulation of Gonçalves, Krishnamurthy, Tzes and Khorrami, Control barrier functions
with circulation inequalities, IEEE TCST 2024, with a latched side.
"""

from collections.abc import Sequence

import numpy as np

from hcbf_gym import errors
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import Barrier, kernels
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.compilation import kernel
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.guidance.row import Pull

REACH = 0.5
"""Within this distance an edge may stop the policy [m]."""
LEAVE = 0.8
"""Beyond it, or where u* points away, it does not, and the side is free again [m]."""
SLOW = 0.05
"""Slower than that the robot stands [m/s]."""
STUCK = 1.0
"""Standing for so long flips the side [s]."""


@kernel()
def circulation(
    kind: Integers,
    parameters: Array,
    x: Array,
    t: float,
    u_nominal: Array,
    pull: Pull,
    memory: Array,
) -> tuple[float, float, float]:
    """Return (a_x, a_y, b) of the row at one state; a = 0, b = −1 where nothing stops the policy.

    Args:
        kind: (m,) as in `BarrierSet`.
        parameters: (m, 19) as in `BarrierSet`.
        x: (4,) position [m] and velocity [m/s].
        t: time [s].
        u_nominal: (2,) u* [m/s²].
        pull: gain and speed.
        memory: (2,) the side σ, 0 if free, and since when the robot stands [s]; carried from step
            to step, zeros at a reset.
    """
    held = memory[0] != 0.0
    nearest = LEAVE if held else REACH
    nx = 0.0
    ny = 0.0
    for k in range(kind.size):
        if not kernels.is_region(kind[k]):
            continue
        h, gx, gy, _, _, _ = kernels.jet(kind[k], parameters[k], x[0], x[1], t)
        if h < nearest and gx * u_nominal[0] + gy * u_nominal[1] < 0.0:
            norm = np.sqrt(gx * gx + gy * gy)
            nearest = h
            nx = gx / norm
            ny = gy / norm
    if nx == 0.0 and ny == 0.0:
        memory[0], memory[1] = 0.0, t
        return 0.0, 0.0, -1.0
    if not held:
        memory[0] = 1.0 if ny * u_nominal[0] - nx * u_nominal[1] >= 0.0 else -1.0
        memory[1] = t
    if x[2] * x[2] + x[3] * x[3] > SLOW * SLOW:
        memory[1] = t
    elif t - memory[1] >= STUCK:
        memory[0], memory[1] = -memory[0], t
    ax = memory[0] * ny
    ay = -memory[0] * nx
    return ax, ay, -pull.gain * (ax * x[2] + ay * x[3] - pull.speed)


@kernel()
def rows(
    kind: Integers,
    parameters: Array,
    x: Array,
    t: Array,
    u_nominal: Array,
    pull: Pull,
    memory: Array,
    out: Array,
) -> None:
    """Write (N, 3) a_x, a_y and b of N states; see `circulation`, each array with a leading N."""
    for n in range(x.shape[0]):
        out[n, 0], out[n, 1], out[n, 2] = circulation(
            kind[n], parameters[n], x[n], t[n], u_nominal[n], pull, memory[n]
        )


class Local:
    """Circulation around what stops the policies of N robots in N scenes.

    Args:
        count: N.

    Raises:
        InvalidInputError: if the count is below 1.

    Attributes:
        memory: (N, 2) the side, 0 if free, and since when the robot stands [s].
        barriers: of the N scenes as they are now; None before the first reset.
    """

    def __init__(self, count: int = 1):
        count = errors.count("count", count)
        self.memory = np.zeros((count, 2))
        self.barriers: BarrierSet | None = None

    def reset(self, barriers: BarrierSet | Sequence[Barrier], *, mask: Mask | None = None) -> None:
        """Forget the sides in scenes that begin.

        Args:
            barriers: of N scenes; a sequence of barriers where N is 1.
            mask: (N,) the scenes that begin; all unless given.

        Raises:
            InvalidInputError: if the number of scenes is another.
        """
        scenes = barriers if isinstance(barriers, BarrierSet) else BarrierSet([barriers])
        if len(scenes.kind) != len(self.memory):
            raise InvalidInputError(
                f"barriers: got {len(scenes.kind)} scenes, expected {len(self.memory)}"
            )
        self.barriers = scenes
        self.memory[slice(None) if mask is None else mask] = 0.0

    def write_rows(self, x: Array, t: Array, u_nominal: Array, out: Array) -> None:
        """Write (N, 3) a_x, a_y and b at N states x (N, 4), times t (N,) and u* (N, 2).

        Raises:
            InvalidInputError: before the first reset.
        """
        if self.barriers is None:
            raise InvalidInputError("guidance: there is no scene yet, expected reset() first")
        kind, parameters = self.barriers.kind, self.barriers.parameters
        rows(kind, parameters, x, t, u_nominal, Pull(), self.memory, out)

    def row(self, x: Array, t: float, u_nominal: Array) -> tuple[Array, float]:
        """Return a (2,) and b of the row at one state x (4,), time t and u* (2,), where N is 1."""
        state = np.asarray(x, dtype=np.float64)[None]
        out = np.empty((1, 3))
        self.write_rows(state, np.array([t]), np.asarray(u_nominal, dtype=np.float64)[None], out)
        return out[0, :2], float(out[0, 2])
