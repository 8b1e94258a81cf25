"""N reduced-order robots in N scenes, stepped together: the core of both ROM environments."""

from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.task import (
    CONTROL_DT,
    PHYSICS_DT,
    SUBSTEPS,
    Ranked,
    answer,
    barriers_of,
    judged,
    observed,
    reference_table,
    reset_info,
    reward_terms,
    step_info,
)
from hcbf_gym.scenarios import Hooks, Moment, Scenario, Scene
from hcbf_gym.scenarios.family import NO_HOOKS
from hcbf_gym.scenarios.scene import write


class BatchStep(NamedTuple):
    """What one step of N environments yields.

    Attributes:
        observation: (N, 8 + 4 m).
        reward_terms: name → (N,), which sum to the reward.
        reached: (N,) bool, whether a "reach" task's goal is reached.
        info: name → (N, …), the reward's terms excepted.
    """

    observation: Array
    reward_terms: dict[str, Array]
    reached: Mask
    info: dict[str, Array]


class References(NamedTuple):
    """What N robots follow, at the control times.

    Attributes:
        tables: (k, T, 6) position [m], velocity [m/s] and acceleration [m/s²].
        of: (N,) which table each robot follows.
        last: (N,) that table's last row; it stays when the reference has ended.
    """

    tables: Array
    of: Integers
    last: Integers


class RegionsBatch:
    """N double integrators, each in its own scene.

    Args:
        scenes: N scenarios of one task and one number of barriers.
        own_references: whether each has a reference table of its own, as `set_scene` needs it;
            False where all scenes are the same until `separate` is called.
        hooks: observation, reward and costs of a family's own.

    Attributes:
        x: (N, 4) positions [m] and velocities [m/s].
        steps: (N,) control steps since each reset.
        barrier_set: the N scenes' barriers, the environment's speed limit last.
    """

    def __init__(
        self, scenes: list[Scenario], own_references: bool = True, hooks: Hooks = NO_HOOKS
    ):
        self.task, self._hooks = scenes[0].task, hooks
        self.n_barriers = len(scenes[0].conditions)
        corners = scenes[0].input_set.vertices()
        self.low, self.high = corners.min(axis=0), corners.max(axis=0)
        self.barrier_set = BarrierSet([barriers_of(s, s.v_max) for s in scenes], is_placed=True)
        self._ranks = int(self.barrier_set.priority.max(initial=1))
        self.x = np.zeros((len(scenes), 4))
        self.steps = np.zeros(len(scenes), dtype=np.int64)
        self._v_max = np.array([np.inf if s.v_max is None else s.v_max for s in scenes])
        self._goal_radius = np.array([s.goal_radius for s in scenes])
        owners = scenes if own_references else scenes[:1]
        tables = np.stack([reference_table(scene) for scene in owners])
        last = np.full(len(scenes), tables.shape[1] - 1)
        self._references = References(tables, np.arange(len(scenes)) % len(owners), last)
        self._start = np.array([s.start for s in scenes])
        self.restart(np.ones(len(scenes), dtype=np.bool_))

    def set_scene(self, i: int, scene: Scenario) -> None:
        """Put another scene of the same kind into environment `i`, which must own its reference."""
        self.barrier_set.set_scene(i, barriers_of(scene, scene.v_max))
        table = reference_table(scene)
        longer = max(0, len(table) - self._references.tables.shape[1])
        tables = np.pad(self._references.tables, ((0, 0), (0, longer), (0, 0)))
        tables[i, : len(table)] = table
        self._references = self._references._replace(tables=tables)
        self._references.last[i] = len(table) - 1
        self._goal_radius[i] = scene.goal_radius
        self._start[i] = scene.start

    def set_drawn(self, i: int, drawn: Scene) -> None:
        """Put another random scene into environment `i`, as `set_scene` does but 50 times faster.

        All scenes must be of one family, so that what is not drawn stays.
        """
        write(drawn, i, self.barrier_set)
        self._references.tables[i, 0, :2] = drawn.goal
        self._start[i] = drawn.start

    def separate(self) -> None:
        """Give each environment a reference table of its own."""
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
        return self.steps * np.float64(CONTROL_DT)

    @property
    def goal(self) -> Array:
        """(N, 2) where the references end [m]."""
        tables, of, last = self._references
        return tables[of, last, :2]

    @property
    def _ranked(self) -> Ranked:
        """What costs are counted by, with as many ranks as at the construction."""
        return Ranked.of(self.barrier_set, self._ranks)

    def look(self) -> tuple[Array, Array, Array, Array]:
        """Return the observation (N, 8 + 4 m), h (N, m), the tracking error (N,), what is sensed.

        The last is (N, m, 4), see `BarrierSet.sense`.
        """
        h, sensed = self.barrier_set.sense(self.x, self.time)
        observation, error = np.empty((len(h), 8 + 4 * self.n_barriers)), np.empty(len(h))
        _core.regions_observe(self._references, self.x, self.steps, sensed, observation, error)
        if self._hooks.observe is not None:
            seen = sensed[:, : self.n_barriers]
            observation = observed(self._hooks, self.x, self._reference(), seen)
        return observation, h, error, sensed

    def _reference(self) -> Array:
        """Return (N, 6) the references' position, velocity and acceleration now."""
        tables, of, last = self._references
        return tables[of, np.minimum(self.steps, last)]

    def reset_infos(self) -> tuple[Array, dict[str, Array]]:
        """Return the observation (N, n) and the infos of a reset."""
        observation, h, error, sensed = self.look()
        info, hooks = reset_info(self.task, h, self._ranked, error, self._hooks), self._hooks
        if hooks.costs is not None:
            seen, still = sensed[:, : self.n_barriers], np.zeros((len(h), 2))
            moment = Moment(self.x, self.x, self._reference(), seen, h, still)
            info["costs"] = answer("costs", hooks.costs(moment), len(h), 2)
        return observation, info

    def step(self, action: Array, restarting: Mask | None = None) -> BatchStep:
        """Advance every environment by one control step under ``u = clip(action, U's bounds)``.

        Args:
            action: (N, 2) accelerations [m/s²].
            restarting: (N,) environments that start a new episode in this step instead, at no
                reward.
        """
        u = np.minimum(np.maximum(action, self.low), self.high)
        scene, hooks = self.barrier_set, self._hooks
        start = self.x.copy() if scene.own or hooks.sees_steps else self.x
        min_h, distance_before = np.empty(scene.kind.shape), np.empty(len(u))
        _core.regions_advance(
            scene.kind, scene.parameters, scene.atlas.numbers, self._references, self.x, self.steps,
            u, self._v_max, min_h, distance_before,
        )  # fmt: skip
        if self.barrier_set.own:
            self._look_at_own(start.copy(), u, min_h)
        self.steps += 1
        if restarting is not None:
            self.restart(restarting)
        observation, h, error, sensed = self.look()
        success = (error <= self._goal_radius) & (self.steps >= self._references.last)
        if restarting is not None:
            success[restarting] = False
            min_h[restarting] = h[restarting]
        reached = success & (self.task == "reach")
        terms = reward_terms(self.task, distance_before, error, reached, u)
        info = step_info(h, min_h, self._ranked, error, success)
        if hooks.sees_steps:
            if restarting is not None:
                start[restarting], u[restarting] = self.x[restarting], 0.0
            seen = sensed[:, : self.n_barriers]
            moment = Moment(start, self.x, self._reference(), seen, min_h, u)
            terms, costs = judged(hooks, moment, terms, info["costs"])
            info["costs"] = costs
        if restarting is not None:
            for term in terms.values():
                term[restarting] = 0.0
        return BatchStep(observation, terms, reached, info)

    def _look_at_own(self, x: Array, u: Array, min_h: Array) -> None:
        """Write the least values of users' own barriers on the way from x (N, 4), in Python."""
        h = np.empty_like(min_h)
        own = tuple(np.array(list(self.barrier_set.own)).T)
        for s in range(SUBSTEPS):
            for i in range(len(x)):
                x[i] = _core.double_integrator_step(x[i], u[i], PHYSICS_DT, self._v_max[i])
            self.barrier_set.write_own_values(x, self.time + (s + 1) * PHYSICS_DT, h)
            min_h[own] = np.minimum(min_h[own], h[own])
