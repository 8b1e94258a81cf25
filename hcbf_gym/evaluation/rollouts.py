"""Episodes of policies under programs over many seeds, and their figures, averaged over seeds."""

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

UNFILTERED = "none"  # in the place of a program's name, where there is no filter

SHOWN_OPTIONS: dict[str, dict[str, Any]] = {
    "r-cbf-qp": {"gamma0": 0.05},
    "h-cbf-qp": {"gamma0": 5.0, "delta_gamma": 1.3},
}
"""The default weights of evaluations: R's is small, H's are the paper's."""

MEANS = (
    "tracking_rms", "final_error", "return", "intervention_rms", "deadlock_share", "fell", "reached"
)  # fmt: skip
"""The figures of episodes whose mean `aggregate` returns."""


@dataclass(frozen=True)
class Case:
    """An environment, a scene, a policy and a program, which episodes of many seeds share."""

    env: str  # an id of `environments.known()`, or a function as in `own_environment.make`
    scenario: Any  # as `scenarios.make` takes it; ignored with an environment of your own
    policy: str  # as `policies.make` takes it
    program: str  # the name of a program, or "none"
    options: Mapping[str, Any] | None = None  # of the filter; None takes `SHOWN_OPTIONS`
    env_options: Mapping[str, Any] | None = None  # further arguments of the environment
    v_max: float | None = None  # replaces the scene's cap on the speed [m/s]; None leaves it
    steps: int | None = None  # the most steps of an episode; None takes the environment's limit

    def make(self, render_mode: str | None = None, seed: int = 0) -> gym.Env:
        """Return the environment, filtered unless the program is "none".

        The seed draws the scene if it is random and its cap on the speed is replaced.

        Raises:
            UnknownNameError: if the environment or program is not registered.
            InvalidInputError: if an option is refused.
        """
        return self._make_with_plant(render_mode, seed)[0]

    def _make_with_plant(self, render_mode: str | None, seed: int) -> tuple[gym.Env, Plant | None]:
        """Return the environment, and the plant of an environment of the user's own."""
        plant = None
        if loading.is_function(self.env):
            env, plant = own_environment.make(self.env)
        elif self.env not in environments.known():
            raise UnknownNameError(
                f"unknown environment: got {self.env!r}, expected one of "
                f"{list(environments.known())}, file.py:function or module:function"
            )
        else:
            scene, env_options = self._scene(seed), self.env_options or {}
            env = gym.make(self.env, scenario=scene, render_mode=render_mode, **env_options)
        if self.program == UNFILTERED:
            if self.options:
                raise InvalidInputError(
                    f"program 'none': got options {dict(self.options)}, expected none"
                )
            return env, plant
        options = SHOWN_OPTIONS.get(self.program, {}) if self.options is None else self.options
        return wrappers.SafetyFilter(env, program=self.program, plant=plant, **options), plant

    def _scene(self, seed: int) -> Any:
        """Return the scene; if its cap is replaced, a random one has to be drawn here."""
        if self.v_max is None:
            return self.scenario
        drawn = scenarios.make(self.scenario, np.random.default_rng(seed))
        return replace(drawn, v_max=self.v_max)

    def run(self, seed: int) -> Episode:
        """Run one episode in a fresh environment."""
        env, plant = self._make_with_plant(None, seed)
        try:
            return rollout(env, policies.make(self.policy, env), seed, plant, self.steps)
        finally:
            env.close()

    def label(self) -> dict[str, object]:
        """Return the names of environment, scene, policy and program, for summaries."""
        if loading.is_function(self.env):
            scene = "own"
        elif isinstance(self.scenario, str):
            scene = self.scenario
        else:
            scene = scenarios.make(self.scenario).name
        return {"env": self.env, "scenario": scene, "policy": self.policy, "program": self.program}


def shown_program(program: str) -> str:
    """Return the name of a program in tables and figures."""
    return f"{program} (no filter)" if program == UNFILTERED else program


class Job(NamedTuple):
    """One episode to run: a case and its seed."""

    case: Case
    seed: int = 0

    def run(self) -> Episode:
        """Run the episode and return its record."""
        return self.case.run(self.seed)


def evaluate(
    cases: Sequence[Case],
    seeds: Sequence[int],
    runs: Runs = Runs(),  # noqa: B008 - frozen
    title: str | None = None,
    reads: Sequence[Path] = (),
) -> Iterator[tuple[Case, int, Episode]]:
    """Yield every case's episode for every seed, with the case and the seed, as they finish.

    Args:
        cases: the cases, each of which runs with every seed.
        seeds: the seeds.
        runs: where the episodes run, and where they are saved.
        title: the title of a progress bar; None for no bar.
        reads: the user's own files that decide the episodes.

    Raises:
        HcbfError: as `Runs.over` does.
    """
    jobs = [Job(case, seed) for case in cases for seed in seeds]
    own_envs = {case.env for case in cases if loading.is_function(case.env)}
    plant = " ".join(own_environment.plant_hash(env) for env in sorted(own_envs))
    episodes = runs.over(Job.run, jobs, title, reads, plant, repeat=True)
    return ((jobs[k].case, jobs[k].seed, episode) for k, episode in episodes)


def aggregate(episodes: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return one row per (env, scenario, policy, program) over the seeds of labelled summaries.

    `intervals` holds [low, high] of means with the confidence `statistics.INTERVAL`;
    `entered_at_most` the bound on the chance of entering.
    """
    labels = ("env", "scenario", "policy", "program")
    groups: dict[tuple, list[Mapping[str, Any]]] = {}
    for episode in episodes:
        groups.setdefault(tuple(episode[label] for label in labels), []).append(episode)
    return [dict(zip(labels, key, strict=True)) | _row(group) for key, group in groups.items()]


def _row(episodes: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the figures over the summaries of episodes that differ in their seeds alone."""
    n, task = len(episodes), episodes[0]["task"]
    values = {key: [episode[key] for episode in episodes] for key in episodes[0]}
    min_h = np.array(values["min_h"])
    row: dict[str, Any] = {
        "episodes": n,
        "min_h": min_h.min(axis=0).tolist(),
        "share_entered": (min_h < 0.0).mean(axis=0).tolist(),
        "violation_seconds": np.mean(values["violation_seconds"], axis=0).tolist(),
        "relaxed_seconds": _mean_by_key(values["relaxed_seconds"]),
    }
    row |= {key: mean(values[key]) for key in MEANS}
    # an episode of the task "track" ends with its reference, wherever the robot is
    arrived = [e["seconds"] for e in episodes if task != "track" and e["reached"]]
    entered = sum(steps > 0 for steps in values["outside_steps"])
    return row | {
        "task": task,
        "seconds_to_goal": mean(arrived),
        "entered": entered,
        "outside_steps": sum(values["outside_steps"]),
        "intervals": {
            "reached": share_interval(values["reached"]),
            "seconds_to_goal": mean_interval(arrived),
            "return": mean_interval(values["return"]),
            "intervention_rms": mean_interval(values["intervention_rms"]),
        },
        "entered_at_most": upper_bound(entered, n),
        "status_counts": _total_by_key(values["status_counts"]),
    }


def _mean_by_key(mappings: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return key → the mean over mappings, of which one without the key counts as 0."""
    return {key: total / len(mappings) for key, total in sorted(_total_by_key(mappings).items())}


def _total_by_key(mappings: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return key → the sum over mappings, of which one without the key counts as 0."""
    keys = dict.fromkeys(key for mapping in mappings for key in mapping)
    return {key: sum(mapping.get(key, 0) for mapping in mappings) for key in keys}
