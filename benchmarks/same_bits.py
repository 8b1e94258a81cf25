"""Whether filters report bit for bit what they did at another commit, from the same seeds.

``python benchmarks/same_bits.py record FILE`` drives filtered environments and writes trajectories
and reports; run it with `PYTHONPATH` at each of two checkouts, then ``compare ONE OTHER`` lists
what differs of the keys that both have. It imports nothing of `benchmarks`, so that it runs on any
checkout.
"""

import contextlib
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from numpy.typing import NDArray

import hcbf_gym
from hcbf_gym import models
from hcbf_gym.barriers import Disc, HalfPlane
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.vehicles import KinematicBicycle, Unicycle

with contextlib.suppress(ImportError):  # of a checkout with one package
    import hcbf_robots  # noqa: F401 - registers the walkers

Array = NDArray[np.float64]
PERIOD = 0.05
REGIONS = "HCBF-Regions-v0"


@dataclass
class Record:
    """Drive filtered environments, and write what they did.

    Args:
        file: to write, an npz.
        episodes: of each family of plants and scenes.
        only: the families; all where none is named.
        alpha: gain of α₂ and of speed limits [1/s]; None takes the defaults.
    """

    file: tyro.conf.Positional[Path]
    episodes: int = 100
    only: tuple[str, ...] = ()
    alpha: float | None = None


@dataclass
class Compare:
    """List what differs between two records.

    Args:
        one: of the first checkout.
        other: of the second.
    """

    one: tyro.conf.Positional[Path]
    other: tyro.conf.Positional[Path]


class Own(gym.Env):
    """A plant of any model, which is its model."""

    def __init__(self, model: Any, start: Array):
        self.model, self._start = model, start
        self.action_space = gym.spaces.Box(-1.5, 1.5, (model.n_u,), np.float64)
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (model.n,), np.float64)
        scene = (
            Disc("strict", 1, center=(1.5, 0.3), radius=0.5),
            Disc("soft", 2, center=(0.5, -0.8), radius=0.4),
            HalfPlane("wall", 3, normal=(0.0, 1.0), offset=-2.0),
        )
        self.plant = hcbf_gym.Plant(
            model, scene, lambda env, *_: env.x.copy(), Box.symmetric(1.5, model.n_u), period=PERIOD
        )

    def reset(
        self, *, seed: int | None = None, options: Any = None
    ) -> tuple[Array, dict[str, Any]]:
        """Stand somewhere near the start."""
        super().reset(seed=seed)
        self.x = self._start + self.np_random.uniform(-0.3, 0.3, self._start.size)
        return self.x.copy(), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold an input for one period."""
        self.x = self.model.step(self.x, np.asarray(action, dtype=np.float64), PERIOD)
        return self.x.copy(), 0.0, False, False, {}


def of(env: str, **options: Any) -> Callable[[], gym.Env]:
    """Return what makes a registered environment."""
    return lambda: gym.make(env, **options)


def on_map(name: str) -> Callable[[], gym.Env]:
    """Return what makes the reduced-order model on a map of the tests' data."""
    file = str(Path(os.environ.get("HCBF_DATA", "data")) / "maps" / name)
    return of(REGIONS, scenario={"map": {"file": file}})


GO1 = str(Path(hcbf_gym.__file__).parents[1] / "tests" / "robots" / "contracts" / "go1.json")
"""The contract of the checkout that runs."""

FAMILIES: dict[str, tuple[Callable[[], gym.Env], int]] = {
    "random": (of(REGIONS, scenario="random"), 200),
    "random-moving": (of(REGIONS, scenario="random-moving"), 200),
    "random-clutter": (of(REGIONS, scenario="random-clutter"), 200),
    "paper-simulation": (of(REGIONS, scenario="paper-simulation"), 300),
    "random-map": (of(REGIONS, scenario="random-map"), 100),
    "depot": (on_map("depot.yaml"), 100),
    "a1": (of("HCBF-A1Regions-v0", scenario="paper-simulation"), 40),
    "a1-random": (of("HCBF-A1Regions-v0", scenario="random", estimation="lidar"), 40),
    "cart": (of("HCBF-WalkerRegions-v0", robot="cart", scenario="random"), 100),
    "go1": (of("HCBF-WalkerRegions-v0", robot=GO1, scenario="random"), 40),
    "unicycle": (lambda: Own(Unicycle(), np.array([-0.5, 0.0, 0.0])), 100),
    "bicycle": (lambda: Own(KinematicBicycle(), np.array([-0.5, 0.0, 0.0, 0.5])), 100),
    "single-integrator": (lambda: Own(models.SingleIntegrator(), np.array([-0.5, 0.0])), 100),
}
"""Plants and scenes, and the steps of an episode at most."""
PROGRAMS = ("lex-cbf-qp", "r-cbf-qp", "h-cbf-qp", "ih-cbf-qp", "eh-cbf-qp")


def drive(
    make: Callable[[], gym.Env], steps: int, seed: int, **alphas: Any
) -> Iterator[dict[str, Array]]:
    """Yield what an episode reports at each step, under inputs that are drawn for a while each."""
    program = PROGRAMS[seed % len(PROGRAMS)]
    env = hcbf_gym.wrappers.SafetyFilter(make(), program=program, allow_late_inputs=True, **alphas)
    rng = np.random.default_rng(seed)
    observation, info = env.reset(seed=seed)
    action = np.zeros(env.action_space.shape or ())
    for k in range(steps):
        if k % 10 == 0:
            action = rng.uniform(-5.0, 5.0, action.shape).astype(env.action_space.dtype)
        observation, reward, terminated, truncated, info = env.step(action)
        yield info["safety_filter"] | {"observation": observation, "reward": np.float64(reward)}
        if terminated or truncated:
            break
    env.close()


def record(command: Record) -> None:
    """Write what every family reports."""
    stored: dict[str, Array] = {}
    names = () if command.alpha is None else ("alpha2", "alpha_speed")
    alphas = dict.fromkeys(names, command.alpha)
    for family in command.only or FAMILIES:
        make, steps = FAMILIES[family]
        for seed in range(command.episodes):
            reported = list(drive(make, steps, seed, **alphas))
            for key in reported[0]:
                stored[f"{family}/{seed}/{key}"] = np.array([one[key] for one in reported])
        print(family, command.episodes, flush=True)
    np.savez_compressed(command.file, allow_pickle=False, **stored)


def compare(command: Compare) -> int:
    """Print how many episodes of each family differ, and in what; return 1 if any does."""
    with np.load(command.one) as one, np.load(command.other) as other:
        both = [key for key in one.files if key in other.files]
        alone = sorted({key.rsplit("/", 1)[1] for key in set(one.files) ^ set(other.files)})
        found: dict[str, set[str]] = {}
        parts: dict[str, set[str]] = {}
        worst = 0.0
        for key in both:
            family, seed, name = key.split("/")
            found.setdefault(family, set())
            a, b = one[key], other[key]
            if a.shape != b.shape or a.tobytes() != b.tobytes():
                found[family].add(seed)
                parts.setdefault(family, set()).add(name)
                if a.shape == b.shape:
                    gap = np.abs(np.nan_to_num(a - b)) if a.dtype.kind == "f" else a != b
                    worst = max(worst, float(gap.max()))
    for family, seeds in found.items():
        print(f"{family}: {len(seeds)} episodes differ", *sorted(parts.get(family, ())))
    print(f"keys of one checkout alone: {alone}; greatest difference {worst:g}")
    return int(any(found.values()))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    command = tyro.cli(Record | Compare)
    sys.exit(compare(command) if isinstance(command, Compare) else record(command))
