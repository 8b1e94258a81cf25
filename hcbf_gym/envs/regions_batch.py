"""N reduced-order robots in N scenes, stepped together.

`RegionsEnv` steps a batch of one, `RegionsVectorEnv` one of N.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs import task
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
    table_of: Integers  # (N,) the index of the table that each robot follows
    last_row: Integers  # (N,) that table's last row, which the reference holds from then on


class RegionsBatch:
    """N double integrators, each in its own scene.

    Args:
        scenes: N scenarios of one task and one number of barriers.
        hooks: observation, reward and costs of a family's own.
        own_references: whether each robot has its own reference table, which `set_scene` needs;
            False where all scenes are the same until `separate` is called.

    Attributes:
        x: (N, 4) positions [m] and velocities [m/s].
        steps: (N,) control steps since each reset.
        barrier_set: the N scenes' barriers, the environment's speed limit last.
    """

    def __init__(self, scenes: list[Scenario], hooks: Hooks, own_references: bool = True):
        self._task, self._hooks = scenes[0].task, hooks
        self._sensed_barriers = len(scenes[0].conditions)  # m, without the speed limit
        corners = scenes[0].input_set.vertices()
        self._u_min, self._u_max = corners.min(axis=0), corners.max(axis=0)
        self.barrier_set = BarrierSet(
            [task.barriers_of(scene, scene.v_max) for scene in scenes], is_placed=True
        )
        self._ranks = int(self.barrier_set.priority.max(initial=1))
        self.x = np.zeros((len(scenes), 4))
        self.steps = np.zeros(len(scenes), dtype=np.int64)
        self._v_max = np.array([np.inf if s.v_max is None else s.v_max for s in scenes])
        self._goal_radius = np.array([scene.goal_radius for scene in scenes])
        owners = scenes if own_references else scenes[:1]
        tables = np.stack([task.reference_table(scene) for scene in owners])
        last_row = np.full(len(scenes), tables.shape[1] - 1)
        self._references = References(tables, np.arange(len(scenes)) % len(owners), last_row)
        self._start = np.array([scene.start for scene in scenes])
        self.restart(np.ones(len(scenes), dtype=np.bool_))

    def set_scene(self, i: int, scene: Scenario) -> None:
        """Put another scene of the same kind into environment `i`, which must own its reference."""
        self.barrier_set.set_scene(i, task.barriers_of(scene, scene.v_max))
        table = task.reference_table(scene)
        missing_rows = max(0, len(table) - self._references.tables.shape[1])
        tables = np.pad(self._references.tables, ((0, 0), (0, missing_rows), (0, 0)))
        tables[i, : len(table)] = table
        self._references = self._references._replace(tables=tables)
        self._references.last_row[i] = len(table) - 1
        self._goal_radius[i] = scene.goal_radius
        self._start[i] = scene.start

    def set_drawn(self, i: int, drawn: Scene) -> None:
        """Put another scene of the same family into environment `i`, from its arrays.

        It makes no object for a barrier, so that it is 50 times as fast as `set_scene`.
        """
        write(drawn, i, self.barrier_set)
        self._references.tables[i, 0, :2] = drawn.goal
        self._start[i] = drawn.start

    def separate(self) -> None:
        """Give each environment its own reference table."""
        tables, table_of, last_row = self._references
        self._references = References(tables[table_of], np.arange(len(self.x)), last_row)

    def restart(self, mask: Mask) -> None:
        """Put the masked environments (N,) at rest at their starts, time zero."""
        self.x[mask, :2] = self._start[mask]
        self.x[mask, 2:] = 0.0
        self.steps[mask] = 0

    @property
    def time(self) -> Array:
        """(N,) the time since each reset [s]."""
        return self.steps * np.float64(task.CONTROL_DT)

    @property
    def goal(self) -> Array:
        """(N, 2) the points where the references end [m]."""
        tables, table_of, last_row = self._references
        return tables[table_of, last_row, :2]

    def look(self) -> tuple[Array, Array, Array, Array]:
        """Return the observation (N, n), h (N, m), ‖p_ref − p‖ (N,) and `sense`'s (N, m, 4)."""
        h, sensed = self.barrier_set.sense(self.x, self.time)
        observation, error = np.empty((len(h), 8 + 4 * self._sensed_barriers)), np.empty(len(h))
        _core.regions_observe(self._references, self.x, self.steps, sensed, observation, error)
        if self._hooks.observe is not None:
            reference, seen = self._reference(), sensed[:, : self._sensed_barriers]
            observation = task.observe(self._hooks, self.x, reference, seen)
        return observation, h, error, sensed

    def _reference(self) -> Array:
        """Return (N, 6) the references' position, velocity and acceleration now."""
        tables, table_of, last_row = self._references
        return tables[table_of, np.minimum(self.steps, last_row)]

    def _moment(self, x_before: Array, sensed: Array, min_h: Array, u: Array) -> Moment:
        """Return the argument of a family's hooks for a step, or for a reset."""
        seen = sensed[:, : self._sensed_barriers]
        return Moment(x_before, self.x, self._reference(), seen, min_h, u)

    def reset_infos(self) -> tuple[Array, dict[str, Array]]:
        """Return the observation (N, n) and the infos of a reset."""
        observation, h, error, sensed = self.look()
        hooks = self._hooks
        info = task.reset_info(self._task, h, self.barrier_set, self._ranks, error, hooks)
        if hooks.costs is not None:
            moment = self._moment(self.x, sensed, h, np.zeros((len(h), 2)))
            info["costs"] = task.own_costs(hooks.costs, moment)
        return observation, info

    def step(
        self,
        action: Array,
        restarting: Mask | None = None,
        change_scenes: Callable[[], None] = lambda: None,
    ) -> BatchStep:
        """Advance every environment by one control step under ``u = clip(action, U's bounds)``.

        Args:
            action: (N, 2) accelerations [m/s²].
            restarting: (N,) environments that start a new episode in this step instead, at no
                reward; None for none.
            change_scenes: called between the robots' motion and their observation.
        """
        u = np.minimum(np.maximum(action, self._u_min), self._u_max)
        # the core advances x in place; users' own barriers and hooks need the states before
        needs_x_before = self.barrier_set.own or self._hooks.sees_steps
        x_before = self.x.copy() if needs_x_before else self.x
        min_h, distance_before = self._advance(x_before, u)
        if restarting is not None:
            self.restart(restarting)
        change_scenes()
        observation, h, error, sensed = self.look()
        success = (error <= self._goal_radius) & (self.steps >= self._references.last_row)
        if restarting is not None:
            success[restarting] = False
            min_h[restarting] = h[restarting]
        reached = success & (self._task == "reach")
        terms = task.reward_terms(self._task, distance_before, error, reached, u)
        info = task.step_info(h, min_h, self.barrier_set, self._ranks, error, success)
        if self._hooks.sees_steps:
            if restarting is not None:
                x_before[restarting], u[restarting] = self.x[restarting], 0.0
            moment = self._moment(x_before, sensed, min_h, u)
            terms, info["costs"] = task.replaced_by_hooks(self._hooks, moment, terms, info["costs"])
        if restarting is not None:
            for term in terms.values():
                term[restarting] = 0.0
        return BatchStep(observation, np.asarray(sum(terms.values())), reached, info | terms)

    def _advance(self, x_before: Array, u: Array) -> tuple[Array, Array]:
        """Move all robots under u; return the least h (N, m) and the old ‖p_ref − p‖ (N,) [m].

        The core overwrites `x`, so `x_before` is a copy where a barrier is of a user's own class.
        """
        scene = self.barrier_set
        min_h, distance_before = np.empty(scene.kind.shape), np.empty(len(u))
        _core.regions_advance(
            scene.kind, scene.parameters, scene.atlas.numbers, self._references, self.x, self.steps,
            u, self._v_max, min_h, distance_before,
        )  # fmt: skip
        if scene.own:
            self._lower_to_own_barriers(min_h, x_before.copy(), u)
        self.steps += 1
        return min_h, distance_before

    def _lower_to_own_barriers(self, min_h: Array, x: Array, u: Array) -> None:
        """Write the least values of users' own barriers, which only Python can evaluate.

        The states x (N, 4) are those when the step began; they are overwritten.
        """
        h = np.empty_like(min_h)
        own = tuple(np.array(list(self.barrier_set.own)).T)  # their rows and columns
        for substep in range(1, task.SUBSTEPS + 1):
            for i in range(len(x)):
                x[i] = _core.double_integrator_step(x[i], u[i], task.PHYSICS_DT, self._v_max[i])
            self.barrier_set.write_own_values(x, self.time + substep * task.PHYSICS_DT, h)
            min_h[own] = np.minimum(min_h[own], h[own])
