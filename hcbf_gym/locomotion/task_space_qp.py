"""The task-space QP of each tick: compiled up to its bounds, DAQP where one binds."""

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Records, attributes, words_of
from hcbf_gym.locomotion import qp
from hcbf_gym.locomotion.records import WORKSPACE
from hcbf_gym.locomotion.state import RobotState


class TaskSpaceQp:
    """The program of each tick, and its torques; where no bound binds, a tick is one compiled call.

    Attributes:
        feedforward: (12,) τ of the latest solution [N·m]; a view, which every tick changes.
        program: that of the latest tick; views, too.

    Args:
        settings: (1,) `records.SETTINGS`.
        memory: (1,) `records.MEMORY`, moved on by every tick.
    """

    def __init__(self, settings: Records, memory: Records) -> None:
        workspace = np.zeros(1, dtype=WORKSPACE)
        self._compiled = _core.LocomotionTick(*map(words_of, (settings, memory, workspace)))
        work = attributes(workspace)
        self._torque, self.feedforward, self._z = work.torque, work.feedforward, work.z
        self._programs = [
            qp.QuadraticProgram(
                work.H,
                work.f,
                work.A[: 12 + 4 * contacts],
                work.lower[: 24 + 4 * contacts],
                work.upper[: 24 + 4 * contacts],
                0,
            )
            for contacts in range(5)
        ]
        # where no bound binds, the solution is in the workspace and the multipliers are zero
        self._free = [
            qp.Solution(work.z, qp.OPTIMAL, np.zeros(len(program.lower)))
            for program in self._programs
        ]
        self.program = self._programs[0]

    def step(self, state: RobotState, u: Array) -> tuple[Array, qp.Solution]:
        """Return (12,) torques [N·m] and the QP's solution; without one the last torques hold."""
        contacts, free = self._compiled.tick(state.vector, u)
        self.program = self._programs[contacts]
        if free:
            return self._torque.copy(), self._free[contacts]
        solution = qp.solve(self.program)
        if solution.x is not None:
            self._z[:] = solution.x
        self._compiled.finish(solution.x is not None)
        return self._torque.copy(), solution
