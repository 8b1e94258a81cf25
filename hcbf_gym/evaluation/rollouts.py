"""Rollouts and what they amount to: episodes, summaries, and the same over many seeds at once."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from hcbf_gym import policies, scenarios, wrappers
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.evaluation.chunks import Runs
from hcbf_gym.evaluation.episode import in_double, samples
from hcbf_gym.evaluation.measures import deadlock_share
from hcbf_gym.policies import Policy
from hcbf_gym.programs import FilterStatus

UNFILTERED = "none"

SHOWN_OPTIONS: dict[str, dict[str, Any]] = {
    "r-cbf-qp": {"gamma0": 0.05},
    "h-cbf-qp": {"gamma0": 5.0, "delta_gamma": 1.3},
}
"""Program options of the evaluation where none are given: R's small weight, H's from the paper."""


@dataclass(frozen=True)
class Episode:
    """What one rollout recorded, k + 1 states and k steps, and how it ended.

    Attributes:
        time: (k + 1,) [s].
        position: (k + 1, 2) of the reduced-order state [m].
        velocity: (k + 1, 2) [m/s].
        h: (k + 1, m) barrier values at the control times.
        min_h: (k + 1, m) their least values over the physics steps before each.
        tracking_error: (k + 1,) ‖p_ref − p‖ [m].
        reward: (k,).
        u_nominal: (k, 2) [m/s²].
        u: (k, 2) what was applied [m/s²].
        slack: (k, m) violation of the filter's rows; zeros without a filter.
        delta: (k, m) the program's own relaxation; zeros without a filter.
        status: (k,) `FilterStatus`; NOMINAL without a filter.
        obstacle_force: (k, n) largest contact force with each box during the step [N].
        priority: (m,) of the barriers; 1 is strict.
        goal_radius: within which the goal counts as reached [m].
        fell: whether the robot fell.
        reached: whether the goal was reached: for "track", within the scenario's goal radius at
            the end.
    """

    time: Array
    position: Array
    velocity: Array
    h: Array
    min_h: Array
    tracking_error: Array
    reward: Array
    u_nominal: Array
    u: Array
    slack: Array
    delta: Array
    status: Integers
    obstacle_force: Array
    priority: Integers
    goal_radius: float
    fell: bool
    reached: bool

    def summary(self) -> dict[str, Any]:
        """Return the figures of the episode as plain numbers and lists.

        `status_counts` is what the filter said; `outside_steps` counts the steps during which the
        true state was in a strict region.
        """
        intervention = np.linalg.norm(self.u - self.u_nominal, axis=1)
        outside = (self.min_h[1:, self.priority == 1] < 0.0).any(axis=1)
        return {
            "min_h": self.min_h.min(axis=0).tolist(),
            "violation_seconds": (CONTROL_DT * (self.h[1:] < 0.0).sum(axis=0)).tolist(),
            "violation_depth": np.maximum(-self.min_h, 0.0).max(axis=0).tolist(),
            "tracking_rms": float(np.sqrt(np.mean(self.tracking_error[1:] ** 2))),
            "final_error": float(self.tracking_error[-1]),
            "return": float(self.reward.sum()),
            "seconds": float(self.time[-1]),
            "fell": self.fell,
            "reached": self.reached,
            "intervention_rms": float(np.sqrt(np.mean(intervention**2))),
            "status_counts": {
                status.name: int((self.status == status).sum()) for status in FilterStatus
            },
            "outside_steps": int(outside.sum()),
            "deadlock_share": deadlock_share(
                self.velocity[1:], self.u_nominal, self.tracking_error[1:], self.goal_radius
            ),
            "max_obstacle_force": float(self.obstacle_force.max(initial=0.0)),
        }


def rollout(env: gym.Env, policy: Policy, seed: int) -> Episode:
    """Run one episode to its end.

    Args:
        env: an environment of this package, filtered or not.
        policy: (obs, info) → u*.
        seed: of the environment.
    """
    inner: Any = env.unwrapped
    observed = [(inner.rom_state, sample) for sample in samples(env, in_double(policy), seed)]
    x = np.array([state for state, _ in observed])
    infos = [sample.info for _, sample in observed]
    taken = [sample for _, sample in observed[1:]]
    info, steps = infos[-1], len(taken)
    m, n_boxes = len(info["h"]), len(info.get("obstacle_force", ()))
    unfiltered = {"slack": np.zeros(m), "delta": np.zeros(m), "status": FilterStatus.NOMINAL}
    records = [
        sample.info.get(
            "safety_filter", unfiltered | {"u_nominal": sample.action, "u_safe": sample.action}
        )
        for sample in taken
    ]
    fell = bool(info.get("fallen", 0.0))
    forces = [step["obstacle_force"] for step in infos[1:]] if n_boxes else np.zeros((steps, 0))
    return Episode(
        time=np.arange(steps + 1) * np.float64(CONTROL_DT),
        position=x[:, :2],
        velocity=x[:, 2:],
        h=np.array([step["h"] for step in infos]),
        min_h=np.array([step["min_h"] for step in infos]),
        tracking_error=np.array([step["tracking_error"] for step in infos]),
        reward=np.array([float(sample.reward) for sample in taken]),
        u_nominal=np.array([record["u_nominal"] for record in records]),
        u=np.array([record["u_safe"] for record in records]),
        slack=np.array([record["slack"] for record in records]),
        delta=np.array([record["delta"] for record in records]),
        status=np.array([record["status"] for record in records], dtype=np.int64),
        obstacle_force=np.array(forces),
        priority=np.array([barrier.priority for barrier in inner.barriers]),
        goal_radius=inner.scenario.goal_radius,
        fell=fell,
        reached=not fell and bool(info["tracking_error"] <= inner.scenario.goal_radius),
    )


@dataclass(frozen=True)
class Case:
    """One cell of an evaluation: an environment, a scene, a policy and a program.

    Args:
        env: one of `ENVIRONMENTS`.
        scenario: what `hcbf_gym.scenarios.make` takes.
        policy: "pd", "pd-ff" (the reference's acceleration fed forward), or a learned policy's
            name or file.
        program: a program's name, or "none".
        options: of the program and the filter.
        env_options: further arguments of the environment.
    """

    env: str
    scenario: Any
    policy: str
    program: str
    options: Mapping[str, Any] | None = None
    env_options: Mapping[str, Any] | None = None

    def make(self, render_mode: str | None = None) -> gym.Env:
        """Return the environment, filtered unless the program is "none".

        Raises:
            UnknownNameError: if the environment or program is not registered.
            InvalidInputError: if an option is refused.
        """
        if self.env not in ENVIRONMENTS:
            raise UnknownNameError(
                f"unknown environment: got {self.env!r}, expected one of {list(ENVIRONMENTS)}"
            )
        env = gym.make(
            self.env,
            scenario=self.scenario,
            render_mode=render_mode,
            **(self.env_options or {}),
        )
        if self.program == UNFILTERED:
            if self.options:
                raise InvalidInputError(
                    f"program 'none': got options {dict(self.options)}, expected none"
                )
            return env
        options = SHOWN_OPTIONS.get(self.program, {}) if self.options is None else self.options
        return wrappers.SafetyFilter(env, program=self.program, **options)

    def run(self, seed: int) -> Episode:
        """Run one episode in a fresh environment."""
        env = self.make()
        try:
            return rollout(env, make_policy(self.policy, env), seed)
        finally:
            env.close()

    def label(self) -> dict[str, Any]:
        """Return the names under which the episode is summarised."""
        scenario = self.scenario
        name = scenario if isinstance(scenario, str) else scenarios.make(scenario).name
        return {
            "env": self.env,
            "scenario": name,
            "policy": self.policy,
            "program": self.program,
        }


ENVIRONMENTS = ("HCBF-A1Regions-v0", "HCBF-Regions-v0", "HCBF-WalkerRegions-v0")


def make_policy(name: str, env: gym.Env) -> Policy:
    """Return a policy by name for an environment.

    Args:
        name: "pd", "pd-ff", or what `hcbf_gym.policies.load` takes.
        env: the environment, which bounds the actions.

    Raises:
        UnknownNameError: if there is no such policy; the message lists those that are.
    """
    if name in ("pd", "pd-ff"):
        return policies.PDTracker.for_env(env, feed_forward=name == "pd-ff")
    return policies.load(name, env)


class Job(NamedTuple):
    """One episode to run: a case and its seed."""

    case: Case
    seed: int = 0

    def run(self) -> Episode:
        """Run it."""
        return self.case.run(self.seed)


def evaluate(
    cases: Sequence[Case],
    seeds: Sequence[int],
    runs: Runs = Runs(),  # noqa: B008 - frozen
    title: str | None = None,
    reads: Sequence[Path] = (),
) -> Iterator[tuple[Case, int, Episode]]:
    """Yield every case's episode for every seed, as they finish.

    Args:
        cases: what to run.
        seeds: one episode each.
        runs: how they run.
        title: of a progress bar; None for no bar.
        reads: files of the user's own that decide the episodes.

    Raises:
        HcbfError: as `chunks.run` does.
    """
    jobs = [Job(case, seed) for case in cases for seed in seeds]
    episodes = runs.over(Job.run, jobs, title, reads)
    return ((jobs[k].case, jobs[k].seed, episode) for k, episode in episodes)


def aggregate(episodes: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return one row per (env, scenario, policy, program) over the seeds.

    Args:
        episodes: summaries with their labels.
    """
    keys = ("env", "scenario", "policy", "program")
    groups: dict[tuple, list[Mapping[str, Any]]] = {}
    for episode in episodes:
        groups.setdefault(tuple(episode[key] for key in keys), []).append(episode)
    rows = []
    for group, members in groups.items():
        least = np.array([member["min_h"] for member in members])
        seconds = np.array([member["violation_seconds"] for member in members])
        row = dict(zip(keys, group, strict=True))
        row |= {
            "episodes": len(members),
            "min_h": least.min(axis=0).tolist(),
            "share_entered": (least < 0.0).mean(axis=0).tolist(),
            "violation_seconds": seconds.mean(axis=0).tolist(),
        }
        for key in ("tracking_rms", "final_error", "return", "intervention_rms", "deadlock_share"):
            row[key] = float(np.mean([member[key] for member in members]))
        for key in ("fell", "reached"):
            row[key] = float(np.mean([member[key] for member in members]))
        row["entered"] = sum(member["outside_steps"] > 0 for member in members)
        row["outside_steps"] = sum(member["outside_steps"] for member in members)
        row["status_counts"] = {
            status.name: sum(member["status_counts"][status.name] for member in members)
            for status in FilterStatus
        }
        rows.append(row)
    return rows
