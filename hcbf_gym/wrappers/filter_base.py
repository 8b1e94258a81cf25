"""What the filter around one environment and the filter around N of them share."""

from pathlib import Path
from typing import Any

import gymnasium as gym

from hcbf_gym import certificates
from hcbf_gym.arrays import Info, Mask
from hcbf_gym.barriers.set import Condition
from hcbf_gym.certificates import Certificate
from hcbf_gym.envs.plants import READERS
from hcbf_gym.errors import InvalidInputError, count, instance
from hcbf_gym.filter.certified import Earned, certified, differs, limits
from hcbf_gym.filter.core import FilterCore
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Plant
from hcbf_gym.programs import ConflictReport
from hcbf_gym.wrappers.checks import (
    INFO,
    OBSERVATION,
    check_observations,
    check_order,
    check_spaces,
    check_type,
    input_set_of,
    plant_of,
    reads,
    real_input,
)
from hcbf_gym.wrappers.readers import Readers, copied


class FilterBase:
    """The way of an action through a plant's filter, for one plant or a batch.

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
        """Look at plant and environment, and make the filter.

        Args:
            spaces: of the actions, outside the environment's wrappers and inside.
            plant: what the filter must know of the environment; None takes what it brings.
            settings: what the user asked.
            certificate: of the plant; None for none.
            batch: N of a batch; None for one plant.
            threads: how many cores filter a batch.

        Raises:
            UnknownNameError: if a name is not known; the message lists the choices.
            InvalidInputError: if an option is unknown or out of range, the environment has no
                plant, or a wrapper inside changes the actions.
        """
        self._inner: Any = self.env.unwrapped
        plant = plant_of(self._inner) if plant is None else instance("plant", plant, Plant)
        count("threads", threads)
        one = None if certificate is None else certificates.load(certificate)
        self.plant = plant if one is None else certified(plant, one, self._inner)
        check_order(self.env)
        check_observations(self.env, self.plant)
        check_spaces(*spaces)
        check_type(self.plant, spaces[0])
        input_set = input_set_of(self.plant, spaces[1])
        self._core = FilterCore(self.plant, input_set, settings, batch, threads)
        self._dtype = None if self.plant.to_action is not None else spaces[0].dtype
        if self._dtype is not None:
            self._core.applied_as(self._dtype)
        self._limits = limits(settings._asdict(), self.plant, differs(plant, self._inner), one)
        self._shape = (input_set.n_u,) if batch is None else (batch, input_set.n_u)
        self._observation: object = None
        self._info: Info = {}
        self._begun = False
        self._is_first = True  # no episode has begun yet
        self._readers = Readers(self.plant, self._core.guides)
        plant = self.plant
        own = callable(plant.covered) and plant.covered not in READERS
        self._covers_anew = own and not isinstance(plant.covered, Earned) and not self._limits
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
        """Note what readers look at before the next action; the caller may change what it has."""
        self._observation = copied(observation) if self._copies[OBSERVATION] else observation
        self._info = copied(info) if self._copies[INFO] else info

    def _begin(self, mask: Mask, joins: bool = False) -> Info:
        """Begin the masked episodes (N,), and return the report of their first states.

        Args:
            mask: which.
            joins: whether the episodes run already; the clock goes on where the plant has one.
        """
        seen, first = (self._inner, self._observation, self._info), self._is_first
        barriers, estimate, world = self._readers(*seen, first=first)
        if joins and estimate.time is not None:
            self._core.join(mask)
        else:
            self._core.restart(mask)
        self._core.cover(self._limits or self._readers.covered(*seen, first=first))
        report = self._core.begin(barriers, estimate, *(world or (None, None)), is_first=first)
        self._is_first = False
        return report

    def _filtered(self, action: Any) -> tuple[Any, Info]:
        """Return what the environment is told in the place of an action, and the report.

        Raises:
            InvalidInputError: if no episode has begun, or u* is not made of finite numbers.
        """
        if not self._begun:
            raise InvalidInputError(
                "safety filter: got a step before a reset that succeeded, expected reset() first"
            )
        plant = self.plant
        wanted = action if plant.from_action is None else plant.from_action(action)
        u_nominal = real_input(wanted, self._shape)
        seen = self._inner, self._observation, self._info
        barriers, estimate, world = self._readers(*seen)
        if self._covers_anew:
            self._core.follow_cover(self._readers.covered(*seen, first=False))
        u, report = self._core.step(u_nominal, barriers, estimate, world=world)
        if plant.to_action is None:
            return u.astype(self._dtype), report
        return plant.to_action(u.copy()), report
