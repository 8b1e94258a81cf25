"""The result of one control step of one robot, counted in one compiled call.

The numbers are those of `task.step_info`, `task.reward_terms` and `task.observe`, which count for N
robots. One array holds them all: a step copies it once, and every entry of its infos is a part.
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

_NUMBERS = ("cost", "tracking_error", "is_success")
_HEAD = 7  # of the memory: these, as many reward terms as there may be, and the reward
_REWARD = 6


class Counted(NamedTuple):
    """A step's observation (8 + 4 m,), its reward, and its infos with the reward's terms."""

    observation: Array
    reward: float
    info: Info


class StepTally:
    """Counts the steps of one robot in one scene.

    Args:
        scenario: the scene; a policy sees its m barriers.
        total: of the barriers, the environment's own included.
        ranks: R, how many ranks costs have.
    """

    def __init__(self, scenario: Scenario, total: int, ranks: int):
        self._reaches = scenario.task == "reach"
        ends = [_HEAD + k * total for k in range(4)]
        seen = ends[-1] + ranks
        self._memory = np.zeros(seen + 8 + 4 * len(scenario.conditions))
        self._seen, self._costs = slice(seen, len(self._memory)), slice(ends[-1], seen)
        rows = zip(("h", "min_h", "violation"), ends[:-1], ends[1:], strict=True)
        self._parts: list[tuple[str, slice | int]] = [
            *((name, slice(start, end)) for name, start, end in rows),
            ("costs", self._costs),
            *((name, k) for k, name in enumerate((*_NUMBERS, *REWARD_TERMS[scenario.task]))),
        ]

    def count(
        self,
        scene: BarrierSet,
        motion: Motion,
        known: Estimate,
        reference: Array,
        u: Array,
        distances: tuple[float, float],
        success: bool,
    ) -> Counted:
        """Return the result of a step.

        Args:
            scene: the barriers.
            motion: the robot's path in the step.
            known: the estimate at the end, on which the loop is closed.
            reference: (6,) position, velocity and acceleration at the end.
            u: (2,) the applied acceleration [m/s²].
            distances: ‖p_ref − p‖ before the step and after it [m].
            success: whether the robot is at the goal and the reference has ended.
        """
        ranks = self._costs.stop - self._costs.start
        x, step = known.x, (u, *distances, bool(success), self._reaches, ranks)
        if scene.own:
            h = scene.along(motion.path, motion.times)
            _, sensed = scene.sense(x[None], np.array([known.time]))
            ranked = scene.kind[0], scene.priority[0]
            _core.tally_count(h, sensed[0], *ranked, x, reference, step, self._memory)
        else:
            barriers = scene.kind, scene.parameters, scene.priority, scene.atlas.numbers
            seen = motion.path, motion.times, x, known.time
            _core.tally_look(*barriers, *seen, reference, step, self._memory)
        memory = self._memory.copy()
        info = {name: memory[part] for name, part in self._parts}
        return Counted(memory[self._seen], float(memory[_REWARD]), info)
