"""Whether the filter still gives the inputs that it once gave, along recorded trajectories.

``python -m benchmarks.same_trajectories record FILE`` drives a filtered environment and writes what
the filter was told and what it answered; ``compare FILE`` tells the filter the same again, state by
state, and lists what differs. The reduced-order model is driven anew, too, from the same seeds.
"""

import copy
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym
import numpy as np
import tyro
from numpy.typing import NDArray

from hcbf_gym import programs, wrappers
from hcbf_gym.models.plant import Estimate, Plant
from hcbf_gym.policies import PDTracker

Array = NDArray[np.float64]
Scene = Literal["random", "random-moving", "paper-simulation"]

ANSWERS = {"u_safe": 1e-9, "slack": 1e-9, "status": 0.0}
"""What is compared, and the largest difference that counts as the same."""
DRIVEN_ANEW = 1e-6
"""Largest difference of a state of the reduced-order model that counts as the same."""
REDUCED = "HCBF-Regions-v0"


@dataclass
class Record:
    """Drive an environment and write what the filter was told and what it answered.

    Args:
        file: to write, an npz.
        env: the reduced-order model or the A1.
        scenario: of the episodes.
        trajectories: how many; each program filters every sixth.
        steps: of each trajectory at most.
        seed: of the first.
    """

    file: tyro.conf.Positional[Path]
    env: Literal["HCBF-Regions-v0", "HCBF-A1Regions-v0"] = REDUCED
    scenario: Scene = "random"
    trajectories: int = 100
    steps: int = 1000
    seed: int = 0


@dataclass
class Compare:
    """Tell the filter the same again, and count the answers that differ.

    Args:
        file: what ``record`` wrote.
    """

    file: tyro.conf.Positional[Path]


def main(command: Record | Compare) -> int:
    """Run a command; return 1 if answers differ."""
    if isinstance(command, Record):
        record(command)
        return 0
    return compare(command.file)


def record(command: Record) -> None:
    """Drive an environment and write what the filter was told and what it answered."""
    stored: dict[str, Any] = {}
    for k in range(command.trajectories):
        told, answers = drive(command.env, command.scenario, command.seed + k, command.steps)
        stored |= {f"{k}/told/{name}": values for name, values in told.items()}
        stored |= {f"{k}/{name}": values for name, values in answers.items()}
    about = (command.env, command.scenario, command.seed, command.steps, command.trajectories)
    with command.file.open("wb") as out:
        np.savez(out, about=np.array(about), **stored)


def compare(file: Path) -> int:
    """Tell the filter the same again and print what differs; return 1 if anything does."""
    steps = differ = anew = 0
    largest = dict.fromkeys((*ANSWERS, "x anew"), 0.0)
    with np.load(file) as stored:
        name, scenario, *numbers = stored["about"].tolist()
        seed, most, count = map(int, numbers)
        for k in range(count):
            old = {key: stored[f"{k}/{key}"] for key in (*ANSWERS, "u_nominal")}
            start = f"{k}/told/"
            told = {key[len(start) :]: stored[key] for key in stored if key.startswith(start)}
            new = replay(name, scenario, seed + k, told, old["u_nominal"])
            other = np.zeros(len(old["status"]), dtype=np.bool_)
            for key, tolerance in ANSWERS.items():
                gap = np.abs(new[key] - old[key]).reshape(len(other), -1).max(axis=1, initial=0.0)
                largest[key] = max(largest[key], float(gap.max(initial=0.0)))
                other |= gap > tolerance
            steps, differ = steps + other.size, differ + int(other.sum())
            if name == REDUCED:
                again, _ = drive(name, scenario, seed + k, most)
                same = again["x"].shape == told["x"].shape
                gap = np.abs(again["x"] - told["x"]).max() if same else np.inf
                largest["x anew"] = max(largest["x anew"], float(gap))
                anew += int(gap > DRIVEN_ANEW)
    sizes = ", ".join(f"{key} {gap:.1e}" for key, gap in largest.items())
    print(f"{name}, {scenario}: {differ} of {steps} steps of {count} trajectories differ,")
    print(f"{anew} trajectories of the reduced-order model differ when driven anew; {sizes}")
    return int(differ > 0 or anew > 0)


def drive(name: str, scenario: str, seed: int, steps: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Drive one episode; return what the filter was told, and what it answered.

    The policy tracks the reference; in every other episode it is pushed about besides.
    """
    env, seen = gym.make(name, scenario=scenario), []
    env = _filtered(env, seed, lambda plant: _watched(plant, seen))
    policy, rng = PDTracker.for_env(env), np.random.default_rng([seed, 3])
    observation, info = env.reset(seed=seed)
    push, reports = np.zeros(2), []
    for _ in range(steps):
        push = 0.99 * push + (seed % 2) * rng.normal(0.0, 0.6, 2)
        action = np.clip(policy(observation, info) + push, -5.0, 5.0).astype(np.float32)
        observation, _, terminated, truncated, info = env.step(action)
        reports.append(info["safety_filter"])
        if terminated or truncated:
            break
    told = {
        field: np.array([getattr(estimate, field) for estimate in seen])
        for field in Estimate._fields
        if getattr(seen[0], field) is not None
    }
    return told, {key: _column(reports, key) for key in (*ANSWERS, "u_nominal")}


def replay(
    name: str, scenario: str, seed: int, told: dict[str, Any], u_nominal: Array
) -> dict[str, Array]:
    """Tell the filter of one episode the same again; return what it answers."""
    base = Still(gym.make(name, scenario=scenario))
    env = _filtered(base, seed, lambda plant: _retold(plant, _estimates(told)))
    env.reset(seed=seed)
    reports = [env.step(u)[4]["safety_filter"] for u in u_nominal]
    return {key: _column(reports, key) for key in ANSWERS}


class Still(gym.Wrapper):
    """An environment in which nothing happens after its reset: only its scene is wanted."""

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Do nothing."""
        return None, 0.0, False, False, {}


def _filtered(env: gym.Env, seed: int, change: Any) -> gym.Env:
    """Return an environment under the filter of an episode, its plant changed."""
    inner: Any = env.unwrapped
    names = programs.names()
    return wrappers.SafetyFilter(env, names[seed % len(names)], plant=change(inner.plant))


def _watched(plant: Plant, seen: list[Estimate]) -> Plant:
    """Return a plant whose estimates are noted."""

    def state(*args: Any) -> Estimate:
        said: Any = plant.state(*args)
        estimate = said if isinstance(said, Estimate) else Estimate(said)
        seen.append(copy.deepcopy(estimate))
        return estimate

    return replace(plant, state=state)


def _retold(plant: Plant, estimates: Iterator[Estimate]) -> Plant:
    """Return a plant whose estimates are given."""
    return replace(plant, state=lambda *_: next(estimates))


def _estimates(told: dict[str, Any]) -> Iterator[Estimate]:
    """Yield what the filter was told at each step."""
    for k in range(len(told["x"])):
        yield Estimate(**{field: values[k] for field, values in told.items()})


def _column(reports: list[dict[str, Any]], key: str) -> Array:
    """Return one entry of all reports."""
    return np.array([report[key] for report in reports])


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Record | Compare, description=__doc__)))
