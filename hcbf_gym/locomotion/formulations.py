"""The two forms of the task-space QP behind one interface: plan a tick, read off torques."""

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.locomotion import qp
from hcbf_gym.locomotion.matrices import affine
from hcbf_gym.locomotion.state import Array, RobotState
from hcbf_gym.locomotion.task_space import QuadraticProgram
from hcbf_gym.locomotion.tick import tick_condensed, tick_full

Record = NDArray[np.void]


class CondensedForm:
    """Twelve unknowns; the arrays are made once and filled again every tick."""

    def __init__(self) -> None:
        self._arrays = (
            np.zeros((12, 12)),
            np.zeros(12),
            np.zeros((28, 12)),
            np.zeros(40),
            np.zeros(40),
        )
        H, f, A, lower, upper = self._arrays
        self._with_contacts = [
            QuadraticProgram(H, f, A[: 12 + 4 * c], lower[: 24 + 4 * c], upper[: 24 + 4 * c], 0)
            for c in range(5)
        ]
        self._torque_map, self._torque_offset = A[:12], np.zeros(12)
        self.program = self._with_contacts[0]
        self._x = np.zeros(12)
        self.feedback = np.zeros(12)

    def solve(
        self,
        settings: Record,
        memory: Record,
        state: RobotState,
        u: Array,
        M: Array,
        nonlinear_effects: Array,
    ) -> qp.QpSolution:
        """Move `memory` on by one tick and solve its QP; see `tick.tick_condensed`."""
        contacts, solved = tick_condensed(
            settings,
            memory,
            *state,
            u,
            M,
            nonlinear_effects,
            *self._arrays,
            self._torque_offset,
            self._x,
            self.feedback,
        )
        self.program = self._with_contacts[contacts]
        return qp.unconstrained(self.program, self._x) if solved else qp.solve(self.program)

    def torque(self, x: Array) -> Array:
        """Return (12,) the joint torques of a solution [N·m]."""
        return affine(self._torque_map, x, self._torque_offset)


class FullForm:
    """The paper's unknowns (q̈, τ, F)."""

    program: QuadraticProgram
    feedback: Array

    def solve(
        self,
        settings: Record,
        memory: Record,
        state: RobotState,
        u: Array,
        M: Array,
        nonlinear_effects: Array,
    ) -> qp.QpSolution:
        """Move `memory` on by one tick and solve its QP; see `tick.tick_full`."""
        self.program, self.feedback = tick_full(settings, memory, state, u, M, nonlinear_effects)
        return qp.solve(self.program)

    def torque(self, x: Array) -> Array:
        """Return (12,) the joint torques of a solution [N·m]."""
        return x[18:30].copy()
