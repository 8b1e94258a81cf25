"""Optuna studies of a `Problem`: the paper's sampling, and Optuna's TPE and CMA-ES.

A generation of samples is requested, evaluated and recorded as a whole. If a run is killed, the
next one requests the unrecorded generation again.
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
"""The greatest weights in the paper's figures (section IV-A), and for TPE and CMA-ES."""

SAMPLERS: dict[str, Callable[[int], BaseSampler] | None] = {
    "normal": None,
    "tpe": lambda seed: TPESampler(seed=seed, multivariate=True, constant_liar=True),
    "cmaes": lambda seed: CmaEsSampler(seed=seed, popsize=GENERATION),
}
"""The samplers of Optuna, by a seed, and None for the paper's independent draws."""

GENERATION = 10  # samples of one generation of Optuna's samplers, and of episodes that are no batch
DRAWS = 250  # of the paper's sampling in one batch
_SETTINGS = "settings"  # the attribute of a stored study
_WEIGHTS: dict[str, BaseDistribution] = {
    name: FloatDistribution(0.0, upper) for name, upper in WINDOW.items()
}
_ANY_WEIGHTS: dict[str, BaseDistribution] = dict.fromkeys(WINDOW, FloatDistribution(0.0, 1e6))


class Samples(NamedTuple):
    """The n samples of a study, in the order of their numbers."""

    gamma0: Array  # (n,) γ₀
    delta_gamma: Array  # (n,) Δγ
    cost: Array  # (n,) r; infinity where the robot fell

    @property
    def best(self) -> int:
        """The number of the cheapest sample."""
        return int(np.argmin(self.cost))

    @property
    def offset(self) -> Array:
        """The offset (n,) from the least cost, r_o = r − min r."""
        return self.cost - self.cost.min()


@dataclass(frozen=True)
class TuningStudy:
    """One sampler's study of a problem, in a storage that may hold studies of other samplers.

    Raises:
        UnknownNameError: if there is no such sampler.
    """

    problem: Problem  # the cost of a sample
    normal: Normal  # N(µ, Σ) of the paper's sampling; other samplers ignore it
    sampler: str = "normal"  # a name in `SAMPLERS`
    seed: int = 0  # of the samples
    storage: Any = None  # an Optuna storage, or None for the memory of this process

    def __post_init__(self) -> None:
        choose("sampler", self.sampler, SAMPLERS)

    def settings(self) -> dict[str, Any]:
        """Return everything that decides the study, in JSON types."""
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
        """Extend the study to at least this number of samples, and return that many.

        Args:
            samples: their number, at least 1.
            runs: how episodes run that are no batch.
            on_done: called with the number of finished samples after each generation.

        Raises:
            InvalidInputError: if `samples` is below 1, or the storage holds another study of the
                same name.
        """
        if samples < 1:
            raise InvalidInputError(f"samples: got {samples}, expected at least 1")
        is_search = SAMPLERS[self.sampler] is not None
        extend = self._search if is_search else self._draw
        size = DRAWS if self.problem.batched and not is_search else GENERATION
        study = self._load()
        while (done := len(_complete(study))) < samples:
            on_done(done)
            extend(study, done, min(size, samples - done), runs)
        on_done(samples)
        rows = [(*trial.params.values(), trial.value) for trial in _complete(study)[:samples]]
        return Samples(*np.array(rows, dtype=np.float64).T)

    def rejected(self, samples: int) -> int:
        """Return the number of draws that the paper's sampling rejected for its first samples."""
        if self.sampler != "normal":
            return 0
        return sum(self.normal.draw(self.seed, number).rejected for number in range(samples))

    def _draw(self, study: Study, done: int, count: int, runs: Runs) -> None:
        """Add the next `count` draws of the paper's sampling, after the first `done`."""
        draws = [self.normal.draw(self.seed, done + k) for k in range(count)]
        pairs = [{"gamma0": draw.gamma0, "delta_gamma": draw.delta_gamma} for draw in draws]
        costs = self._costs(pairs, runs)
        study.add_trials(
            optuna.trial.create_trial(params=pair, distributions=_ANY_WEIGHTS, value=cost)
            for pair, cost in zip(pairs, costs, strict=True)
        )

    def _search(self, study: Study, done: int, count: int, runs: Runs) -> None:
        """Add a generation of `count` samples by one of Optuna's samplers, after `done` samples.

        The sampler's seed depends on `done`, so that a resumed study has the same samples.
        """
        for killed in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
            study.tell(killed.number, state=TrialState.FAIL, skip_if_finished=True)
        make_sampler = SAMPLERS[self.sampler]
        assert make_sampler is not None
        seed = int(np.random.SeedSequence([self.seed, done]).generate_state(1)[0])
        study.sampler = make_sampler(seed)
        trials = [study.ask(_WEIGHTS) for _ in range(count)]
        costs = self._costs([trial.params for trial in trials], runs)
        for trial, cost in zip(trials, costs, strict=True):
            study.tell(trial, cost)

    def _costs(self, pairs: list[dict[str, float]], runs: Runs) -> list[float]:
        gamma0, delta_gamma = ([pair[name] for pair in pairs] for name in WINDOW)
        return in_order(self.problem.costs(gamma0, delta_gamma, runs))

    def _load(self) -> Study:
        """Return the study from the storage, which keeps a new one."""
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
    """Return the samples with a cost, in the order of their numbers."""
    return study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
