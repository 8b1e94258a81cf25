"""From u* to u for N plants of any model: sample, rows, guidance, program, report."""

from typing import Any

import numpy as np

from hcbf_gym._core import FIRST_ALARM, Reason
from hcbf_gym.arrays import Array, Info, Mask
from hcbf_gym.barriers.layout import LOWEST_RANK
from hcbf_gym.barriers.set import Condition
from hcbf_gym.errors import InvalidInputError, UnreachableError, shown
from hcbf_gym.filter import solvers
from hcbf_gym.filter.bound import NO_ROWS, Bound
from hcbf_gym.filter.causes import cause_of, kind_of, warn_of
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
    """The filter of N plants, behind the wrappers and the filters for loops of one's own.

    A step takes a sample and the barriers, lets guidance lead, makes rows, solves the program and
    reports. `Bound` does most of it in compiled code, or with a solver by name.

    Attributes:
        config: the settings, and what follows from them.
        samples: the latest samples of the plants.
        scenes: the barriers as they are now.
        guide: leads the plants to their goals.
        guides: whether it does, so that they need a goal.
        coverage: whether the promise was tested for each plant.

    Args:
        plant: of the environment.
        input_set: U.
        settings: of the filter, as the user gave them.
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
        self.config = config = FilterConfig(plant, input_set, settings, self.count)
        self.samples = Samples(plant, input_set.n_u, self.count, apart=not config.is_planar)
        self.coverage = EpisodeCoverage(plant, self.count)
        self._bound = Bound(config, self.samples, batch, threads)
        kind = PlanarRows if config.is_planar else ModelRows
        self._rows = kind(config, self.samples, self._bound)
        self.guide = Guide(config, self.samples)
        self.guides = self.guide.guides
        self.scenes = Scenes(config, self.samples, self._rows, self.coverage)
        self._warned: set[object] = {int(Reason.NONE)}  # the reasons that were warned of
        self._m = -1  # there was no scene yet
        self._looks = False  # whether `begin` is to take up what guidance needs, of all plants
        if not callable(plant.barriers):
            self.scenes.take_static(plant.barriers)

    @property
    def lost(self) -> str:
        """Why guidance finds no path to the goal of a plant, the first one; "" where it does."""
        return self.guide.why(np.ones(self.count, dtype=np.bool_))

    @property
    def conditions(self) -> list[Condition]:
        """Name and rank of the conditions of plant 0, in the order of the report's rows."""
        return self.scenes.current.conditions()

    def restart(self, mask: Mask) -> None:
        """Begin new episodes of the masked plants (N,), without what was known of them."""
        self.join(mask)
        self.scenes.placing.forget(mask)
        self.samples.steps[mask] = 0.0
        self._warned.discard(int(Reason.MOVES))

    def join(self, mask: Mask) -> None:
        """Forget the states of the masked plants (N,), whose episodes and clocks continue."""
        self.samples.forget(mask)
        self.scenes.forget(mask)

    def go_on_from(self, other: "FilterCore") -> bool:
        """Let barriers count, and be compared, on from another filter of the same plants.

        Returns:
            Whether the origin is another than it was, so that guidance has to begin again.
        """
        before, self.samples.origin = self.samples.origin, other.samples.origin
        self.scenes.go_on_from(other.scenes)
        self._looks = before.is_decided and bool((before.at != other.samples.origin.at).any())
        return self._looks

    def look_again(self) -> None:
        """Let the next `begin` take up scenes, goals and extents; samples are not forgotten."""
        self._looks = True

    def leave_monitor(self) -> None:
        """Compare no motion: the caller propagates states, and compares its own measurements."""
        self.config.constants["observed"] = False

    def cover(self, covered: object) -> None:
        """Set the coverage of the episodes that begin; see `EpisodeCoverage.begin`."""
        self.coverage.begin(covered, self.samples.fresh)

    def begin(
        self,
        barriers: object,
        estimate: Estimate,
        goal: object,
        extent: object,
        since: float | None = None,
        is_first: bool = True,
    ) -> Info:
        """Take the first states of new episodes, and return the report of a reset.

        The report is that of a step with u* = 0, whose input is not applied and which is undone.

        Args:
            barriers: as the plants' reader returns them.
            estimate: of the plants.
            goal: where guidance leads [m].
            extent: of the world [m]; None if it is not known.
            since: as in `step`.
            is_first: whether a malformed goal or extent is refused; if not, the plants brake.
        """
        self.samples.take(estimate)
        self.scenes.take(barriers, estimate, since, counts=False)
        refusal = self.scenes.refusal
        if isinstance(refusal, InvalidInputError) and not isinstance(refusal, UnreachableError):
            raise refusal  # the plants brake if no input reaches a barrier, or its code fails
        fresh = self.samples.fresh
        begun = fresh | self._looks
        if self.config.is_planar:
            scenes = self.scenes.current
            self.coverage.check_scenes(self.scenes.check(scenes.of(begun)), begun)
            self.guide.begin(scenes, World(goal, extent), begun, is_first)
        fresh[:] = self._looks = False
        snapshot, counted = self._rows.snapshot(), self.samples.steps.copy()
        n_u = self.input_set.n_u
        zero = np.zeros(n_u if self._alone else (self.count, n_u))
        u, report = self.step(zero, barriers, estimate, since, counts=False)
        self._rows.restore(snapshot)
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
        world: World | None = None,
        counts: bool = True,
    ) -> tuple[Array, Info]:
        """Filter u*, and return u with its report.

        Args:
            u_nominal: (n_u,) u* of one plant, or (N, n_u) of a batch.
            barriers: as the plants' reader returns them.
            estimate: of the plants.
            since: the time from which changed shapes count [s]; None is the present.
            world: goal and extent as they are now; None is as they were.
            counts: whether undeclared motion of this step counts; not of one that is undone.
        """
        report = self._bound
        if not self._alone:
            report.renew()  # the user has the memory of the last report
        self.samples.take(estimate)
        self.scenes.take(barriers, estimate, since, counts=counts)
        scene = self.scenes.current
        if self.coverage.is_new or not self._alone:
            self.coverage.write(report.plants)
        if scene.kind.shape[1] != self._m:
            self._m = scene.kind.shape[1]
            report.resize(self._m, self._m + self.guide.has_row)
            self._rows.resize(self._m)
        report.u_nominal[...] = u_nominal
        if self.guides:
            self.guide.lead(scene, report.u_nominal, world)
        own = NO_ROWS
        if scene.own or not self.config.is_planar:
            own = self._rows.make(scene, u_nominal)
        result = report.filter(scene, own)
        if result in (solvers.NOT_FINITE, solvers.MISSHAPED):
            self._refuse(result, u_nominal)
        if estimate.time is None:
            self.samples.steps += 1.0
        if result == solvers.DUE:
            self._brake_and_warn(estimate)
        reported = report.report()
        return reported["u_safe"], reported

    def conflict(self, i: int = 0) -> ConflictReport | None:
        """Return which `conditions` no input of U met together at the last step of plant i.

        It is None if one input met all, or the state of the plant was not accepted.
        """
        if not 0 <= i < self.count:
            raise InvalidInputError(f"i: got {i}, expected a plant from 0 to {self.count - 1}")
        if 0 < self._bound.plants["reason"][i] < FIRST_ALARM:
            return None
        return conflict_of(self._bound, i, None if self.plant.axle else self.input_set)

    def _refuse(self, result: int, u_nominal: Array) -> None:
        """Refuse u* that is not finite, or scenes that are not of these plants."""
        if result == solvers.MISSHAPED:
            raise InvalidInputError(
                f"barriers: got scenes of the shape {self.scenes.current.kind.shape} for "
                f"{self.count} plants, expected one for each, of ranks from 1 to {LOWEST_RANK}"
            )
        bad = ~np.isfinite(np.atleast_2d(u_nominal)).all(axis=1)
        raise InvalidInputError(
            f"action: got {shown(np.atleast_2d(u_nominal)[bad].tolist())} for the plants "
            f"{shown(np.flatnonzero(bad).tolist())}, expected finite numbers"
            if self.count > 1
            else f"action: got {u_nominal.tolist()}, expected finite numbers"
        )

    def _brake_and_warn(self, estimate: Estimate) -> None:
        """Apply the user's own brake, and warn of reasons."""
        reports, rows = self._bound.plants, self._bound.rows
        if self.plant.brake is not None:
            for i in np.flatnonzero(reports["status"] == FilterStatus.BACKUP):
                u = self._users_brake(int(i)).astype(self.config.dtype)
                reports["u_safe"][i] = self.samples.input[i] = u
                reports["intervention"][i] = np.linalg.norm(u - reports["u_nominal"][i])
                rows["slack"][i] = rows["delta"][i] = 0.0
        reasons = reports["reason"].tolist()
        for reason in sorted(set(reasons) - self._warned):
            parts = estimate, self.samples, self.scenes, self.guide
            cause = cause_of(reason, reports["reason"], *parts)
            kind = kind_of(reason, cause)
            if kind not in self._warned:
                self._warned.add(kind)
                warn_of(reason, reasons.count(reason), cause, self.config.brakes_on_alarm)

    def _users_brake(self, i: int) -> Array:
        """Return the input of U nearest the user's brake (n_u,), or nearest 0 if it is invalid."""
        n_u = self.input_set.n_u
        brake: Any = self.plant.brake
        if callable(brake):
            x = self.samples.x[i].copy()
            x[:2] += self.samples.origin.at
            brake = brake(x) if self.samples.plants["known"][i] else None
        u = real_numbers(brake, (n_u,))
        return self.input_set.project(np.zeros(n_u) if u is None else u)
