"""Which barriers hold now, as of time 0 of each plant's clock, and what came with a change."""

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from hcbf_gym._core import FIRST_ALARM, Reason
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import braking
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.braking import check_limits
from hcbf_gym.barriers.late_inputs import REMEDY, LateInputs
from hcbf_gym.barriers.many import are_same
from hcbf_gym.barriers.mapped import SeenRegion
from hcbf_gym.barriers.placing import Placing
from hcbf_gym.barriers.relative_degree import Reach
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import (
    UNREADABLE,
    CoverageWarning,
    InvalidInputError,
    SafetyWarning,
    warn_caller,
)
from hcbf_gym.filter import gatekeeper
from hcbf_gym.filter.configured import Configured
from hcbf_gym.filter.covering import Covering
from hcbf_gym.filter.model_rows import ModelRows
from hcbf_gym.filter.nearness import Nearness
from hcbf_gym.filter.planar_rows import PlanarRows
from hcbf_gym.filter.plants import CHANGED, COMPARED
from hcbf_gym.filter.samples import Samples
from hcbf_gym.filter.scene_reader import SceneReader
from hcbf_gym.models import clocks
from hcbf_gym.models.clocks import SEEN_FOR
from hcbf_gym.models.plant import Coverage, Estimate


class Scenes:
    """The barriers of N plants, and whether plants can be filtered with them.

    Where barriers are refused, samples get a reason to brake; `covering` ends where one changes.

    Attributes:
        plant: what each plant is.
        now: the scenes as of time 0 of the plants' clocks.
        read: barriers → the set of their scenes.
        placing: since when shapes count.
        is_refused: whether what was given last is none, or cannot be satisfied.
        unread: why, where no barriers could be read.
        refusal: why, where they can be read.
        moving: the name of a region that moves undeclared.
        began: when the plant's time was 0, on the clock of its scans [s].
        is_due: whether a record may hold that a region moves undeclared.
    """

    def __init__(
        self, made: Configured, samples: Samples, rows: PlanarRows | ModelRows, covering: Covering
    ):
        self._made, self._samples, self._rows, self._covering = made, samples, rows, covering
        self.plant = made.plant
        count = made.count
        self.now = self._given = BarrierSet([()] * count)
        self._version, self._edits = self.now.version.copy(), -1
        self.placing, self._nearness = Placing(count), Nearness(count)
        self.read = SceneReader(count)
        self.is_refused, self._needs_time = False, False
        self.refusal: Exception | None = None
        self.unread: Exception | None = None
        self.moving, self.is_due, self.began = "", True, 0.0
        self._scans: list[tuple[int, int, SeenRegion]] = []  # of the scene, that may have moved
        self._first: dict[tuple[int, SeenRegion], float] = {}  # when one without a stamp came [s]
        self._warned: set[str] = set()

    def forget(self, mask: Mask) -> None:
        """Forget what was compared for the masked plants (N,)."""
        self._nearness.forget(mask)
        self.placing.go_back(mask)
        self._first = {key: first for key, first in self._first.items() if not mask[key[0]]}

    def take(self, barriers: object, estimate: Estimate, since: float | None) -> None:
        """Note the barriers as they are now.

        What are not barriers, or cannot be satisfied, makes the plants brake. So do barriers that
        move where neither the estimate nor the period has the time.
        """
        samples = self._samples
        try:
            given = self._given
            if barriers is not given or samples.origin.is_far:  # no environment's set
                given = self._read(barriers)
        except Exception as error:  # whatever a user's own barriers raise, the robot has to stop
            self.unread = error
            self.is_refused, self.refusal = True, None
            self._version, self._edits = np.full(self._made.count, -1), -1
        else:
            is_same = given is self._given and given.edits == self._edits
            if not is_same or self.placing.is_due:
                self._change(given, since)
        if self._scans or self._first:
            wrong = self._age_scans()
            if wrong:
                samples.doubt(Reason.AGE, wrong)
        if self.is_refused:
            samples.doubt(Reason.BARRIERS)
        elif self._needs_time and estimate.time is None:
            samples.doubt(Reason.CLOCK)
        if self.is_due or self._nearness.is_some:
            self._note_moves()

    def take_static(self, barriers: object) -> None:
        """Take barriers that never change."""
        self._change(self._read(barriers), None)
        if self.refusal is not None:
            raise self.refusal

    def check(self, scenes: BarrierSet) -> Integers:
        """Return (N,) a `Coverage` of each scene: OUTSIDE where rank 1 cannot be promised in it.

        Warns once of each thing that α₁, U and the speed limit cannot satisfy.
        """
        made, plant = self._made, self._made.plant
        margin, fastest = plant.uncertainty.speed, plant.fastest or np.inf
        self.check_limits(scenes)
        covered = np.full(len(scenes.kind), Coverage.COVERED, dtype=np.int64)
        for one in braking.shortcomings(scenes, made.alpha1, made.input_set, margin, fastest):
            if not one.promised:
                covered[one.scenes] = Coverage.OUTSIDE
            self._warn_once(one.what, one.text, CoverageWarning)
        return covered

    def check_limits(self, scenes: BarrierSet) -> None:
        """Refuse speed limits that no input can satisfy."""
        plant = self._made.plant
        turn = 0.0 if plant.axle is None else plant.axle.turn
        check_limits(scenes, (plant.period, self._made.gain), plant.uncertainty.speed, turn)

    def _warn_once(self, what: str, text: str, category: type[Warning] = UserWarning) -> None:
        if what not in self._warned:
            self._warned.add(what)
            warn_caller(f"safety filter: {text}", category)

    def _read(self, barriers: object) -> BarrierSet:
        """Return barriers as a set; the present one where they hold what was read last."""
        origin = self._samples.origin
        if origin.is_far:
            try:
                barriers = origin.barriers(barriers)
            except InvalidInputError as error:
                self._warn_once("far", f"far from the origin: {error}", SafetyWarning)
                raise
        given = self.read(barriers)
        if given is not self._given:
            self._rows.check(barriers, given)
        return given

    def _change(self, given: BarrierSet, since: float | None) -> None:
        """Look at barriers that may be others than the last ones, and take them."""
        samples, before = self._samples, self.now
        in_place = given is self._given
        changed = given.version != self._version if in_place else self._differs(given)
        scene = self.placing.place(given, self._time(), since)
        if scene is before and given.edits == self._edits:
            return
        if since is not None and scene.parameters.shape == before.parameters.shape:
            changed |= (scene.parameters != before.parameters).any(axis=(1, 2))
        self._age_scans()
        kept = scene is not before and not (in_place and given.atlas) and not samples.is_rebased
        stays = not self.is_refused and before.edits == self._edits
        compared = kept and stays and self._rows.look_back(before)
        change = samples.plants["change"]
        change[changed] = np.maximum(change[changed], COMPARED if compared else CHANGED)
        if changed.any():
            known = self._are_known() & (not samples.is_rebased)
            self._nearness.compare(before, scene, (samples.x, samples.time), changed, known)
        self._given, self._version, self._edits = given, given.version.copy(), given.edits
        self.now = scene
        held = scene.atlas.held.items()
        self._scans = [
            (i, k, one) for (i, k), one in held if isinstance(one, SeenRegion) and one.speed > 0.0
        ]
        self._covering.change(changed & ~samples.fresh)
        self.is_refused, self.refusal = False, None
        try:
            with np.errstate(all="ignore"):
                period = self._made.plant.period
                self._needs_time = period is None and self._rows.moves(scene)
                self.check_limits(scene)
                if self._made.gate is not None:
                    gatekeeper.check_scene(scene)
                self._check_inputs(*self._rows.accept(scene))
        except UNREADABLE as error:
            self.is_refused, self.refusal, self.unread = True, error, error

    def _differs(self, given: BarrierSet) -> Mask:
        """Return (N,) whose barriers are other objects than those of the present scenes."""
        if self.is_refused:
            return np.ones(self._made.count, dtype=np.bool_)
        return np.array([
            not are_same(*pair) for pair in zip(given.listed, self._given.listed, strict=True)
        ])  # fmt: skip

    def _time(self) -> Array:
        """Return (N,) the times of the states [s]; of the last valid ones where they are NaN."""
        now, last = self._samples.time, self._samples.plants["accepted_at"]
        return np.where(np.isfinite(now), now, last)

    def _are_known(self) -> Mask:
        """Return (N,) of which plants the state is one, in an episode that has begun before."""
        fault, x = self._samples.plants["fault"], self._samples.x
        sound = (fault == 0) | (fault >= FIRST_ALARM)
        return sound & np.isfinite(x).all(axis=1) & ~self._samples.fresh

    def _age_scans(self) -> str:
        """Reserve what may have come since scans were taken; return what is wrong with a stamp."""
        first, self._first, wrong = self._first, {}, ""
        hold = self._made.plant.period or 0.0
        for i, k, scan in self._scans:
            now = float(self._samples.time[i]) + self.began
            if not math.isfinite(now):
                continue
            seen = scan.stamp
            if seen is None:
                seen = self._first[i, scan] = first.get((i, scan), now)
            if not clocks.is_accepted(now - seen, SEEN_FOR):
                wrong = f"the scan {scan.name!r}: {clocks.refusal(now - seen, SEEN_FOR)}"
            self.now.own_margin[i, k] = scan.margin_at(now + hold - seen)
        return wrong

    def _note_moves(self) -> None:
        """Note at which plants a region moves undeclared."""
        samples, reserved = self._samples, self._made.uncertainty
        plants, covariance = samples.plants, samples.states.covariance
        plants["moves"], self.is_due = 0, False
        if not self._nearness.is_some:
            return
        variance = covariance[:, 0, 0] + covariance[:, 1, 1] if samples.has_parts else 0.0
        error = reserved.distance + reserved.confidence * np.sqrt(variance)
        moving = self._nearness.moves(plants["elapsed"], np.broadcast_to(error, self._made.count))
        plants["moves"] = moving.any(axis=1)
        if moving.any():
            self.is_due = True
            i, k = np.argwhere(moving)[0].tolist()
            self.moving = self.now.conditions(i)[k].name

    @cached_property
    def _late_inputs(self) -> LateInputs:
        return LateInputs(self._made.plant.model)

    def _check_inputs(self, barriers: Sequence[Barrier], reaches: Sequence[Reach]) -> None:
        """Refuse barriers whose rows miss an input that moves them later; warn of it once."""
        late = "; ".join(self._late_inputs.find(barriers, reaches)) if barriers else ""
        if not late:
            return
        allowed = self._made.settings.allow_late_inputs
        late = f"{late}: allowed" if allowed else f"{late}; {REMEDY}"
        if allowed or not self._samples.fresh.all():
            self._warn_once("late", late)
        if not allowed:
            raise InvalidInputError(late)
