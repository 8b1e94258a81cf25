"""What the filter around one environment and the filter around N of them share."""

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
from hcbf_gym.errors import InvalidInputError, SafetyWarning, count, floats, instance, warn_caller
from hcbf_gym.filter import certified
from hcbf_gym.filter.core import FilterCore
from hcbf_gym.filter.origin import World
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Coverage, Estimate, Plant
from hcbf_gym.programs import ConflictReport
from hcbf_gym.wrappers.checks import (
    INFO,
    OBSERVATION,
    check_observations,
    check_order,
    check_spaces,
    input_set_of,
    plant_of,
    reads,
)
from hcbf_gym.wrappers.infos import copied

_FLOATS = np.dtype(np.float64), np.dtype(np.float32)


class FilterBase:
    """From an action to the environment's, through the filter of a plant or of a batch.

    Attributes:
        plant: what the filter knows of the environment.
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
        """Check plant and environment, and make the filter."""
        self._inner: Any = self.env.unwrapped
        given = plant_of(self._inner) if plant is None else instance("plant", plant, Plant)
        count("threads", threads)
        one = None if certificate is None else certificates.load(certificate)
        self.plant = plant = given if one is None else certified.certified(given, one, self._inner)
        check_order(self.env)
        check_observations(self.env, plant)
        check_spaces(plant, *spaces)
        input_set = input_set_of(plant, spaces[1])
        self._core = FilterCore(plant, input_set, settings, batch, threads)
        self._dtype = None if plant.to_action is not None else spaces[0].dtype
        if self._dtype is not None:
            self._core.config.applied_as(self._dtype)
        differences = certified.differences_of(given, self._inner)
        self._limits = certified.judge_filter(settings, plant, differences, one)
        self._shape = (input_set.n_u,) if batch is None else (batch, input_set.n_u)
        self._observation: object = None
        self._info: Info = {}
        self._begun = False
        self._reads = "barriers", "state", *(("goal", "extent") if self._core.guides else ())
        self._is_first = True  # no episode has begun yet
        self._raised: set[str] = set()  # the readers that were warned of
        own = callable(plant.covered) and plant.covered not in READERS
        by_certificate = isinstance(plant.covered, certified.CertificateCoverage)
        self._covers_anew = own and not by_certificate and not self._limits
        read_now = plant.barriers, plant.state, plant.goal, plant.extent
        others = [one for one in read_now if callable(one) and one not in READERS]
        others += [plant.covered] * self._covers_anew
        self._copies = {at: any(reads(one, at) for one in others) for at in (OBSERVATION, INFO)}

    @property
    def input_set(self) -> InputSet:
        """U of each plant."""
        return self._core.input_set

    @property
    def conditions(self) -> list[Condition]:
        """Name and rank of the conditions in the order of the report's rows; of plant 0 of N."""
        return self._core.conditions

    @property
    def lost(self) -> str:
        """Why guidance finds no path to the goal of a plant, the first one; "" where it does."""
        return self._core.lost

    def conflict(self, i: int = 0) -> ConflictReport | None:
        """Return which conditions no input met together at the last step, and which ranks pay.

        Args:
            i: which plant of N.

        Returns:
            `rows` are indices of `conditions`; None where there was no conflict, or the state was
            not accepted.
        """
        return self._core.conflict(i)

    def _see(self, observation: object, info: Info) -> None:
        """Note what readers look at before the next action; the caller may change its own."""
        self._observation = copied(observation) if self._copies[OBSERVATION] else observation
        self._info = copied(info) if self._copies[INFO] else info

    def _begin(self, mask: Mask, joins: bool = False) -> Info:
        """Begin the masked episodes (N,), and return the report of their first states."""
        core = self._core
        barriers, state, *world = self._read(*self._reads)
        estimate = state if isinstance(state, Estimate) else Estimate(state)
        if joins and estimate.time is not None:
            core.join(mask)
        else:
            core.restart(mask)
        core.cover(self._limits or self._covered())
        goal, extent = world or (None, None)
        report = core.begin(barriers, estimate, goal, extent, is_first=self._is_first)
        self._is_first = False
        return report

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, Info]:
        """Filter u* and step the environment with the result.

        Raises:
            InvalidInputError: if not all episodes have begun, or u* is not made of finite numbers.
        """
        if not self._begun:
            raise InvalidInputError(
                "safety filter: got a step before a reset that succeeded, expected reset() first"
            )
        plant, core = self.plant, self._core
        u = action if plant.from_action is None else plant.from_action(action)
        if not (type(u) is np.ndarray and u.dtype in _FLOATS and u.shape == self._shape):
            u = floats("action", u, self._shape)
        u_nominal: Array = u.astype(np.float64)
        barriers, state, *world = self._read(*self._reads)
        estimate = state if isinstance(state, Estimate) else Estimate(state)
        if self._covers_anew:
            core.coverage.update(self._covered())
        u, report = core.step(u_nominal, barriers, estimate, world=World(*world) if world else None)
        applied = u.astype(self._dtype) if plant.to_action is None else plant.to_action(u.copy())
        observation, reward, terminated, truncated, info = self.env.step(applied)
        self._see(observation, info)
        self._report(info, report, terminated, truncated)
        return observation, reward, terminated, truncated, info

    def _report(self, info: Info, report: Info, terminated: Any, truncated: Any) -> None:
        """Write the report of a step into the environment's infos."""
        raise NotImplementedError

    def _covered(self) -> Any:
        """Return whether the promise was tested for the episodes that begin."""
        (covered,) = self._read("covered")
        return Coverage.OUTSIDE if covered is None else covered

    def _read(self, *names: str) -> list[Any]:
        """Return fields of the plant as they are now; None, of an extent NaN, where one raises."""
        found = []
        for name in names:
            source: Any = getattr(self.plant, name)
            try:
                if callable(source):
                    source = source(self._inner, self._observation, self._info)
            except Exception as error:  # whatever a user's sensor raises, the robot has to stop
                self._note(name, error)
                source = math.nan if name == "extent" else None
            found.append(source)
        return found

    def _note(self, name: str, error: Exception) -> None:
        """Warn of a reader that raised, once; before anything was filtered its error is raised."""
        if self._is_first:
            error.add_note(f"raised by the plant's reader of the {name}, at the first reset")
            raise error
        if name not in self._raised:
            self._raised.add(name)
            does = "covered is 0" if name == "covered" else "the filter brakes until that ends"
            text = f"safety filter: the reader of the {name} raised {error!r}; {does}"
            warn_caller(text, SafetyWarning)
