"""From u* to u for N plants of any model: sample, rows, guidance, program, report."""

from collections.abc import Sequence
from copy import copy
from typing import Any

import numpy as np

from hcbf_gym._core import FIRST_ALARM, Reason
from hcbf_gym.arrays import Array, Info, Mask
from hcbf_gym.barriers.layout import LOWEST_RANK
from hcbf_gym.barriers.set import Condition
from hcbf_gym.errors import InvalidInputError, UnreachableError, shown
from hcbf_gym.filter import bound
from hcbf_gym.filter.bound import NO_ROWS, Bound
from hcbf_gym.filter.causes import cause_of, kind_of, warn_of
from hcbf_gym.filter.configured import Configured
from hcbf_gym.filter.conflict import conflict_of
from hcbf_gym.filter.covering import Covering
from hcbf_gym.filter.guide import Guide
from hcbf_gym.filter.model_rows import ModelRows
from hcbf_gym.filter.planar_rows import PlanarRows
from hcbf_gym.filter.samples import Samples, real_numbers
from hcbf_gym.filter.scenes import Scenes
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Estimate, Plant
from hcbf_gym.programs import ConflictReport, FilterStatus


class FilterCore:
    """The filter of N plants: `sample`, `scenes` and `rows`, `guide`, `bound` and `report`.

    A solver by name takes the place of the compiled program alone.

    Attributes:
        made: settings and what follows from them.
        samples: what is known of the plants.
        scenes: the barriers as they are now.
        guide: leads the plants.
        guides: whether it does, so that they need a goal.
        covering: whether the promise was tested.

    Args:
        plant: of the environment.
        input_set: U.
        settings: what the user requests.
        batch: N of a batch; None for one plant, whose arrays have no leading N.
        threads: how many cores filter parts of a batch at once.

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
        self.made = made = Configured(plant, input_set, settings, self.count)
        self.samples = Samples(plant, input_set.n_u, self.count, apart=not made.is_planar)
        self.covering = Covering(plant, self.count)
        self._bound = Bound(made, self.samples, batch, threads)
        kind = PlanarRows if made.is_planar else ModelRows
        self._rows = kind(made, self.samples, self._bound)
        self.guide = Guide(made, self.samples)
        self.guides = self.guide.guides
        self.scenes = Scenes(made, self.samples, self._rows, self.covering)
        self._warned: set[object] = {int(Reason.NONE)}  # the reasons that were warned of
        self._m = -1  # there was no scene yet
        if not callable(plant.barriers):
            self.scenes.take_static(plant.barriers)

    @property
    def lost(self) -> str:
        """Why guidance finds no path to the goal of a plant, the first one; "" where it does."""
        return self.guide.why(np.ones(self.count, dtype=np.bool_))

    @property
    def conditions(self) -> list[Condition]:
        """Name and rank of the conditions of plant 0, in the order of the report's rows."""
        return self.scenes.now.conditions()

    def restart(self, mask: Mask) -> None:
        """Forget what was known of the masked plants (N,): new episodes have begun there."""
        self.join(mask)
        self.scenes.placing.forget(mask)
        self.samples.steps[mask] = 0.0
        self._warned.discard(int(Reason.MOVES))

    def join(self, mask: Mask) -> None:
        """Forget the states of the masked plants (N,), whose episodes and clocks continue."""
        self.samples.forget(mask)
        self.scenes.forget(mask)

    def go_on_from(self, other: "FilterCore") -> None:
        """Let shapes count from when they do in another filter of the same plants."""
        self.scenes.placing = copy(other.scenes.placing)
        self.scenes.placing.is_due = True

    def look_again(self) -> None:
        """Let the next `begin` look at scenes, goals and extents anew; what is known stays."""
        self.samples.fresh[:] = True

    def leave_monitor(self) -> None:
        """Compare nothing: the caller propagates the states and compares its own measurements."""
        self.made.constants["observed"] = False

    def cover(self, covered: object) -> None:
        """Note whether the promise was tested for the episodes that begin; see `Covering.begin`."""
        self.covering.begin(covered, self.samples.fresh)

    def begin(
        self,
        barriers: object,
        estimate: Estimate,
        goal: object,
        extent: object,
        since: float | None = None,
        is_first: bool = True,
    ) -> Info:
        """Look at the first states of new episodes, and return the report of a reset.

        Args:
            barriers: as they are now.
            estimate: of the states.
            goal: where guidance leads [m].
            extent: of the world [m]; None where none is known.
            since: as `step` takes it.
            is_first: whether a malformed goal or extent is refused; if not, the plants brake.
        """
        self.samples.take(estimate)
        self.scenes.take(barriers, estimate, since)
        refusal = self.scenes.refusal
        if isinstance(refusal, InvalidInputError) and not isinstance(refusal, UnreachableError):
            raise refusal  # where no input reaches them, or their code fails, they brake
        fresh = self.samples.fresh
        if self.made.is_planar:
            scenes = self.scenes.now
            self.covering.doubt(self.scenes.check(scenes.of(fresh)), fresh)
            self.guide.begin(scenes, (goal, extent), fresh, is_first)
        fresh[:] = False
        remembered, counted = self._rows.remembered(), self.samples.steps.copy()
        n_u = self.input_set.n_u
        nothing = np.zeros(n_u if self._alone else (self.count, n_u))
        u, report = self.step(nothing, barriers, estimate, since)
        self._rows.restore(remembered)
        self.scenes.is_due = True
        self.samples.steps[:] = counted
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
        world: Sequence[Any] | None = None,
    ) -> tuple[Array, Info]:
        """Filter u* (n_u,) or (N, n_u), and return u with the report of it.

        Args:
            u_nominal: u*.
            barriers: as the plants' reader returns them.
            estimate: of the plants.
            since: the time from which shapes count that are others than before [s]; None is the
                present.
            world: goal and extent as they are now [m]; None is as they were.
        """
        report = self._bound
        if not self._alone:
            report.renew()  # the user has the memory of the last report
        self.samples.take(estimate)
        self.scenes.take(barriers, estimate, since)
        scene = self.scenes.now
        if self.covering.is_new or not self._alone:
            self.covering.write(report.plants)
        if scene.kind.shape[1] != self._m:
            self._m = scene.kind.shape[1]
            report.widen(self._m, self._m + self.guide.has_row)
            self._rows.widen(self._m)
        report.u_nominal[...] = u_nominal
        if self.guides:
            self.guide.lead(scene, report.u_nominal, world)
        own = NO_ROWS
        if scene.own or not self.made.is_planar:
            own = self._rows.make(scene, u_nominal)
        answer = report.filter(scene, own)
        if answer in (bound.NOT_FINITE, bound.MISSHAPED):
            self._refuse(answer, u_nominal)
        if estimate.time is None:
            self.samples.steps += 1.0
        if answer == bound.ASKS:
            self._finish(estimate)
        found = report.report()
        return found["u_safe"], found

    def conflict(self, i: int = 0) -> ConflictReport | None:
        """Return which `conditions` no input of U met together at the last step of plant i.

        None where one input met all, or the state of the plant was not accepted.
        """
        if not 0 <= i < self.count:
            raise InvalidInputError(f"i: got {i}, expected a plant from 0 to {self.count - 1}")
        if 0 < self._bound.plants["reason"][i] < FIRST_ALARM:
            return None
        return conflict_of(self._bound, i, None if self.plant.axle else self.input_set)

    def _refuse(self, answer: int, u_nominal: Array) -> None:
        """Refuse u* that is not finite, or scenes that are not of these plants."""
        if answer == bound.MISSHAPED:
            raise InvalidInputError(
                f"barriers: got scenes of the shape {self.scenes.now.kind.shape} for {self.count} "
                f"plants, expected one for each, of ranks from 1 to {LOWEST_RANK}"
            )
        bad = ~np.isfinite(np.atleast_2d(u_nominal)).all(axis=1)
        raise InvalidInputError(
            f"action: got {shown(np.atleast_2d(u_nominal)[bad].tolist())} for the plants "
            f"{shown(np.flatnonzero(bad).tolist())}, expected finite numbers"
            if self.count > 1
            else f"action: got {u_nominal.tolist()}, expected finite numbers"
        )

    def _finish(self, estimate: Estimate) -> None:
        """Brake as the user requests, and warn."""
        found, rows = self._bound.plants, self._bound.rows
        if self.plant.brake is not None:
            for i in np.flatnonzero(found["status"] == FilterStatus.BACKUP):
                u = self._users_brake(int(i)).astype(self.made.dtype)
                found["u_safe"][i] = self.samples.input[i] = u
                found["intervention"][i] = np.linalg.norm(u - found["u_nominal"][i])
                rows["slack"][i] = rows["delta"][i] = 0.0
        reasons = found["reason"].tolist()
        for reason in sorted(set(reasons) - self._warned):
            known = estimate, self.samples, self.scenes, self.guide
            cause = cause_of(reason, found["reason"], *known)
            kind = kind_of(reason, cause)
            if kind not in self._warned:
                self._warned.add(kind)
                warn_of(reason, reasons.count(reason), cause, self.made.brakes_on_alarm)

    def _users_brake(self, i: int) -> Array:
        """Return the input of U nearest the user's own; nearest 0 where that reads a state."""
        n_u = self.input_set.n_u
        brake: Any = self.plant.brake
        if callable(brake):
            x = self.samples.x[i].copy()
            x[:2] += self.samples.origin.at
            brake = brake(x) if self.samples.plants["known"][i] else None
        u = real_numbers(brake, (n_u,))
        return self.input_set.project(np.zeros(n_u) if u is None else u)
