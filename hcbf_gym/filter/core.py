"""Filters u* into u for N plants of any model: sample, rows, guidance, program, report."""

from typing import Any

import numpy as np

from hcbf_gym._core import FIRST_ALARM, Reason
from hcbf_gym.arrays import Array, Info, Mask
from hcbf_gym.barriers.layout import LOWEST_RANK
from hcbf_gym.barriers.set import Condition
from hcbf_gym.errors import (
    InvalidInputError,
    SafetyWarning,
    UnreachableError,
    in_words,
    shown,
    warn_caller,
)
from hcbf_gym.filter import solvers
from hcbf_gym.filter.bound import NO_ROWS, Bound
from hcbf_gym.filter.causes import CauseFinder, warn_of_reason
from hcbf_gym.filter.configured import FilterConfig
from hcbf_gym.filter.conflict import conflict_of
from hcbf_gym.filter.covering import EpisodeCoverage
from hcbf_gym.filter.guide import Guide
from hcbf_gym.filter.model_rows import ModelRows
from hcbf_gym.filter.origin import World
from hcbf_gym.filter.planar_rows import PlanarRows
from hcbf_gym.filter.samples import Samples, real_numbers
from hcbf_gym.filter.scenes import Scenes
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Estimate, Plant
from hcbf_gym.programs import ConflictReport, FilterStatus


class FilterCore:
    """The filter of N plants, which `SafetyFilter`, `BatchFilter` and `VelocityFilter` call.

    A step takes a sample and the barriers, lets guidance lead, makes rows, solves the program and
    reports. `Bound` does most of it in compiled code.

    Attributes:
        config: the validated settings, and the constants that follow from them.
        guides: whether there is guidance, so that plants need a goal.
        samples, scenes, guide, coverage: the parts of the filter, see their classes.

    Args:
        plant: the model, readers and limits that all N plants share.
        input_set: U.
        settings: the filter's arguments, as the user gave them.
        batch: N of a batch; None for one plant, whose arrays have no leading N.
        threads: how many threads filter parts of a batch at once.

    Raises:
        UnknownNameError: if a name is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range, the hold is too long for α₁ or
            α₂, or barriers that never change cannot be satisfied.
    """

    def __init__(
        self,
        plant: Plant,
        input_set: InputSet,
        settings: FilterSettings,
        batch: int | None = None,
        threads: int = 1,
    ):
        self.plant, self.input_set = plant, input_set
        self._alone, self.count = batch is None, 1 if batch is None else batch
        self.config = config = FilterConfig(plant, input_set, settings, self.count)
        self.samples = Samples(plant, input_set.n_u, self.count, apart=not config.is_planar)
        self.coverage = EpisodeCoverage(plant, self.count)
        self._bound = Bound(config, self.samples, batch, threads)
        rows_class = PlanarRows if config.is_planar else ModelRows
        self._rows = rows_class(config, self.samples, self._bound)
        self.guide = Guide(config, self.samples)
        self.guides = self.guide.guides
        self.scenes = Scenes(config, self.samples, self._rows, self.coverage)
        self._causes = CauseFinder(self.samples, self.scenes, self._rows, self.guide)
        self._warned: set[object] = {int(Reason.NONE)}  # the reasons of earlier warnings
        self._m = -1  # the number of barriers of a scene; there is no scene yet
        self._looks_again = False  # whether `begin` guides all plants anew, not new episodes alone
        if not callable(plant.barriers):
            self.scenes.take_static(plant.barriers)

    @property
    def lost(self) -> str:
        """Why guidance finds no path for the first plant without one; "" if all have a path."""
        return self.guide.why_lost(range(self.count))

    @property
    def conditions(self) -> list[Condition]:
        """Name and rank of the conditions of plant 0, in the order of the report's rows."""
        return self.scenes.current.conditions()

    def restart(self, mask: Mask) -> None:
        """Begin new episodes of the masked plants (N,): forget their states, shapes and steps."""
        self.join(mask)
        self.scenes.placing.forget(mask)
        self.samples.steps[mask] = 0.0
        self._warned.discard(int(Reason.MOVES))

    def join(self, mask: Mask) -> None:
        """Forget the states of the masked plants (N,), whose episodes and clocks continue."""
        self.samples.forget(mask)
        self.scenes.forget(mask)

    def go_on_from(self, other: "FilterCore") -> bool:
        """Continue the times and the comparisons of barriers from another filter of these plants.

        Returns:
            Whether positions count from another origin now, so that guidance has to begin again.
        """
        previous, self.samples.origin = self.samples.origin, other.samples.origin
        self.scenes.go_on_from(other.scenes)
        is_moved = bool((previous.at != other.samples.origin.at).any())
        self._looks_again = previous.is_decided and is_moved
        return self._looks_again

    def look_again(self) -> None:
        """Let guidance find new paths for all plants at the next `begin`; samples are kept."""
        self._looks_again = True

    def leave_monitor(self) -> None:
        """Leave the comparison of predicted with measured motion to the caller."""
        self.config.constants["observed"] = False

    def cover(self, covered: object) -> None:
        """Set whether the episodes that begin are covered; see `EpisodeCoverage.begin`."""
        self.coverage.begin(covered, self.samples.fresh)

    def begin(
        self,
        barriers: object,
        estimate: Estimate,
        goal: object,
        extent: object,
        since: float | None = None,
        is_first: bool = True,
        refuses: bool = True,
    ) -> Info:
        """Take the first states of new episodes, and return the report of a reset.

        The report is that of a step with u* = 0. The step is then undone, as no input is applied.

        Args:
            barriers: as the plants' reader returns them.
            estimate: the first states of the plants.
            goal: (2,) or (N, 2) the position to which guidance leads [m].
            extent: ((x_min, y_min), (x_max, y_max)) of the world [m]; None if it is not known.
            since: as in `step`.
            is_first: whether a malformed goal or extent is refused; if not, the plants brake.
            refuses: whether invalid barriers are refused; if not, as where episodes begin within a
                step, the plants brake.
        """
        self.samples.take(estimate)
        self.scenes.take(barriers, estimate, since, counts=False)
        refusal = self.scenes.refusal
        is_invalid = isinstance(refusal, InvalidInputError)
        if refuses and is_invalid and not isinstance(refusal, UnreachableError):
            raise refusal  # the plants brake if no input reaches a barrier, or its code fails
        begins = self.samples.fresh | self._looks_again
        if self.config.is_planar:
            scenes = self.scenes.current
            if self.scenes.is_refused:
                self.coverage.end_where_changed(begins)  # no scene that was tested
            else:
                self.coverage.check_scenes(self.scenes.check(scenes.of(begins)), begins)
            self.guide.begin(scenes, World(goal, extent), begins, is_first)
        self.samples.fresh[:] = self._looks_again = False
        snapshot, steps = self._rows.snapshot(), self.samples.steps.copy()
        n_u = self.input_set.n_u
        u_nominal = np.zeros(n_u if self._alone else (self.count, n_u))
        u, report = self.step(u_nominal, barriers, estimate, since, counts=False)
        self._rows.restore(snapshot)
        self.samples.steps[:] = steps
        # all lower statuses judge an input, and none is applied yet
        report["status"] = report["status"] * (report["status"] >= FilterStatus.UNSAFE)
        report["u_safe"] = np.zeros_like(u)
        for key in ("slack", "delta", "intervention", "fallbacks"):
            report[key] = np.zeros_like(report[key])[()]
        return report

    def step(
        self,
        u_nominal: Array,
        barriers: object,
        estimate: Estimate,
        since: float | None = None,
        world: World | None = None,
        counts: bool = True,
    ) -> tuple[Array, Info]:
        """Filter u*, and return u with its report.

        Args:
            u_nominal: (n_u,) u* of one plant, or (N, n_u) of a batch.
            barriers: as the plants' reader returns them.
            estimate: the present states of the plants.
            since: the time from which changed shapes count [s]; None is the present.
            world: the present goal and extent; None if they have not changed.
            counts: whether undeclared motion counts; False for a step that is undone.
        """
        bound = self._bound
        if not self._alone:
            bound.renew()  # the user has the memory of the last report
        self.samples.take(estimate)
        self.scenes.take(barriers, estimate, since, counts=counts)
        scenes = self.scenes.current
        if self.coverage.is_new or not self._alone:
            self.coverage.write(bound.plants)
        if scenes.kind.shape[1] != self._m:
            self._m = scenes.kind.shape[1]
            bound.resize(self._m, self._m + self.guide.has_row)
            self._rows.resize(self._m)
        bound.u_nominal[...] = u_nominal
        if self.guides:
            self.guide.lead(scenes, bound.u_nominal, world)
        python_rows = NO_ROWS
        if scenes.own or not self.config.is_planar:
            python_rows = self._rows.make(scenes, u_nominal)
        result = bound.filter(scenes, python_rows)
        if result in (solvers.NOT_FINITE, solvers.MISSHAPED):
            self._refuse(result, u_nominal)
        if estimate.time is None:
            self.samples.steps += 1.0
        if result == solvers.DUE:
            self._brake_and_warn(estimate)
        report = bound.report()
        return report["u_safe"], report

    def conflict(self, i: int = 0) -> ConflictReport | None:
        """Return which `conditions` of plant i no input of U met together at the last step.

        None if one input met all of them, or the plant's state was not accepted.
        """
        if not 0 <= i < self.count:
            raise InvalidInputError(f"i: got {i}, expected a plant from 0 to {self.count - 1}")
        if Reason.NONE < self._bound.plants["reason"][i] < FIRST_ALARM:
            return None
        return conflict_of(self._bound, i, None if self.plant.axle else self.input_set)

    def _refuse(self, result: int, u_nominal: Array) -> None:
        """Refuse u* that is not finite, or scenes that are not of these plants."""
        if result == solvers.MISSHAPED:
            raise InvalidInputError(
                f"barriers: got scenes of the shape {self.scenes.current.kind.shape} for "
                f"{self.count} plants, expected one for each, of ranks from 1 to {LOWEST_RANK}"
            )
        if self.count == 1:
            values = str(u_nominal.tolist())
        else:
            is_bad = ~np.isfinite(u_nominal).all(axis=1)
            plants = np.flatnonzero(is_bad).tolist()
            values = f"{shown(u_nominal[is_bad].tolist())} for the plants {shown(plants)}"
        raise InvalidInputError(f"action: got {values}, expected finite numbers")

    def _brake_and_warn(self, estimate: Estimate) -> None:
        """Apply the user's own brake, and warn of each reason that was not warned of before."""
        reports, rows = self._bound.plants, self._bound.rows
        if self.plant.brake is not None:
            for i in np.flatnonzero(reports["status"] == FilterStatus.BACKUP):
                u = self._own_braking_input(int(i)).astype(self.config.dtype)
                reports["u_safe"][i] = self.samples.input[i] = u
                reports["intervention"][i] = np.linalg.norm(u - reports["u_nominal"][i])
                rows["slack"][i] = rows["delta"][i] = 0.0
        reasons = reports["reason"]
        for code in sorted(set(reasons.tolist()) - self._warned):
            warning = code
            if code == Reason.AGE:  # one warning of each source that is too old, or ahead
                age = self.samples.wrong_age
                warning = (code, age and (age.source, age.age < 0.0))
            if warning not in self._warned:
                self._warned.add(warning)
                reason, plants = Reason(code), reasons == code
                cause = self._causes.find(reason, plants, estimate)
                count = int(plants.sum())
                warn_of_reason(reason, cause, count, self.config.brakes_on_alarm)

    def _own_braking_input(self, i: int) -> Array:
        """Return the input of U nearest to plant i's own brake, or to 0 if that is invalid."""
        n_u = self.input_set.n_u
        brake: Any = self.plant.brake
        if callable(brake):
            x = self.samples.x[i].copy()
            x[:2] += self.samples.origin.at
            try:
                brake = brake(x) if self.samples.plants["known"][i] else None
            except Exception as error:  # a user's own function may raise anything
                brake = None
                if "brake" not in self._warned:
                    self._warned.add("brake")
                    text = f"safety filter: the plant's brake raised {in_words(error)}"
                    warn_caller(f"{text}; it is replaced by the input nearest to 0", SafetyWarning)
        u = real_numbers(brake, (n_u,))
        return self.input_set.project(np.zeros(n_u) if u is None else u)
