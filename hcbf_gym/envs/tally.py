"""The result of one control step of one robot, counted in one compiled call.

The numbers are those of `task.step_info`, `task.reward_terms` and `task.observe`, which count for N
robots. The core writes them into one array, so that a step copies it once: every entry of its infos
is a view of the copy.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.drive import Motion
from hcbf_gym.envs.task import REWARD_TERMS
from hcbf_gym.models.plant import Estimate
from hcbf_gym.scenarios import Scenario

_NUMBERS = "cost", "tracking_error", "is_success"  # the array's first, before the reward's terms


class Counted(NamedTuple):
    """A step's observation (8 + 4 m,), its reward, and its infos with the reward's terms."""

    observation: Array
    reward: float
    info: Info


class StepTally:
    """Counts the steps of one robot in one scene.

    The array holds `_core.TALLY_HEAD` single numbers, then h, min_h and violation of each barrier,
    the costs of each rank, and the observation.

    Args:
        scenario: the scene; a policy sees its m barriers.
        total: the number of barriers, the environment's own included.
        ranks: R, how many ranks costs have.
    """

    def __init__(self, scenario: Scenario, total: int, ranks: int):
        self._is_reach, self._ranks = scenario.task == "reach", ranks
        sizes = total, total, total, ranks, 8 + 4 * len(scenario.conditions)
        ends = np.cumsum((_core.TALLY_HEAD, *sizes)).tolist()
        *arrays, self._observation = (slice(start, end) for start, end in pairwise(ends))
        self._array = np.zeros(ends[-1])
        terms = enumerate(REWARD_TERMS[scenario.task], _core.TALLY_TERMS)
        self._infos: dict[str, slice | int] = {
            **dict(zip(("h", "min_h", "violation", "costs"), arrays, strict=True)),
            **{name: index for index, name in enumerate(_NUMBERS)},
            **{name: index for index, name in terms},
        }

    def count(
        self,
        scene: BarrierSet,
        motion: Motion,
        estimate: Estimate,
        reference: Array,
        u: Array,
        distances: tuple[float, float],
        success: bool,
    ) -> Counted:
        """Return the result of a step.

        Args:
            scene: the barriers.
            motion: the robot's path in the step.
            estimate: at the end, on which the loop is closed.
            reference: (6,) position, velocity and acceleration at the end.
            u: (2,) the applied acceleration [m/s²].
            distances: ‖p_ref − p‖ before the step and after it [m].
            success: whether the robot is at the goal and the reference has ended.
        """
        x, step = estimate.x, (u, *distances, bool(success), self._is_reach, self._ranks)
        if scene.own:  # only Python can evaluate the barriers of users' own classes
            h = scene.along(motion.path, motion.times)
            _, sensed = scene.sense(x[None], np.array([estimate.time]))
            ranked = scene.kind[0], scene.priority[0]
            _core.tally_count(h, sensed[0], *ranked, x, reference, step, self._array)
        else:
            barriers = scene.kind, scene.parameters, scene.priority, scene.atlas.numbers
            path = motion.path, motion.times
            _core.tally_look(*barriers, *path, x, estimate.time, reference, step, self._array)
        array = self._array.copy()
        info = {name: array[part] for name, part in self._infos.items()}
        return Counted(array[self._observation], float(array[_core.TALLY_REWARD]), info)
