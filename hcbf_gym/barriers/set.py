"""The barriers of one scene, or of N scenes, as arrays that the compiled kernels read."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.barriers import kernels
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.barriers.shapes import KINDS, MAX_VERTICES, Barrier
from hcbf_gym.errors import InvalidInputError

Array = NDArray[np.float64]

_PARAMETERS = 3 + 2 * MAX_VERTICES


class BarrierSet:
    """m barriers in each of N scenes, evaluated for N states of the double integrator at once.

    Args:
        scenes: N sequences of m built-in barriers.

    Raises:
        InvalidInputError: if a scene is empty, the scenes differ in length, or a barrier is not
            one of the built-in kinds.

    Attributes:
        kind: (N, m) which kernel evaluates the barrier.
        parameters: (N, m, 19) what that kernel reads.
        priority: (N, m) 1 is the highest and strict.
        keeps_margin: (N, m) 1 for strict barriers on the position, 0 for the others.
    """

    def __init__(self, scenes: Sequence[Sequence[Barrier]]):
        lengths = {len(scene) for scene in scenes}
        if len(lengths) != 1 or 0 in lengths:
            raise InvalidInputError(
                f"barrier set: got scenes of {sorted(lengths)} barriers, expected one length >= 1"
            )
        shape = (len(scenes), lengths.pop())
        self.kind = np.zeros(shape, dtype=np.int64)
        self.parameters = np.zeros((*shape, _PARAMETERS))
        self.priority = np.zeros(shape, dtype=np.int64)
        self.keeps_margin = np.zeros(shape)
        for i, scene in enumerate(scenes):
            self.set_scene(i, scene)

    def set_scene(self, i: int, scene: Sequence[Barrier]) -> None:
        """Replace the barriers of scene `i`.

        Raises:
            InvalidInputError: if a barrier is not one of the built-in kinds.
        """
        for barrier in scene:
            if type(barrier) not in KINDS.values():
                raise InvalidInputError(
                    f"barrier {barrier.name!r}: got {type(barrier).__name__}, "
                    f"expected one of {sorted(KINDS)}"
                )
        self.parameters[i] = 0.0
        for k, barrier in enumerate(scene):
            numbers = barrier.parameters()
            self.kind[i, k] = barrier.kind
            self.parameters[i, k, : len(numbers)] = numbers
            self.priority[i, k] = barrier.priority
            self.keeps_margin[i, k] = barrier.priority == 1 and barrier.reads_position

    def values(self, x: Array, t: Array) -> Array:
        """Return h (N, m) at the states x (N, 4) and times t (N,)."""
        h = np.empty(self.kind.shape)
        kernels.values(self.kind, self.parameters, x, t, h)
        return h

    def along(self, x: Array, t: Array) -> Array:
        """Return h (k, m) of scene 0 at k states x (k, 4) and times t (k,)."""
        h = np.empty((len(x), self.kind.shape[1]))
        kernels.along(self.kind[0], self.parameters[0], x, t, h)
        return h

    def sense(self, x: Array, t: Array) -> tuple[Array, Array]:
        """Return h (N, m) and (N, m, 4) what a policy sees: h, unit gradient, ∂h/∂t."""
        h, sensed = np.empty(self.kind.shape), np.empty((*self.kind.shape, 4))
        kernels.sense(self.kind, self.parameters, x, t, h, sensed)
        return h, sensed

    def rows(
        self, x: Array, t: Array, alpha1: ClassK, alpha2: ClassK, margin: float = 0.0
    ) -> CbfRows:
        """Return the rows of N states, each field with a leading axis N; see `general.GeneralRows`.

        Args:
            x: (N, 4) positions [m] and velocities [m/s].
            t: (N,) times [s].
            alpha1: α₁, applied to h at relative degree 2.
            alpha2: α₂, applied to ψ.
            margin: what strict rows on the position keep between h and zero [m].
        """
        shape = self.kind.shape
        a, b, h, alpha2_psi = (
            np.empty((*shape, 2)),
            np.empty(shape),
            np.empty(shape),
            np.empty(shape),
        )
        kernels.rows(
            self.kind,
            self.parameters,
            self.keeps_margin * margin,
            x,
            t,
            alpha1.parameters(),
            alpha2.parameters(),
            a,
            b,
            h,
            alpha2_psi,
        )
        return CbfRows(a, b, h, self.priority, alpha2_psi)
