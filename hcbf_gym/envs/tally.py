"""What one control step of one robot came to, counted in one compiled call.

The numbers are those of `task.step_info`, `task.reward_terms` and `task.observe`, which count for N
robots. One memory holds them all: a step copies it once, and every entry of its infos is a part.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Info, Integers
from hcbf_gym.barriers import kernels
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.compilation import borrowed, kernel
from hcbf_gym.envs.drive import Motion
from hcbf_gym.envs.task import (
    GOAL_REWARD,
    REWARD_TERMS,
    effort_cost,
    write_costs,
    write_observation,
)
from hcbf_gym.models.plant import Estimate
from hcbf_gym.scenarios import Scenario

Task = tuple[Array, float, float, bool, bool, int]

_NUMBERS = ("cost", "tracking_error", "is_success")
_HEAD = 7  # of the memory: these, as many reward terms as there may be, and the reward
_REWARD = 6


class Counted(NamedTuple):
    """What came of a step.

    Attributes:
        observation: (8 + 4 m,).
        reward: the sum of its terms.
        info: as `task.first` returns it, the reward's terms included.
    """

    observation: Array
    reward: float
    info: Info


class StepTally:
    """Counts the steps of one robot in one scene.

    Args:
        scenario: the scene; a policy sees its m barriers.
        total: of the barriers, the environment's own included.
        ranks: R, how many ranks the environment tells apart.
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
        """Return what came of a step.

        Args:
            scene: the M barriers.
            motion: where the robot was on the way.
            known: of the robot at the end, on which the loop is closed.
            reference: (6,) position, velocity and acceleration at the end.
            u: (2,) the applied acceleration [m/s²].
            distances: ‖p_ref − p‖ before the step and after it [m].
            success: whether the robot stands at the goal and the reference has ended.
        """
        ranks = self._costs.stop - self._costs.start
        x, task = known.x, (u, *distances, success, self._reaches, ranks)
        if scene.own:
            h = scene.along(motion.path, motion.times)
            _, sensed = scene.sense(x[None], np.array([known.time]))
            ranked = scene.kind[0], scene.priority[0]
            _count(h, sensed[0], ranked, x, reference, task, self._memory)
        else:
            barriers, atlas = (scene.kind, scene.parameters, scene.priority), scene.atlas.numbers
            seen = motion.path, motion.times, x, known.time
            _look(barriers, atlas, seen, reference, task, self._memory)
        memory = self._memory.copy()
        info = {name: memory[part] for name, part in self._parts}
        return Counted(memory[self._seen], float(memory[_REWARD]), info)


@kernel()
def _look(
    barriers: tuple[Integers, Array, Integers],
    atlas: Array | None,
    seen: tuple[Array, Array, Array, float],
    reference: Array,
    task: Task,
    memory: Array,
) -> None:
    """Look at barriers that are all built in, and count."""
    kind, parameters, priority = borrowed(barriers)
    path, times, x, time = borrowed(seen)
    h, last = np.empty((len(path), kind.shape[1])), np.empty(kind.shape)
    sensed = np.empty((*kind.shape, 4))
    kernels.values(kind, parameters, atlas, path, times, h)
    kernels.sense(kind, parameters, atlas, x.reshape(1, 4), np.full(1, time), last, sensed)
    _count(h, sensed[0], (kind[0], priority[0]), x, reference, task, memory)


@kernel()
def _count(
    h: Array,
    sensed: Array,
    ranked: tuple[Integers, Integers],
    x: Array,
    reference: Array,
    task: Task,
    memory: Array,
) -> None:
    """Write what `StepTally` holds.

    Args:
        h: (k, M) barrier values on the way; the last are those at the end.
        sensed: (M, 4) what `BarrierSet.sense` returns at the end.
        ranked: (M,) kinds and (M,) priorities of the barriers.
        x: (4,) position [m] and velocity [m/s] on which the loop is closed.
        reference: as `StepTally.count` takes it.
        task: u, the distances, the success, whether the task is to reach the goal, and R.
        memory: written to.
    """
    h, sensed, x = borrowed(h), borrowed(sensed), borrowed(x)
    reference, memory = borrowed(reference), borrowed(memory)
    u, before, after, success, reaches, ranks = task
    ticks, total = h.shape
    at_end = memory[_HEAD : _HEAD + total]
    least = memory[_HEAD + total : _HEAD + 2 * total]
    at_end[:] = h[ticks - 1]
    least[:] = h[0]
    for i in range(1, ticks):
        for k in range(total):
            least[k] = np.minimum(least[k], h[i, k])
    violation, seen = _HEAD + 2 * total, _HEAD + 3 * total
    for k in range(total):
        memory[violation + k] = max(0.0, -at_end[k])
    cost = write_costs(least, ranked[0], ranked[1], memory[seen : seen + ranks])
    write_observation(x, reference, sensed, memory[seen + ranks :])
    memory[0], memory[1], memory[2] = cost, after, success
    effort = effort_cost(u[0], u[1])
    if reaches:
        memory[3], memory[4], memory[5] = before - after, GOAL_REWARD * success, effort
        memory[_REWARD] = memory[3] + memory[4] + memory[5]
    else:
        memory[3], memory[4] = -after, effort
        memory[_REWARD] = memory[3] + memory[4]
