"""What stands between u* and u: the filter of N plants, whatever their model.

`planar_core` and `model_core` say how rows come about; all that is believed, decided and said of a
step stands here and in what this file calls.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from functools import cached_property
from operator import is_
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Info, Mask, numbers_of
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.barriers.late_inputs import REMEDY, LateInputs
from hcbf_gym.barriers.layout import LOWEST_RANK
from hcbf_gym.barriers.limits import check_limits
from hcbf_gym.barriers.mapped import SeenRegion
from hcbf_gym.barriers.placing import Placing
from hcbf_gym.barriers.relative_degree import Reach
from hcbf_gym.barriers.set import BarrierSet, Condition
from hcbf_gym.errors import (
    UNREADABLE,
    InvalidInputError,
    SafetyWarning,
    UnreachableError,
    shown,
    warn_caller,
)
from hcbf_gym.filtering import bound, causes, solvers
from hcbf_gym.filtering.alarms import ReasonWarnings
from hcbf_gym.filtering.belief import real_numbers
from hcbf_gym.filtering.bound import SceneArrays
from hcbf_gym.filtering.configured import Configured
from hcbf_gym.filtering.conflict import conflict_of
from hcbf_gym.filtering.covering import Covering
from hcbf_gym.filtering.nearness import Nearness
from hcbf_gym.filtering.plants import COMPARED, CHANGED
from hcbf_gym.filtering.report import ReportBuffer
from hcbf_gym.filtering.samples import Samples
from hcbf_gym.filtering.scene import SceneReader
from hcbf_gym.filtering.settings import FilterSettings
from hcbf_gym.models import clocks
from hcbf_gym.models.clocks import SEEN_FOR
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import FIRST_ALARM, Estimate, Plant, Reason
from hcbf_gym.programs import ConflictReport, FilterStatus


class FilterCore(Configured, ABC):
    """A filter of N plants: what it knows of them, and what a step makes of that.

    Attributes:
        covering: whether the promise was tested.
        read_scenes: barriers → the set of their scenes.

    Args: as `Configured` takes them.
    """

    def __init__(
        self,
        plant: Plant,
        input_set: InputSet,
        settings: FilterSettings,
        batch: int | None = None,
        threads: int = 1,
    ):
        super().__init__(plant, input_set, settings, batch, threads)
        self._warnings = ReasonWarnings(self.brakes_on_alarm)
        self._said_late = self._said_far = False
        self.covering = Covering(plant, self.count)
        self._fresh: Mask = np.ones(self.count, dtype=np.bool_)
        self._steps: Array = np.zeros(self.count)
        self._samples = Samples(plant, input_set.n_u, self.count, apart=not self._is_planar)
        self._buffer = ReportBuffer(batch, input_set.n_u)
        self._buffer.plants["alpha1_scale"] = self.alpha1_scale
        self._world: tuple[object, object] | None = None  # of this step
        self._m = -1  # there was no scene yet
        self._last: tuple[SceneArrays, Array] | None = None  # scenes and rows of the last step
        self._scene = BarrierSet([()] * self.count)  # as of time 0 of the plants' clocks
        self._given = self._scene  # as it was returned or set
        self._version, self._edits = self._scene.version.copy(), -1
        self._placing, self._nearness = Placing(self.count), Nearness(self.count)
        self._rebased = False  # whether positions count from elsewhere since this step
        self._moves_undeclared = True  # whether a record may say so
        self._moving = ""  # the name of a region that moves undeclared
        self._refused, self._needs_time = False, False
        self._refusal: Exception | None = None
        self._unread: Exception | None = None  # why barriers are none
        self._kinks = Kinks()
        self.read_scenes = SceneReader(self.count)
        self._scans: list[tuple[int, int, SeenRegion]] = []  # of the scene, that may have moved
        self._first: dict[tuple[int, SeenRegion], float] = {}  # when one without a stamp came [s]
        self.began = 0.0  # when the plant's time was 0, on the clock of its scans [s]

    @property
    def guides(self) -> bool:
        """Whether guidance leads the plants, so that they need a goal."""
        return False

    @property
    def lost(self) -> str:
        """Why guidance finds no path to the goal of a plant, the first one; "" where it does."""
        return ""

    @property
    def conditions(self) -> list[Condition]:
        """Name and rank of the conditions of plant 0, in the order of the report's rows."""
        return self._scene.conditions()

    def restart(self, mask: Mask) -> None:
        """Forget what was known of the masked plants (N,): new episodes have begun there."""
        self.join(mask)
        self._placing.forget(mask)
        self._steps[mask] = 0.0
        self._warnings.forget(Reason.MOVES)

    def join(self, mask: Mask) -> None:
        """Forget the states of the masked plants (N,), whose episodes and clocks go on."""
        self._samples.forget(mask)
        self._nearness.forget(mask)
        self._placing.go_back(mask)
        self._fresh |= mask
        self._first = {key: first for key, first in self._first.items() if not mask[key[0]]}

    def go_on_from(self, other: "FilterCore") -> None:
        """Let shapes count from when they do in another filter of the same plants."""
        self._placing = copy(other._placing)
        self._placing.is_due = True

    def look_again(self) -> None:
        """Let the next `begin` look at scenes, goals and extents anew; what is known stays."""
        self._fresh[:] = True

    def cover(self, said: object) -> None:
        """Note whether the promise was tested for the episodes that begin; see `Covering.begin`."""
        self.covering.begin(said, self._fresh)

    def follow_cover(self, said: object) -> None:
        """Note where the promise is no longer a tested one; see `Covering.follow`."""
        self.covering.follow(said)
        self.covering.tell(self._buffer.plants)

    def begin(
        self,
        barriers: object,
        estimate: Estimate,
        goal: object,
        extent: object,
        since: float | None = None,
        is_first: bool = True,
    ) -> Info:
        """Look at the first states of new episodes, and return what the infos of a reset say.

        Args:
            barriers: as they are now.
            estimate: of the states.
            goal: where guidance leads [m].
            extent: of the world [m]; None where none is known.
            since: as `step` takes it.
            is_first: whether a goal or an extent that is malformed is refused; if not, the plants
                brake, as in a step.

        Raises:
            InvalidInputError: if barriers ask for what cannot be, or leave an input to the policy
                that moves them later.
        """
        if not self._alone:
            self._renew()
        self._take(barriers, estimate, since)
        refusal = self._refusal
        if isinstance(refusal, InvalidInputError) and not isinstance(refusal, UnreachableError):
            raise refusal  # where no input reaches them, or their code fails, they brake
        self._enter(goal, extent, is_first)
        self._fresh[:] = False
        self.covering.tell(self._buffer.plants)
        remembered, counted = self._remembered(), self._steps.copy()
        n_u = self.input_set.n_u
        nothing = np.zeros(n_u if self._alone else (self.count, n_u))
        u, report = self.step(nothing, barriers, estimate, since)
        self._restore(remembered)
        self._steps[:] = counted
        told = report["status"] >= FilterStatus.UNSAFE
        report["status"] = report["status"] * told
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
        world: tuple[object, object] | None = None,
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
        buffer = self._buffer
        self._world = world
        if not self._alone:
            self._renew()
        self._take(barriers, estimate, since)
        scene = self._scene
        if scene.kind.shape[1] != self._m:
            self._m = scene.kind.shape[1]
            self._make_room(self._m)
        buffer.u_nominal[...] = u_nominal
        self._kinks.u = u_nominal
        self._last = arrays, own = self._made(scene, u_nominal)
        said = self._filter(arrays, own)
        if said == bound.NOT_FINITE:
            bad = ~np.isfinite(np.atleast_2d(u_nominal)).all(axis=1)
            raise InvalidInputError(
                f"action: got {shown(np.atleast_2d(u_nominal)[bad].tolist())} for the plants "
                f"{shown(np.flatnonzero(bad).tolist())}, expected finite numbers"
                if self.count > 1
                else f"action: got {u_nominal.tolist()}, expected finite numbers"
            )
        if said == bound.MISSHAPED:
            raise InvalidInputError(
                f"barriers: got scenes of the shape {scene.kind.shape} for {self.count} plants, "
                f"expected one for each, of ranks from 1 to {LOWEST_RANK}"
            )
        if estimate.time is None:
            self._steps += 1.0
        if said == bound.ASKS:
            self._finish(estimate)
        report = buffer.report()
        return report["u_safe"], report

    def conflict(self, i: int = 0) -> ConflictReport | None:
        """Return which conditions no input of U met together at the last step of plant i.

        Returns:
            `rows` are indices of `conditions`; None where one input met all, or the state of the
            plant was not accepted.
        """
        if self._last is None or 0 < self._buffer.plants["reason"][i] < FIRST_ALARM:
            return None
        scene, own = self._last
        sensed = self._samples.plants.copy()
        sensed["known"] = 0  # or the time of the same sample would not advance
        told, rows = (words.copy() for words in self._buffer.words)
        asked = _core.Filter(self._words.copy(), self._program, numbers_of(sensed), 1)
        asked.set_scene(*scene, own)
        asked.set_report(told, rows)
        turns = self.plant.axle is not None
        slack = self._buffer.rows["slack"][i]
        return conflict_of(asked, i, slack, None if turns else self.input_set)

    def _renew(self) -> None:
        """Give a batch's next report memory of its own: the user has that of the last one."""
        self._buffer.renew()
        self._buffer.plants["alpha1_scale"] = self.alpha1_scale
        self.covering.tell(self._buffer.plants)

    @abstractmethod
    def _make_room(self, m: int) -> None:
        """Make room for m rows."""

    @abstractmethod
    def _made(self, scene: BarrierSet, u_nominal: Array) -> tuple[SceneArrays, Array]:
        """Return the scenes as compiled code reads them, and the rows that are made beforehand."""

    @abstractmethod
    def _accept(self, scene: BarrierSet) -> tuple[Sequence[Barrier], Sequence[Reach]]:
        """Look at a scene that is news, and return which barriers may have late inputs.

        Raises:
            InvalidInputError: if no input reaches one.
        """

    @abstractmethod
    def _enter(self, goal: object, extent: object, is_first: bool) -> None:
        """Look at the scenes that begin; see `begin`."""

    def _remembered(self) -> Any:
        """Return what is known of the plants, for `_restore`."""
        return self._samples.remembered()

    def _restore(self, remembered: Any) -> None:
        """Know what was known before."""
        self._samples.restore(remembered)
        self._moves_undeclared = True

    @property
    def _filter_of(self) -> _core.Filter:
        """The compiled filter of the plants, bound to their records and reports."""
        return self._bound.of(self._words, self._program, self._samples, self._buffer)

    def _filter(self, scene: SceneArrays, own: Array) -> int:
        """Filter the plants; return what is to be done, as `bound` has it."""
        compiled = self._filter_of
        self._bound.see(compiled, scene, own)
        if self._solver is None:
            return compiled.filter()
        return solvers.answer(self._solver, compiled, self.count)

    def _finish(self, estimate: Estimate) -> None:
        """Brake as the user asks, and warn."""
        told, rows = self._buffer.plants, self._buffer.rows
        if self.plant.brake is not None:
            for i in np.flatnonzero(told["status"] == FilterStatus.BACKUP):
                u = self._users_brake(int(i)).astype(self.told_as)
                told["u_safe"][i] = self._samples.input[i] = u
                told["intervention"][i] = np.linalg.norm(u - told["u_nominal"][i])
                rows["slack"][i] = rows["delta"][i] = 0.0
        reasons = told["reason"].tolist()
        for reason in sorted(set(reasons)):
            self._warnings.warn(
                reason, reasons.count(reason), lambda reason: self._cause(reason, estimate)
            )

    def _cause(self, reason: int, estimate: Estimate) -> str:
        """Return what exactly is wrong of the first plant with a reason; "" for no more."""
        i = int(np.flatnonzero(self._buffer.plants["reason"] == reason)[0])
        samples, plant, count = self._samples, self.plant, self.count
        if reason == Reason.STATE:
            return causes.of_state(estimate, plant, i, count)
        if reason == Reason.AGE:
            return samples.says
        if reason == Reason.CLOCK:
            last = float(samples.plants["believed_at"][i])
            return causes.of_clock(estimate, last, i, count)
        if reason == Reason.BARRIERS and self._refused:
            return str(self._unread)
        if reason == Reason.BARRIERS:
            x, time = samples.x[i].copy(), float(samples.time[i])
            return causes.of_barriers(self._scene, plant.model, x, time, i)
        return repr(self._moving) if reason == Reason.MOVES and self._moving else ""

    def _users_brake(self, i: int) -> Array:
        """Return the input of U nearest the user's own; nearest 0 where that asks for a state."""
        n_u = self.input_set.n_u
        asked: object = self.plant.brake
        if callable(asked):
            known = self._samples.plants["known"][i]
            x = self._samples.x[i].copy()
            x[:2] += self._samples.origin.at
            asked = asked(x) if known else None
        wanted = real_numbers(asked, (n_u,))
        return self.input_set.project(np.zeros(n_u) if wanted is None else wanted)

    def _time(self, estimate: Estimate) -> ArrayLike:
        """Return the time since the reset [s], counted here where the plant gives none."""
        if estimate.time is not None:
            return estimate.time
        return self._steps * (self.plant.period or 0.0)

    def _take(self, barriers: object, estimate: Estimate, since: float | None) -> None:
        """Note the states, and the barriers as they are now.

        What is no barriers, or cannot be satisfied, is taken for none: the plants are not believed.
        Where barriers move, and neither the estimate nor the period tells the time, nor are they.
        """
        samples = self._samples
        was_far = samples.origin.is_far
        samples.take(estimate, None if estimate.time is not None else self._time(estimate))
        self._rebased = samples.origin.is_far != was_far
        self._take_barriers(barriers, since)
        if self._scans or self._first:
            wrong = self._age_scans()
            if wrong:
                samples.doubt(Reason.AGE, wrong)
        if self._refused:
            samples.doubt(Reason.BARRIERS)
        elif self._needs_time and estimate.time is None:
            samples.doubt(Reason.CLOCK)
        if self._moves_undeclared or self._nearness.is_some:
            self._note_moves()

    def _age_scans(self) -> str:
        """Reserve what may have come since scans were taken; return what is wrong with a stamp."""
        first, self._first, wrong = self._first, {}, ""
        hold = self.plant.period or 0.0
        for i, k, scan in self._scans:
            now = float(self._samples.time[i]) + self.began
            if not math.isfinite(now):
                continue
            seen = scan.stamp
            if seen is None:
                seen = self._first[i, scan] = first.get((i, scan), now)
            if not clocks.is_accepted(now - seen, SEEN_FOR):
                wrong = f"the scan {scan.name!r}: {clocks.says(now - seen, SEEN_FOR)}"
            self._scene.own_margin[i, k] = scan.margin_at(now + hold - seen)
        return wrong

    def _take_barriers(self, barriers: object, since: float | None) -> None:
        """Note barriers that may be others than the last ones."""
        try:
            given = self._read_barriers(barriers)
        except Exception as error:  # whatever a user's own barriers raise, the robot has to stop
            self._unread = error
            self._refused, self._refusal = True, None
            self._version, self._edits = np.full(self.count, -1), -1
        else:
            self._note_news(given, since)

    def _note_news(self, given: BarrierSet, since: float | None = None) -> None:
        """Take barriers for the present ones; where they have changed they are looked at."""
        in_place = given is self._given
        if in_place and given.edits == self._edits and not self._placing.is_due:
            return
        news = given.version != self._version if in_place else self._differs(given)
        plants, before = self._samples.plants, self._scene
        scene = self._placing.place(given, self._now(), since)
        if scene is before and given.edits == self._edits:
            return
        if since is not None and scene.parameters.shape == before.parameters.shape:
            news |= (scene.parameters != before.parameters).any(axis=(1, 2))
        self._age_scans()
        is_kept = scene is not before and not (in_place and given.atlas)
        compared = is_kept and not self._rebased and self._looks_back()
        plants["change"][news] = np.maximum(plants["change"][news], COMPARED if compared else CHANGED)
        if news.any():
            at = self._samples.x, self._samples.time
            known = self._are_known() & (not self._rebased)
            self._nearness.compare(before, scene, at, news, known)
        self._given, self._version, self._edits = given, given.version.copy(), given.edits
        self._scene = scene
        held = scene.atlas.held.items()
        self._scans = [
            (i, k, one) for (i, k), one in held if isinstance(one, SeenRegion) and one.speed > 0.0
        ]
        self.covering.change(news & ~self._fresh)
        self.covering.tell(self._buffer.plants)
        self._refused, self._refusal = False, None
        try:
            with np.errstate(all="ignore"):
                self._needs_time = self.plant.period is None and self._moves(scene)
                self.check_limits(scene)
                self._check_inputs(*self._accept(scene))
        except UNREADABLE as error:
            self._refused, self._refusal, self._unread = True, error, error

    def _differs(self, given: BarrierSet) -> Mask:
        """Return (N,) whose barriers are other objects than those of the present scenes."""
        if self._refused:
            return np.ones(self.count, dtype=np.bool_)
        return np.array([
            one is not other and (len(one) != len(other) or not all(map(is_, one, other)))
            for one, other in zip(given.listed, self._given.listed, strict=True)
        ])  # fmt: skip

    def _now(self) -> Array:
        """Return (N,) the times of the states [s]; those believed last where they are none."""
        now, last = self._samples.time, self._samples.plants["believed_at"]
        return np.where(np.isfinite(now), now, last)

    def _are_known(self) -> Mask:
        """Return (N,) of which plants the state is one, in an episode that has begun before."""
        fault, x = self._samples.plants["fault"], self._samples.x
        sound = (fault == 0) | (fault >= FIRST_ALARM)
        return sound & np.isfinite(x).all(axis=1) & ~self._fresh

    def _note_moves(self) -> None:
        """Note at which plants a region moves undeclared."""
        samples = self._samples
        plants, covariance = samples.plants, samples.states.covariance
        plants["moves"], self._moves_undeclared = 0, False
        if not self._nearness.is_some:
            return
        variance = covariance[:, 0, 0] + covariance[:, 1, 1] if samples.told else 0.0
        error = self.uncertainty.distance + self.uncertainty.confidence * np.sqrt(variance)
        error = np.broadcast_to(error, self.count)
        moving = self._nearness.moves(plants["elapsed"], error)
        plants["moves"] = moving.any(axis=1)
        if moving.any():
            self._moves_undeclared = True
            i, k = np.argwhere(moving)[0].tolist()
            self._moving = self._scene.conditions(i)[k].name

    def _looks_back(self) -> bool:
        """Write what strict conditions lack of the scene until now; return whether that is known.

        Where a scene is changed in place, and of other models, nobody knows it.
        """
        return False

    def _moves(self, scene: BarrierSet) -> bool:
        """Return whether a scene depends on time."""
        return bool(scene.moves.any())

    def _read_barriers(self, barriers: Any) -> BarrierSet:
        """Return barriers as a set; the present one where they hold what was read last.

        Raises:
            InvalidInputError: if they are none.
        """
        try:
            barriers = self._samples.origin.barriers(barriers)
        except InvalidInputError as error:
            if not self._said_far:
                self._said_far = True
                warn_caller(f"safety filter: far from the origin: {error}", SafetyWarning)
            raise
        return self.read_scenes(barriers)

    def _read_static(self) -> None:
        """Take barriers that never change, and refuse what cannot be.

        Raises:
            InvalidInputError: if they are none, cannot be satisfied, or leave an input to the
                policy that moves them later.
        """
        if not callable(self.plant.barriers):
            self._note_news(self._read_barriers(self.plant.barriers))
            if self._refusal is not None:
                raise self._refusal

    @cached_property
    def _late_inputs(self) -> LateInputs:
        return LateInputs(self.plant.model)

    def _check_inputs(self, barriers: Sequence[Barrier], reaches: Sequence[Reach]) -> None:
        """Refuse barriers whose rows miss an input that moves them later; warn of it once.

        Raises:
            InvalidInputError: if there is one, and late inputs are not allowed.
        """
        late = "; ".join(self._late_inputs.find(barriers, reaches)) if barriers else ""
        if not late:
            return
        allowed = self.settings.allow_late_inputs
        late = f"{late}: allowed" if allowed else f"{late}; {REMEDY}"
        if not self._said_late and (allowed or not self._fresh.all()):
            self._said_late = True
            warn_caller(f"safety filter: {late}")
        if not allowed:
            raise InvalidInputError(late)

    def check_limits(self, scenes: BarrierSet) -> None:
        """Refuse speed limits that no input can satisfy.

        Raises:
            InvalidInputError: if the margin leaves nothing of one, or a held input can pass it from
                rest within one period.
        """
        axle = self.plant.axle
        turn = 0.0 if axle is None else axle.turn
        hold = self.plant.period, self._gain
        check_limits(scenes, hold, self.plant.uncertainty.speed, turn)

    @cached_property
    def _gain(self) -> float:
        """The greatest acceleration of the planar velocity by an input [m/s²]."""
        if self.plant.axle is not None:
            return self.plant.axle.braking
        model, at = self.plant.model, self.plant.model.velocity_at
        if self._is_planar or at is None:
            return self.input_set.radius
        gain = np.linalg.norm(model.g(np.zeros(model.n))[at : at + 2], 2)
        return float(gain) * self.input_set.radius
