"""The base of `SafetyFilter` and `VectorSafetyFilter`: it reads the plant, filters, and steps."""

import math
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from hcbf_gym import certificates
from hcbf_gym.arrays import Array, Info, Mask
from hcbf_gym.barriers.set import Condition
from hcbf_gym.certificates import Certificate
from hcbf_gym.envs.plants import READERS
from hcbf_gym.errors import (
    InvalidInputError,
    SafetyWarning,
    count,
    floats,
    in_words,
    instance,
    shown,
    warn_caller,
)
from hcbf_gym.filter import certified
from hcbf_gym.filter.core import FilterCore
from hcbf_gym.filter.origin import World
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Coverage, Estimate, Plant
from hcbf_gym.programs import ConflictReport
from hcbf_gym.wrappers import checks
from hcbf_gym.wrappers.infos import copied

_FLOATS = np.dtype(np.float64), np.dtype(np.float32)


class FilterBase:
    """Filters the actions of one environment, or of N, and reads their plant.

    Attributes:
        plant: the plant, by which the filter knows the environment.
    """

    plant: Plant
    env: Any

    def _prepare(
        self,
        spaces: tuple[gym.Space, gym.Space],
        plant: Plant | None,
        settings: FilterSettings,
        certificate: str | Path | Certificate | None,
        batch: int | None = None,
        threads: int = 1,
    ) -> None:
        """Check plant and environment, and make the filter, of N plants in a batch.

        The action spaces are those of the environment with its wrappers and without them. The other
        arguments are the wrapper's.
        """
        self._inner: Any = self.env.unwrapped
        given_plant = checks.plant_of(self._inner) if plant is None else plant
        instance("plant", given_plant, Plant)
        count("threads", threads)
        loaded, self.plant = None, given_plant
        if certificate is not None:
            loaded = certificates.load(certificate)
            self.plant = certified.with_certificate(given_plant, loaded, self._inner)
        checks.check_order(self.env)
        checks.check_observations(self.env, self.plant)
        checks.check_spaces(self.plant, *spaces)
        input_set = checks.input_set_of(self.plant, spaces[1])
        self._core = FilterCore(self.plant, input_set, settings, batch, threads)
        self._dtype = None if self.plant.to_action is not None else spaces[0].dtype
        if self._dtype is not None:
            self._core.config.applied_as(self._dtype)
        differences = certified.differences_of(given_plant, self._inner)
        self._limits = certified.judge_filter(settings, self.plant, differences, loaded)
        self._shape = (input_set.n_u,) if batch is None else (batch, input_set.n_u)
        self._observation: object = None
        self._info: Info = {}
        self._begun = False
        guidance_fields = ("goal", "extent") if self._core.guides else ()
        self._step_fields = "barriers", "state", *guidance_fields  # of the plant, read in each step
        self._is_first = True  # no episode has begun yet
        self._warned_readers: set[str] = set()
        self._covers_anew = self._reads_coverage_in_steps()
        self._copies_observation = self._needs_copy(checks.OBSERVATION)
        self._copies_info = self._needs_copy(checks.INFO)

    def _reads_coverage_in_steps(self) -> bool:
        """Return whether the plant's coverage is a user's function, which may change in an episode.

        Limits of the filter's arguments come before it.
        """
        covered = self.plant.covered
        is_users = callable(covered) and covered not in READERS
        is_certificate = isinstance(covered, certified.CertificateCoverage)
        return is_users and not is_certificate and not self._limits

    def _needs_copy(self, position: int) -> bool:
        """Return whether a user's reader may read that argument at the next step.

        Until then the caller may change the observation or the infos that it got.
        """
        plant = self.plant
        readers = [plant.barriers, plant.state, plant.goal, plant.extent]
        readers += [plant.covered] if self._covers_anew else []
        return any(checks.reads(r, position) for r in readers if callable(r) and r not in READERS)

    @property
    def input_set(self) -> InputSet:
        """U of each plant."""
        return self._core.input_set

    @property
    def conditions(self) -> list[Condition]:
        """Name and rank of the conditions in the order of the report's rows; plant 0's of N."""
        return self._core.conditions

    @property
    def lost(self) -> str:
        """Why guidance finds no path to a goal, of the first plant without one; else ""."""
        return self._core.lost

    def conflict(self, i: int = 0) -> ConflictReport | None:
        """Return the conditions that no input satisfied together at the last step, if any.

        It is None where there was no conflict, or the state of plant `i` of N was not accepted. Its
        `rows` are indices of `conditions`.
        """
        return self._core.conflict(i)

    def _see(self, observation: object, info: Info) -> None:
        """Store the data that readers read at the next step, as copies where that is needed."""
        self._observation = copied(observation) if self._copies_observation else observation
        self._info = copied(info) if self._copies_info else info

    def _begin_within_step(self, mask: Mask) -> Info:
        """Begin the masked episodes (N,) that a step has reset; invalid barriers brake them."""
        return self._begin(mask, refuses=False)

    def _begin(self, mask: Mask, joins: bool = False, refuses: bool = True) -> Info:
        """Begin the masked episodes (N,), and return the report of their first states."""
        core = self._core
        barriers, state, *world = self._read(*self._step_fields)
        estimate = state if isinstance(state, Estimate) else Estimate(state)
        if joins and estimate.time is not None:
            core.join(mask)
        else:
            core.restart(mask)
        core.cover(self._limits or self._covered())
        goal, extent = world or (None, None)
        report = core.begin(
            barriers, estimate, goal, extent, is_first=self._is_first, refuses=refuses
        )
        self._is_first = False
        return report

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, Info]:
        """Filter u* and step the environment with the result.

        Raises:
            InvalidInputError: if not all episodes have begun, u* is not made of finite numbers, or
                the plant's `from_action` or `to_action` raises an error. The environment is then
                not stepped.
        """
        if not self._begun:
            raise InvalidInputError(
                "safety filter: got a step before a reset that succeeded, expected reset() first"
            )
        plant, core = self.plant, self._core
        u = action if plant.from_action is None else self._converted("from_action", action)
        if not (type(u) is np.ndarray and u.dtype in _FLOATS and u.shape == self._shape):
            u = floats("action", u, self._shape)
        u_nominal: Array = u.astype(np.float64)
        barriers, state, *world = self._read(*self._step_fields)
        estimate = state if isinstance(state, Estimate) else Estimate(state)
        if self._covers_anew:
            core.coverage.update(self._covered())
        u, report = core.step(u_nominal, barriers, estimate, world=World(*world) if world else None)
        if plant.to_action is None:
            applied = u.astype(self._dtype)
        else:
            applied = self._converted("to_action", u.copy())
        observation, reward, terminated, truncated, info = self.env.step(applied)
        self._see(observation, info)
        self._report(info, report, terminated, truncated)
        return observation, reward, terminated, truncated, info

    def _converted(self, name: str, value: Any) -> Any:
        """Return what the plant's `from_action` or `to_action` makes of an action or of u.

        No input is left to brake with if it raises an error, so that this is an error to the caller
        before the environment is stepped.
        """
        try:
            return getattr(self.plant, name)(value)
        except Exception as error:  # a user's own function may raise anything
            raise InvalidInputError(
                f"plant: {name} raised {in_words(error)} for {shown(value)}, expected a function "
                "that converts every action and every u of U; the environment was not stepped"
            ) from error

    def _report(self, info: Info, report: Info, terminated: Any, truncated: Any) -> None:
        """Write the report of a step into the environment's infos."""
        raise NotImplementedError

    def _covered(self) -> Any:
        """Return the plant's coverage, or OUTSIDE where its reader raised an error."""
        (covered,) = self._read("covered")
        if covered is None:
            return Coverage.OUTSIDE
        try:
            self._core.coverage.check(covered)
        except InvalidInputError as error:  # of a reader that returns no verdict
            self._warn_of_reader("covered", error)
            return Coverage.OUTSIDE
        return covered

    def _read(self, *names: str) -> list[Any]:
        """Return the present values of fields of the plant.

        A reader that raises an error counts as a missing value: None, or NaN as an extent.
        """
        values = []
        for name in names:
            value: Any = getattr(self.plant, name)
            try:
                if callable(value):
                    value = value(self._inner, self._observation, self._info)
            except Exception as error:  # of whatever kind: the robot has to stop
                self._warn_of_reader(name, error)
                value = math.nan if name == "extent" else None
            values.append(value)
        return values

    def _warn_of_reader(self, name: str, error: Exception) -> None:
        """Warn once of a reader that raised; raise its error again before the first episode."""
        if self._is_first:
            error.add_note(f"raised by the plant's reader of the {name}, at the first reset")
            raise error
        if name not in self._warned_readers:
            self._warned_readers.add(name)
            effect = "covered is 0" if name == "covered" else "the filter brakes until that ends"
            message = f"safety filter: the reader of the {name} raised {in_words(error)}; {effect}"
            warn_caller(message, SafetyWarning)
