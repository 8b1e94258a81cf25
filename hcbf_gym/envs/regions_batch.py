"""N reduced-order robots in N scenes, stepped together: the core of both ROM environments."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs import task
from hcbf_gym.envs.task import PHYSICS_DT, SUBSTEPS
from hcbf_gym.scenarios import Hooks, Moment, Scenario, Scene
from hcbf_gym.scenarios.scene import write


class BatchStep(NamedTuple):
    """A step of N environments."""

    observation: Array  # (N, n)
    reward: Array  # (N,)
    reached: Mask  # (N,) whether a "reach" task's goal is reached
    info: dict[str, Array]  # name → (N, …), the reward's terms included


class References(NamedTuple):
    """The motions that N robots follow, at the control times."""

    tables: Array  # (k, T, 6) position [m], velocity [m/s] and acceleration [m/s²]
    of: Integers  # (N,) which table each robot follows
    last: Integers  # (N,) that table's last row, which holds from then on


class RegionsBatch:
    """N double integrators, each in its own scene.

    Args:
        scenes: N scenarios of one task and one number of barriers.
        hooks: observation, reward and costs of a family's own.
        own_references: whether each has its own reference table, as `set_scene` needs it;
            False where all scenes are the same until `separate` is called.

    Attributes:
        x: (N, 4) positions [m] and velocities [m/s].
        steps: (N,) control steps since each reset.
        barrier_set: the N scenes' barriers, the environment's speed limit last.
    """

    def __init__(self, scenes: list[Scenario], hooks: Hooks, own_references: bool = True):
        self.task, self._hooks = scenes[0].task, hooks
        self.n_barriers = len(scenes[0].conditions)
        corners = scenes[0].input_set.vertices()
        self.low, self.high = corners.min(axis=0), corners.max(axis=0)
        self.barrier_set = BarrierSet(
            [task.barriers_of(s, s.v_max) for s in scenes], is_placed=True
        )
        self._ranks = int(self.barrier_set.priority.max(initial=1))
        self.x = np.zeros((len(scenes), 4))
        self.steps = np.zeros(len(scenes), dtype=np.int64)
        self._v_max = np.array([np.inf if s.v_max is None else s.v_max for s in scenes])
        self._goal_radius = np.array([s.goal_radius for s in scenes])
        owners = scenes if own_references else scenes[:1]
        tables = np.stack([task.reference_table(scene) for scene in owners])
        last = np.full(len(scenes), tables.shape[1] - 1)
        self._references = References(tables, np.arange(len(scenes)) % len(owners), last)
        self._start = np.array([s.start for s in scenes])
        self.restart(np.ones(len(scenes), dtype=np.bool_))

    def set_scene(self, i: int, scene: Scenario) -> None:
        """Put another scene of the same kind into environment `i`, which must own its reference."""
        self.barrier_set.set_scene(i, task.barriers_of(scene, scene.v_max))
        table = task.reference_table(scene)
        longer = max(0, len(table) - self._references.tables.shape[1])
        tables = np.pad(self._references.tables, ((0, 0), (0, longer), (0, 0)))
        tables[i, : len(table)] = table
        self._references = self._references._replace(tables=tables)
        self._references.last[i] = len(table) - 1
        self._goal_radius[i] = scene.goal_radius
        self._start[i] = scene.start

    def set_drawn(self, i: int, drawn: Scene) -> None:
        """Put another scene of the same family into environment `i`, 50 times as fast."""
        write(drawn, i, self.barrier_set)
        self._references.tables[i, 0, :2] = drawn.goal
        self._start[i] = drawn.start

    def separate(self) -> None:
        """Give each environment its own reference table."""
        tables, of, last = self._references
        self._references = References(tables[of], np.arange(len(self.x)), last)

    def restart(self, mask: Mask) -> None:
        """Put the masked environments (N,) at rest at their starts, time zero."""
        self.x[mask, :2] = self._start[mask]
        self.x[mask, 2:] = 0.0
        self.steps[mask] = 0

    @property
    def time(self) -> Array:
        """(N,) [s] since each reset."""
        return self.steps * np.float64(task.CONTROL_DT)

    @property
    def goal(self) -> Array:
        """(N, 2) where the references end [m]."""
        tables, of, last = self._references
        return tables[of, last, :2]

    def look(self) -> tuple[Array, Array, Array, Array]:
        """Return the observation (N, n), h (N, m), ‖p_ref − p‖ (N,) and `sense`'s (N, m, 4)."""
        h, sensed = self.barrier_set.sense(self.x, self.time)
        observation, error = np.empty((len(h), 8 + 4 * self.n_barriers)), np.empty(len(h))
        _core.regions_observe(self._references, self.x, self.steps, sensed, observation, error)
        if self._hooks.observe is not None:
            seen = sensed[:, : self.n_barriers]
            observation = task.observe(self._hooks, self.x, self._reference(), seen)
        return observation, h, error, sensed

    def _reference(self) -> Array:
        """Return (N, 6) the references' position, velocity and acceleration now."""
        tables, of, last = self._references
        return tables[of, np.minimum(self.steps, last)]

    def _moment(self, x_before: Array, sensed: Array, min_h: Array, u: Array) -> Moment:
        """Return what a family's hooks see of a step, or of a reset."""
        return Moment(x_before, self.x, self._reference(), sensed[:, : self.n_barriers], min_h, u)

    def reset_infos(self) -> tuple[Array, dict[str, Array]]:
        """Return the observation (N, n) and the infos of a reset."""
        observation, h, error, sensed = self.look()
        hooks = self._hooks
        info = task.reset_info(self.task, h, self.barrier_set, self._ranks, error, hooks)
        if hooks.costs is not None:
            moment = self._moment(self.x, sensed, h, np.zeros((len(h), 2)))
            info["costs"] = task.answer("costs", hooks.costs(moment), len(h), 2)
        return observation, info

    def step(
        self,
        action: Array,
        restarting: Mask | None = None,
        between: Callable[[], None] = lambda: None,
    ) -> BatchStep:
        """Advance every environment by one control step under ``u = clip(action, U's bounds)``.

        Args:
            action: (N, 2) accelerations [m/s²].
            restarting: (N,) environments that start a new episode in this step instead, at no
                reward.
            between: called when the robots have moved and before they look, to change scenes.
        """
        u = np.minimum(np.maximum(action, self.low), self.high)
        scene, hooks = self.barrier_set, self._hooks
        # the core advances x in place; users' own barriers and hooks need the states before
        x_before = self.x.copy() if scene.own or hooks.sees_steps else self.x
        min_h, distance_before = np.empty(scene.kind.shape), np.empty(len(u))
        _core.regions_advance(
            scene.kind, scene.parameters, scene.atlas.numbers, self._references, self.x, self.steps,
            u, self._v_max, min_h, distance_before,
        )  # fmt: skip
        if scene.own:
            self._evaluate_own(x_before.copy(), u, min_h)
        self.steps += 1
        if restarting is not None:
            self.restart(restarting)
        between()
        observation, h, error, sensed = self.look()
        success = (error <= self._goal_radius) & (self.steps >= self._references.last)
        if restarting is not None:
            success[restarting] = False
            min_h[restarting] = h[restarting]
        reached = success & (self.task == "reach")
        terms = task.reward_terms(self.task, distance_before, error, reached, u)
        info = task.step_info(h, min_h, scene, self._ranks, error, success)
        if hooks.sees_steps:
            if restarting is not None:
                x_before[restarting], u[restarting] = self.x[restarting], 0.0
            moment = self._moment(x_before, sensed, min_h, u)
            terms, info["costs"] = task.judged(hooks, moment, terms, info["costs"])
        if restarting is not None:
            for term in terms.values():
                term[restarting] = 0.0
        return BatchStep(observation, np.asarray(sum(terms.values())), reached, info | terms)

    def _evaluate_own(self, x: Array, u: Array, min_h: Array) -> None:
        """Write the least values of users' own barriers along the step from x (N, 4), in Python."""
        h = np.empty_like(min_h)
        own = tuple(np.array(list(self.barrier_set.own)).T)
        for s in range(SUBSTEPS):
            for i in range(len(x)):
                x[i] = _core.double_integrator_step(x[i], u[i], PHYSICS_DT, self._v_max[i])
            self.barrier_set.write_own_values(x, self.time + (s + 1) * PHYSICS_DT, h)
            min_h[own] = np.minimum(min_h[own], h[own])
