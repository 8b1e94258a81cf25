"""Observation, reward and infos of one control step of one robot, from one compiled call.

The numbers are those of `task.step_info`, `task.reward_terms` and `task.observe`, which compute
them for N robots. The core writes them into one array, so that a step copies it once: every entry
of its infos is a view of the copy.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.drive import Motion
from hcbf_gym.envs.task import REWARD_TERMS
from hcbf_gym.models.plant import Estimate
from hcbf_gym.scenarios import Scenario

_FIRST_ENTRIES = "cost", "tracking_error", "is_success"  # before the reward's terms


class StepResult(NamedTuple):
    """The observation, reward and infos that a policy gets from a step."""

    observation: Array  # (8 + 4 m,)
    reward: float
    info: Info  # with the reward's terms


class StepTally:
    """Computes the results of one robot's steps in one scene.

    The core's array holds `_core.TALLY_HEAD` single numbers, then h, min_h and violation of each
    barrier, the costs of each rank, and the observation.

    Args:
        scenario: the scene; a policy sees its m barriers.
        barriers: the number of barriers, the environment's own included.
        ranks: R, the number of ranks that `costs` has.
    """

    def __init__(self, scenario: Scenario, barriers: int, ranks: int):
        self._is_reach, self._ranks = scenario.task == "reach", ranks
        sizes = barriers, barriers, barriers, ranks, 8 + 4 * len(scenario.conditions)
        ends = np.cumsum((_core.TALLY_HEAD, *sizes)).tolist()
        h, min_h, violation, costs, self._observation = map(slice, ends, ends[1:])
        self._array = np.zeros(ends[-1])
        # the place of each info in the array
        self._infos: dict[str, slice | int] = {
            "h": h, "min_h": min_h, "violation": violation, "costs": costs
        }  # fmt: skip
        for index, name in enumerate(_FIRST_ENTRIES):
            self._infos[name] = index
        for index, name in enumerate(REWARD_TERMS[scenario.task], _core.TALLY_TERMS):
            self._infos[name] = index

    def result(
        self,
        barriers: BarrierSet,
        motion: Motion,
        estimate: Estimate,
        reference: Array,
        u: Array,
        distances: tuple[float, float],
        success: bool,
    ) -> StepResult:
        """Return the result of a step.

        Args:
            barriers: the scene's barriers, the environment's own included.
            motion: the robot's path in the step.
            estimate: the state at the end, on which the loop is closed.
            reference: (6,) position, velocity and acceleration of the reference at the end.
            u: (2,) the applied acceleration [m/s²].
            distances: ‖p_ref − p‖ before the step and after it [m].
            success: whether the robot is at the goal and the reference has ended.
        """
        x, step = estimate.x, (u, *distances, bool(success), self._is_reach, self._ranks)
        kind, priority = barriers.kind, barriers.priority
        if barriers.own:  # only Python can evaluate the barriers of users' own classes
            h = barriers.along(motion.path, motion.times)
            _, sensed = barriers.sense(x[None], np.array([estimate.time]))
            _core.tally_count(h, sensed[0], kind[0], priority[0], x, reference, step, self._array)
        else:
            shapes = kind, barriers.parameters, priority, barriers.atlas.numbers
            path = motion.path, motion.times
            _core.tally_look(*shapes, *path, x, estimate.time, reference, step, self._array)
        array = self._array.copy()
        info = {name: array[place] for name, place in self._infos.items()}
        return StepResult(array[self._observation], float(array[_core.TALLY_REWARD]), info)
