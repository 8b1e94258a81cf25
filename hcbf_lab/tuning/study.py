"""Optuna studies of a `Problem`: the paper's sampling, and Optuna's TPE and CMA-ES.

A generation is requested as a whole, evaluated as one batch and recorded as a whole. What a killed
run had not recorded is requested again.
"""

import json
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.samplers import BaseSampler, CmaEsSampler, TPESampler
from optuna.study import Study
from optuna.trial import FrozenTrial, TrialState

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, choose
from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_lab.tuning.draws import Normal
from hcbf_lab.tuning.problem import Problem

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
_SETTINGS = "settings"
_WEIGHTS: dict[str, BaseDistribution] = {
    name: FloatDistribution(0.0, upper) for name, upper in WINDOW.items()
}
_ANY: dict[str, BaseDistribution] = dict.fromkeys(WINDOW, FloatDistribution(0.0, 1e6))


class Samples(NamedTuple):
    """The samples of a study, in the order of their numbers."""

    gamma0: Array  # (n,) γ₀
    delta_gamma: Array  # (n,) Δγ
    cost: Array  # (n,) r; infinity where the robot fell

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
    """One sampler's study of a problem, in a storage that may hold others.

    Raises:
        UnknownNameError: if there is no such sampler.
    """

    problem: Problem  # what the samples cost
    normal: Normal  # N(µ, Σ) of the paper's sampling; the others do not read it
    sampler: str = "normal"  # a name in `SAMPLERS`
    seed: int = 0  # of the samples
    storage: Any = None  # an Optuna storage, or None for the memory of this process

    def __post_init__(self) -> None:
        choose("sampler", self.sampler, SAMPLERS)

    def settings(self) -> dict[str, Any]:
        """Return what decides the study, in JSON types."""
        return {
            "problem": self.problem.settings(),
            "mean": list(self.normal.mean),
            "covariance": [list(row) for row in self.normal.covariance],
            "sampler": self.sampler,
            "seed": self.seed,
        }

    def run(
        self,
        samples: int,
        runs: Runs = Runs(),  # noqa: B008 - frozen
        on_done: Callable[[int], None] = lambda done: None,
    ) -> Samples:
        """Bring the study to at least so many samples and return the first of them.

        Args:
            samples: how many, at least 1.
            runs: how episodes run, in full physics.
            on_done: called with the number of samples that are done, again and again.

        Raises:
            InvalidInputError: if `samples` is below 1, or the storage holds another study of the
                same name.
        """
        if samples < 1:
            raise InvalidInputError(f"samples: got {samples}, expected at least 1")
        extend = self._draw if SAMPLERS[self.sampler] is None else self._search
        size = DRAWS if extend == self._draw and self.problem.batched else GENERATION
        study = self._study()
        while (done := len(_complete(study))) < samples:
            on_done(done)
            extend(study, done, min(size, samples - done), runs)
        on_done(samples)
        found = [(*t.params.values(), t.value) for t in _complete(study)[:samples]]
        return Samples(*np.array(found, dtype=np.float64).T)

    def rejected(self, samples: int) -> int:
        """Return how many draws the paper's sampling rejected before its first `samples`."""
        if self.sampler != "normal":
            return 0
        return sum(self.normal.draw(self.seed, number).rejected for number in range(samples))

    def _draw(self, study: Study, done: int, count: int, runs: Runs) -> None:
        """Add the next draws of the paper's sampling."""
        drawn = [self.normal.draw(self.seed, done + k) for k in range(count)]
        pairs = [{"gamma0": one.gamma0, "delta_gamma": one.delta_gamma} for one in drawn]
        costs = self._costs(pairs, runs)
        study.add_trials(
            optuna.trial.create_trial(params=pair, distributions=_ANY, value=cost)
            for pair, cost in zip(pairs, costs, strict=True)
        )

    def _search(self, study: Study, done: int, count: int, runs: Runs) -> None:
        """Add a generation of one of Optuna's samplers."""
        for left in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
            study.tell(left.number, state=TrialState.FAIL, skip_if_finished=True)
        make = SAMPLERS[self.sampler]
        assert make is not None
        study.sampler = make(int(np.random.SeedSequence([self.seed, done]).generate_state(1)[0]))
        trials = [study.ask(_WEIGHTS) for _ in range(count)]
        costs = self._costs([trial.params for trial in trials], runs)
        for trial, cost in zip(trials, costs, strict=True):
            study.tell(trial, cost)

    def _costs(self, pairs: list[dict[str, float]], runs: Runs) -> list[float]:
        gamma0, delta_gamma = ([pair[name] for pair in pairs] for name in WINDOW)
        return in_order(self.problem.costs(gamma0, delta_gamma, runs))

    def _study(self) -> Study:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            study = optuna.create_study(
                storage=self.storage, study_name=self.sampler, load_if_exists=True
            )
        settings = json.dumps(self.settings(), sort_keys=True, allow_nan=False)
        if study.user_attrs.setdefault(_SETTINGS, settings) != settings:
            raise InvalidInputError(
                f"storage: got one whose study {self.sampler!r} has other settings, expected an "
                "empty storage or the same study"
            )
        study.set_user_attr(_SETTINGS, settings)
        return study


def _complete(study: Study) -> list[FrozenTrial]:
    return study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
