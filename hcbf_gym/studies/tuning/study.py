"""Optuna studies of a `Problem`: the paper's sampling and better ones, resumable and shared.

A study is a list of generations. A generation is asked for as a whole, evaluated as one batch and
told as a whole; the sample of trial k is decided by (seed, k) and the generations before its own.
So a killed run, resumed, asks for the same samples as an unbroken one, and several processes may
work on one storage.
"""

import contextlib
import json
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import optuna
from numpy.typing import NDArray
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.exceptions import UpdateFinishedTrialError
from optuna.samplers import BaseSampler
from optuna.storages import RDBStorage
from optuna.study import Study
from optuna.trial import FrozenTrial, Trial, TrialState

from hcbf_gym.errors import InvalidInputError, choose
from hcbf_gym.evaluation.workers import Backend
from hcbf_gym.studies.tuning.draws import Normal
from hcbf_gym.studies.tuning.problem import Problem

Array = NDArray[np.float64]

WINDOW = (5.0, 2.5)
"""Greatest γ₀ and Δγ that the paper shows (section IV-A), and that TPE and CMA-ES search."""

_EPISODES = 10
"""Longest generation in full physics, where a killed run would lose more than seconds."""
_SETTINGS = "settings"


class NormalSampler(BaseSampler):
    """The paper's plain sampling: trial k gets draw k of the seed, whatever came out before."""

    def __init__(self, normal: Normal, seed: int) -> None:
        self.normal, self.seed = normal, seed

    def infer_relative_search_space(
        self, study: Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        """Return the two weights, which are drawn together."""
        gamma0, delta_gamma = self.normal.upper
        return {
            "gamma0": FloatDistribution(0.0, gamma0),
            "delta_gamma": FloatDistribution(0.0, delta_gamma),
        }

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """Return the draw of the trial's number."""
        draw = self.normal.draw(self.seed, trial.number)
        return {"gamma0": draw.gamma0, "delta_gamma": draw.delta_gamma}

    def sample_independent(
        self,
        study: Study,
        trial: FrozenTrial,
        param_name: str,
        param_distribution: BaseDistribution,
    ) -> Any:
        """Refuse: there is nothing but the two weights."""
        raise InvalidInputError(f"sampler: got {param_name!r}, expected gamma0 or delta_gamma")


class _Kind(NamedTuple):
    """A sampler: how it is made for the next trial, and how many trials are one generation."""

    make: Callable[[Normal, int, int], BaseSampler]
    generation: int
    bounded: bool


def _seed(seed: int, number: int) -> int:
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])


def _tpe(normal: Normal, seed: int, number: int) -> BaseSampler:
    return optuna.samplers.TPESampler(
        seed=_seed(seed, number), multivariate=True, constant_liar=True
    )


def _cmaes(normal: Normal, seed: int, number: int) -> BaseSampler:
    return optuna.samplers.CmaEsSampler(popsize=10, seed=_seed(seed, number))


SAMPLERS = {
    "normal": _Kind(lambda normal, seed, _: NormalSampler(normal, seed), 250, bounded=False),
    "tpe": _Kind(_tpe, 10, bounded=True),
    "cmaes": _Kind(_cmaes, 10, bounded=True),
}
"""The paper's sampling, and Optuna's model-based ones within `WINDOW`."""


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
    """One sampler's study of a problem, in a storage that may hold others.

    Args:
        problem: what the samples cost.
        normal: N(µ, Σ) of the paper's sampling; the others do not read it.
        sampler: a name in `SAMPLERS`.
        seed: of the samples.
        storage: where the study lives: an Optuna storage, the URL of a database, or None for
            the memory of this process.

    Raises:
        UnknownNameError: if there is no such sampler.
    """

    problem: Problem
    normal: Normal
    sampler: str = "normal"
    seed: int = 0
    storage: Any = None

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
        workers: int | None = None,
        backend: Backend = "processes",
        on_done: Callable[[int], None] = lambda done: None,
    ) -> Samples:
        """Bring the study to at least so many samples and return the first of them.

        Args:
            samples: how many, at least 1.
            workers: episodes that run at once, in full physics; None for the backend's CPUs.
            backend: "processes" or "ray".
            on_done: called with the number of samples that are done, again and again.

        Raises:
            InvalidInputError: if `samples` is below 1, or the storage holds another study of the
                same name.
        """
        if samples < 1:
            raise InvalidInputError(f"samples: got {samples}, expected at least 1")
        with _connected(self.storage) as storage:
            return self._extend(self._open(storage), samples, workers, backend, on_done)

    def _extend(
        self,
        study: Study,
        samples: int,
        workers: int | None,
        backend: Backend,
        on_done: Callable[[int], None],
    ) -> Samples:
        """Bring an open study to at least so many samples; see `run`."""
        generation = SAMPLERS[self.sampler].generation
        if not self.problem.batched:
            generation = min(generation, _EPISODES)

        def finish(trials: list[Trial]) -> None:
            """Evaluate trials and tell each as it finishes; another process may have, already."""
            if trials:
                gamma0 = [trial.params["gamma0"] for trial in trials]
                delta_gamma = [trial.params["delta_gamma"] for trial in trials]
                for k, cost in self.problem.costs(gamma0, delta_gamma, workers, backend):
                    # another process may finish the same trial, at the same cost, in between
                    with contextlib.suppress(UpdateFinishedTrialError):
                        study.tell(trials[k].number, cost, skip_if_finished=True)
            on_done(min(samples, len(_trials(study, TrialState.COMPLETE))))

        def ask(size: int) -> list[Trial]:
            """Ask for new trials, as far as samples are missing."""
            missing = samples - len(_trials(study))
            return [self._ask(study) for _ in range(min(size, missing))]

        if left := self._open_trials(study):  # by a killed run: new ones complete its generation
            finish(left + ask(-len(_trials(study)) % generation))
        while trials := ask(generation):
            finish(trials)
        finish(self._open_trials(study))  # by another process that was killed meanwhile
        return self._samples(study, samples)

    def rejected(self, samples: int) -> int:
        """Return how many draws the paper's sampling rejected before its first `samples`."""
        if self.sampler != "normal":
            return 0
        return sum(self.normal.draw(self.seed, number).rejected for number in range(samples))

    def _open(self, storage: Any) -> Study:
        study = optuna.create_study(storage=storage, study_name=self.sampler, load_if_exists=True)
        settings = json.dumps(self.settings(), sort_keys=True, allow_nan=False)
        fresh = not _trials(study)  # asked first: whoever adds a trial has left settings before
        known = study.user_attrs.get(_SETTINGS)
        if known is None and fresh:
            study.set_user_attr(_SETTINGS, settings)
        elif known != settings:
            raise InvalidInputError(
                f"storage: got one whose study {self.sampler!r} has other settings, expected an "
                "empty storage or the same study"
            )
        return study

    def _space(self) -> dict[str, float]:
        upper = WINDOW if SAMPLERS[self.sampler].bounded else self.normal.upper
        return dict(zip(("gamma0", "delta_gamma"), upper, strict=True))

    def _ask(self, study: Study) -> Trial:
        self._reseed(study)
        return study.ask({k: FloatDistribution(0.0, upper) for k, upper in self._space().items()})

    def _open_trials(self, study: Study) -> list[Trial]:
        """Return the unfinished trials, with their weights drawn where that was still to come."""
        trials = []
        for frozen in _trials(study, TrialState.RUNNING):
            self._reseed(study, frozen.number)
            trial = Trial(study, frozen._trial_id)
            for name, upper in self._space().items():
                trial.suggest_float(name, 0.0, upper)
            trials.append(trial)
        return trials

    def _reseed(self, study: Study, number: int | None = None) -> None:
        """Give the study a sampler that depends on nothing but the next trial's number."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            study.sampler = SAMPLERS[self.sampler].make(
                self.normal, self.seed, len(_trials(study)) if number is None else number
            )

    def _samples(self, study: Study, samples: int) -> Samples:
        done = [t for t in _trials(study, TrialState.COMPLETE) if t.number < samples]
        values = [(t.params["gamma0"], t.params["delta_gamma"], t.value) for t in done]
        return Samples(*np.array(values, dtype=np.float64).T)


@contextlib.contextmanager
def _connected(storage: Any) -> Iterator[Any]:
    """Give the storage that Optuna takes; connections that a database's URL opens are closed."""
    if not isinstance(storage, str):
        yield storage
        return
    database = RDBStorage(storage)
    try:
        yield database
    finally:
        database.remove_session()
        database.engine.dispose()


def _trials(study: Study, *states: TrialState) -> list[FrozenTrial]:
    return study.get_trials(deepcopy=False, states=states or None)
