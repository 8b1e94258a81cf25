"""Policies under programs over many seeds at once, and what the episodes amount to."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from hcbf_gym import loading, policies, scenarios, wrappers
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.evaluation import environments, own_environment
from hcbf_gym.evaluation.jobs import Runs
from hcbf_gym.evaluation.recorded import Episode, rollout
from hcbf_gym.evaluation.statistics import mean, mean_interval, share_interval, upper_bound
from hcbf_gym.models.plant import Plant
from hcbf_gym.programs import FilterStatus

UNFILTERED = "none"
"""The name of no filter, in a program's place."""

SHOWN_OPTIONS: dict[str, dict[str, Any]] = {
    "r-cbf-qp": {"gamma0": 0.05},
    "h-cbf-qp": {"gamma0": 5.0, "delta_gamma": 1.3},
}
"""Program options of the evaluation where none are given: R's small weight, H's from the paper."""


MEANS = (
    "tracking_rms", "final_error", "return", "intervention_rms", "deadlock_share", "fell", "reached"
)  # fmt: skip
"""Figures of a summary of which a row has the mean."""


@dataclass(frozen=True)
class Case:
    """One cell of an evaluation: an environment, a scene, a policy and a program."""

    # an id of `environments.known()`, or ``file.py:function`` or ``module:function`` that returns
    # (environment, plant)
    env: str
    scenario: Any  # what `hcbf_gym.scenarios.make` takes; not read with an environment of your own
    policy: str  # as `policies.make` takes it
    program: str  # a program's name, or "none"
    options: Mapping[str, Any] | None = None  # of the program and the filter
    env_options: Mapping[str, Any] | None = None  # further arguments of the environment
    v_max: float | None = None  # cap on the speed [m/s] in the scene's place; None leaves it
    # the most that an episode takes; None for as many as the environment does
    steps: int | None = None

    def make(self, render_mode: str | None = None, seed: int = 0) -> gym.Env:
        """Return the environment, filtered unless the program is "none".

        The seed draws a random scene whose cap on the speed is replaced.

        Raises:
            UnknownNameError: if the environment or program is not registered.
            InvalidInputError: if an option is refused.
        """
        return self._made(render_mode, seed)[0]

    def _made(self, render_mode: str | None, seed: int) -> tuple[gym.Env, Plant | None]:
        """Return the environment, and the plant where it is the user's own."""
        plant = None
        if loading.is_function(self.env):
            env, plant = own_environment.make(self.env)
        elif self.env not in environments.known():
            raise UnknownNameError(
                f"unknown environment: got {self.env!r}, expected one of "
                f"{list(environments.known())}, file.py:function or module:function"
            )
        else:
            env = gym.make(
                self.env,
                scenario=self._scene(seed),
                render_mode=render_mode,
                **(self.env_options or {}),
            )
        if self.program == UNFILTERED:
            if self.options:
                raise InvalidInputError(
                    f"program 'none': got options {dict(self.options)}, expected none"
                )
            return env, plant
        options = SHOWN_OPTIONS.get(self.program, {}) if self.options is None else self.options
        return wrappers.SafetyFilter(env, program=self.program, plant=plant, **options), plant

    def _scene(self, seed: int) -> Any:
        """Return the scene, which a seed draws where its cap is another and it is random."""
        if self.v_max is None:
            return self.scenario
        drawn = scenarios.make(self.scenario, np.random.default_rng(seed))
        return replace(drawn, v_max=self.v_max)

    def run(self, seed: int) -> Episode:
        """Run one episode in a fresh environment."""
        env, plant = self._made(None, seed)
        try:
            return rollout(env, policies.make(self.policy, env), seed, plant, self.steps)
        finally:
            env.close()

    def label(self) -> dict[str, object]:
        """Return the names under which the episode is summarised."""
        return {
            "env": self.env,
            "scenario": self._scene_name(),
            "policy": self.policy,
            "program": self.program,
        }

    def _scene_name(self) -> str:
        if loading.is_function(self.env):
            return "own"
        scene = self.scenario
        return scene if isinstance(scene, str) else scenarios.make(scene).name


def shown_program(program: str) -> str:
    """Return a program as tables and figures name it."""
    return f"{program} (no filter)" if program == UNFILTERED else program


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
        HcbfError: as `Runs.over` does.
    """
    jobs = [Job(case, seed) for case in cases for seed in seeds]
    own = {case.env for case in cases if loading.is_function(case.env)}
    plant = " ".join(own_environment.identity(env) for env in sorted(own))
    episodes = runs.over(Job.run, jobs, title, reads, plant, repeat=True)
    return ((jobs[k].case, jobs[k].seed, episode) for k, episode in episodes)


def aggregate(episodes: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return one row per (env, scenario, policy, program) over the seeds of labelled summaries.

    `intervals` holds [low, high] of means with the confidence `statistics.INTERVAL`;
    `entered_at_most` the bound on the chance of entering.
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
            "relaxed_seconds": _mean_of_each([member["relaxed_seconds"] for member in members]),
        }
        for key in MEANS:
            row[key] = mean([member[key] for member in members])
        row["task"] = members[0]["task"]
        ends = row["task"] != "track"  # which lasts as long as its reference, wherever the robot is
        arrived = [member["seconds"] for member in members if ends and member["reached"]]
        row["seconds_to_goal"] = mean(arrived)
        row["entered"] = sum(member["outside_steps"] > 0 for member in members)
        row["outside_steps"] = sum(member["outside_steps"] for member in members)
        row["intervals"] = {
            "reached": share_interval([member["reached"] for member in members]),
            "seconds_to_goal": mean_interval(arrived),
            "return": mean_interval([member["return"] for member in members]),
            "intervention_rms": mean_interval([member["intervention_rms"] for member in members]),
        }
        row["entered_at_most"] = upper_bound(row["entered"], len(members))
        row["status_counts"] = {
            status.name: sum(member["status_counts"][status.name] for member in members)
            for status in FilterStatus
        }
        rows.append(row)
    return rows


def _mean_of_each(members: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return key → the mean of members, of which one without the key counts as 0."""
    keys = sorted({key for member in members for key in member})
    return {key: sum(member.get(key, 0.0) for member in members) / len(members) for key in keys}
