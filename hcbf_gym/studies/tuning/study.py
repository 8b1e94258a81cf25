"""Studies of a `Problem`: the paper's sampling, and Optuna's TPE and CMA-ES.

Generations follow from the seed and the costs before, so a study that runs again asks for the same
samples; what these cost is kept in chunks.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.samplers import BaseSampler, CmaEsSampler, TPESampler

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, choose
from hcbf_gym.studies.tuning.draws import Normal
from hcbf_gym.studies.tuning.problem import Problem

WINDOW = {"gamma0": 5.0, "delta_gamma": 2.5}
"""The greatest weights that the paper shows (section IV-A), and that TPE and CMA-ES search."""

SAMPLERS: dict[str, Callable[[int], BaseSampler] | None] = {
    "normal": None,
    "tpe": lambda seed: TPESampler(seed=seed, multivariate=True, constant_liar=True),
    "cmaes": lambda seed: CmaEsSampler(seed=seed, popsize=GENERATION),
}
"""The paper's sampling, whose samples nothing decides but their numbers, and Optuna's own."""

GENERATION, DRAWS = 10, 250
"""Samples of one generation of Optuna's samplers, and of the paper's."""
_WEIGHTS: dict[str, BaseDistribution] = {
    name: FloatDistribution(0.0, upper) for name, upper in WINDOW.items()
}

Costs = Callable[[Array, Array], Sequence[float]]
"""γ₀ (N,) and Δγ (N,) → r of each pair."""


class Samples(NamedTuple):
    """The samples of a study, in the order of their numbers.

    Attributes:
        gamma0: (n,) γ₀.
        delta_gamma: (n,) Δγ.
        cost: (n,) r; infinity where the robot fell.
    """

    gamma0: Array
    delta_gamma: Array
    cost: Array

    @property
    def best(self) -> int:
        """The number of the cheapest sample."""
        return int(np.argmin(self.cost))

    @property
    def offset(self) -> Array:
        """(n,) r_o = r − min r."""
        return self.cost - self.cost.min()


@dataclass(frozen=True)
class TuningStudy:
    """One sampler's study of a problem.

    Args:
        problem: what the samples cost.
        normal: N(µ, Σ) of the paper's sampling; the others do not read it.
        sampler: a name in `SAMPLERS`.
        seed: of the samples.

    Raises:
        UnknownNameError: if there is no such sampler.
    """

    problem: Problem
    normal: Normal
    sampler: str = "normal"
    seed: int = 0

    def __post_init__(self) -> None:
        choose("sampler", self.sampler, SAMPLERS)

    def run(
        self,
        samples: int,
        costs: Costs | None = None,
        on_done: Callable[[int], None] = lambda done: None,
    ) -> Samples:
        """Return so many samples.

        Args:
            samples: how many, at least 1.
            costs: (γ₀, Δγ) → r of N pairs; the problem's own if not given.
            on_done: called with the number of samples that are done, again and again.

        Raises:
            InvalidInputError: if `samples` is below 1.
        """
        if samples < 1:
            raise InvalidInputError(f"samples: got {samples}, expected at least 1")
        make = SAMPLERS[self.sampler]
        size = DRAWS if make is None and self.problem.batched else GENERATION
        found: list[tuple[float, ...]] = []
        trials: list[optuna.Trial] = []
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            study = optuna.create_study()
        while (done := len(found)) < samples:
            on_done(done)
            numbers = range(done, done + min(size, samples - done))
            if make is None:
                pairs = [self.normal.draw(self.seed, number)[:2] for number in numbers]
            else:
                seed = np.random.SeedSequence([self.seed, done]).generate_state(1)[0]
                study.sampler = make(int(seed))
                trials = [study.ask(_WEIGHTS) for _ in numbers]
                pairs = [tuple(trial.params[name] for name in WINDOW) for trial in trials]
            cost = (costs or self.problem.costs)(*np.transpose(pairs))
            for trial, one in zip(trials, cost, strict=False):
                study.tell(trial, one)
            found += [(*pair, one) for pair, one in zip(pairs, cost, strict=True)]
        on_done(samples)
        return Samples(*np.array(found, dtype=np.float64).T)

    def rejected(self, samples: int) -> int:
        """Return how many draws the paper's sampling rejected before its first `samples`."""
        if self.sampler != "normal":
            return 0
        return sum(self.normal.draw(self.seed, number).rejected for number in range(samples))
