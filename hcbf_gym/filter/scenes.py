"""Takes the barriers of N plants at every step, and compares changed barriers with the previous."""

from copy import copy
from functools import cached_property

import numpy as np

from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers.braking import check_limits
from hcbf_gym.barriers.late_inputs import REMEDY, LateInputs
from hcbf_gym.barriers.many import are_same
from hcbf_gym.barriers.placing import Placing
from hcbf_gym.barriers.relative_degree import ReachedBarriers
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.shortcomings import shortcomings
from hcbf_gym.errors import (
    CoverageWarning,
    InvalidInputError,
    SafetyWarning,
    in_words,
    warn_caller,
)
from hcbf_gym.filter import gatekeeper
from hcbf_gym.filter.configured import FilterConfig
from hcbf_gym.filter.covering import EpisodeCoverage
from hcbf_gym.filter.nearness import Nearness
from hcbf_gym.filter.plants import CHANGED, COMPARED
from hcbf_gym.filter.row_maker import RowMaker
from hcbf_gym.filter.samples import Samples
from hcbf_gym.filter.scan_ages import ScanAges
from hcbf_gym.filter.scene_reader import SceneReader, check_general
from hcbf_gym.models.plant import Coverage, Estimate


class Scenes:
    """The scenes of N plants: of each plant, the barriers that its rows satisfy.

    Shapes are at their places at time 0 of a plant's clock. If barriers are refused, the samples
    get a reason to brake. If they change, the coverage of the episode ends, and the change is
    compared with the margins and with the declared motion.

    Attributes:
        plant: the model, readers and limits that all N plants share.
        current: the present scenes.
        read: returns the `BarrierSet` of barriers as a user gives them.
        placing: the times from which shapes count.
        scan_ages: the ages of scans, and their margins.
        is_refused: whether the latest barriers are unreadable, or cannot be satisfied.
        refusal: why the latest barriers, which are readable, are refused; None otherwise.
        error: the latest error of unreadable or refused barriers.
        moving_region: the name of a region with undeclared motion.
        checks_moves: whether the records may state that a region moves undeclared.
    """

    def __init__(
        self,
        config: FilterConfig,
        samples: Samples,
        rows: RowMaker,
        coverage: EpisodeCoverage,
    ):
        self._config, self._samples, self._rows, self._coverage = config, samples, rows, coverage
        self.plant = config.plant
        self.current = self._given = BarrierSet([()] * config.count)
        # of `_given` when it was taken, because a set may be edited in place
        self._version, self._edits = self.current.version.copy(), -1
        self.placing, self._nearness = Placing(config.count), Nearness(config.count)
        self.read, self.scan_ages = SceneReader(config.count), ScanAges(samples, self.plant.period)
        self.is_refused, self._needs_time = False, False
        self.refusal: Exception | None = None
        self.error: Exception | None = None
        self.moving_region, self.checks_moves = "", True
        self._warned: set[str] = set()
        # of the filter that this one continues, until both are compared
        self._continued: tuple[BarrierSet, Nearness] | None = None

    def go_on_from(self, other: "Scenes") -> None:
        """Continue the times of shapes and scans, and the comparison of motion, from another's."""
        self.placing = copy(other.placing)
        self.placing.is_due = True
        self.scan_ages.go_on_from(other.scan_ages)
        self._continued = other._continued or (other.current, other._nearness)

    def forget(self, mask: Mask) -> None:
        """Forget approaches and scan ages of the masked plants (N,), whose clocks may go back."""
        self._nearness.forget(mask)
        self.placing.go_back(mask)
        self.scan_ages.forget(mask)

    def take(
        self, barriers: object, estimate: Estimate, since: float | None, *, counts: bool
    ) -> None:
        """Take the present barriers.

        The plants brake if these are no barriers or cannot be satisfied. They also brake if
        barriers move while neither the estimate nor the period determines the time.

        Args:
            barriers: as the plants' reader returns them.
            estimate: the estimate that the samples have taken.
            since: the time from which changed shapes count [s]; None is the present.
            counts: whether undeclared motion counts in this step.
        """
        samples = self._samples
        try:
            given = self._given
            if barriers is not given or samples.origin.is_far:  # not an environment's own set
                given = self._read(barriers)
            is_same = given is self._given and given.edits == self._edits
            if not is_same or self.placing.is_due:
                self._replace(given, since)
        except Exception as error:  # whatever a user's own barriers raise, the robot has to stop
            self.is_refused, self.refusal, self.error = True, None, error
            self._version, self._edits = np.full(self._config.count, -1), -1  # those of no set
        if self.scan_ages.has_scans and (wrong_age := self.scan_ages.update()):
            samples.wrong_age = wrong_age
            samples.reject(Reason.AGE)
        if self.is_refused:
            samples.reject(Reason.BARRIERS)
        elif self._needs_time and estimate.time is None:
            samples.reject(Reason.CLOCK)
        if counts and (self.checks_moves or self._nearness.is_some):
            self._write_moves()

    def take_static(self, barriers: object) -> None:
        """Take barriers that never change; raise the error if they are refused."""
        self._replace(self._read(barriers), None)
        if self.refusal is not None:
            raise self.refusal

    def check(self, scenes: BarrierSet) -> Integers:
        """Return the `Coverage` of each scene (N,): OUTSIDE if U may not satisfy rank 1.

        Warns once of each condition that α₁, U or the speed limit cannot satisfy.
        """
        config, plant = self._config, self.plant
        self.check_limits(scenes)
        coverage = np.full(len(scenes.kind), Coverage.COVERED, dtype=np.int64)
        fastest = plant.fastest or np.inf
        limits = config.alpha1, config.input_set, plant.uncertainty.speed, fastest
        for shortcoming in shortcomings(scenes, *limits):
            if not shortcoming.promised:
                coverage[shortcoming.scenes] = Coverage.OUTSIDE
            self._warn_once(shortcoming.what, shortcoming.text, CoverageWarning)
        return coverage

    def check_limits(self, scenes: BarrierSet) -> None:
        """Refuse speed limits that no input can satisfy."""
        plant = self.plant
        turn_rate = 0.0 if plant.axle is None else plant.axle.turn
        check_limits(scenes, plant.period, self._config.gain, plant.uncertainty.speed, turn_rate)

    def _warn_once(self, topic: str, text: str, category: type[Warning] = UserWarning) -> None:
        if topic not in self._warned:
            self._warned.add(topic)
            warn_caller(f"safety filter: {text}", category)

    def _read(self, barriers: object) -> BarrierSet:
        """Return the set of barriers, which is the previous set if they are the same objects."""
        origin = self._samples.origin
        if origin.is_far:
            try:
                barriers = origin.barriers(barriers)
            except InvalidInputError as error:
                self._warn_once("far", f"far from the origin: {in_words(error)}", SafetyWarning)
                raise
        given = self.read(barriers)
        if given is not self._given and not self._config.is_planar:
            check_general(barriers, given, self.plant.model)
        return given

    def _replace(self, given: BarrierSet, since: float | None) -> None:
        """Replace the scenes by a set that may differ from the previous one; see `take`."""
        previous, is_same_set = self.current, given is self._given
        changed = given.version != self._version if is_same_set else self._differs(given)
        scenes = self.placing.place(given, self._finite_times(), since)
        if scenes is previous and given.edits == self._edits and self._continued is None:
            return
        if since is not None and scenes.parameters.shape == previous.parameters.shape:
            changed |= (scenes.parameters != previous.parameters).any(axis=(1, 2))
        self.scan_ages.update()  # so that previous scans are compared at their present ages
        # an edit in place, or another origin, leaves no previous scenes that could be evaluated
        is_edited = scenes is previous or previous.edits != self._edits
        is_edited |= is_same_set and bool(given.atlas)
        has_previous = not (is_edited or self.is_refused or self._samples.is_rebased)
        self._compare(previous, scenes, changed, has_previous and self._continued is None)
        self._given, self._version, self._edits = given, given.version.copy(), given.edits
        self.current = scenes
        self.scan_ages.set_scenes(scenes)
        self._coverage.end_where_changed(changed & ~self._samples.fresh)
        self._accept(scenes)

    def _compare(
        self, previous: BarrierSet, scenes: BarrierSet, changed: Mask, has_previous: bool
    ) -> None:
        """Compare changed scenes with the previous ones, in margins and in declared motion."""
        samples = self._samples
        is_compared = has_previous and self._rows.evaluate_previous(previous)
        change = samples.plants["change"]
        change[changed] = np.maximum(change[changed], COMPARED if is_compared else CHANGED)
        is_comparable = samples.is_sound & np.isfinite(samples.x).all(axis=1)
        is_comparable &= not samples.is_rebased
        if self._continued is None:
            is_comparable &= ~samples.fresh
        else:
            (previous, self._nearness), self._continued = self._continued, None
            changed = np.ones_like(changed)
        if changed.any():
            place = samples.x, samples.time
            self._nearness.compare(previous, scenes, *place, changed, is_comparable)

    def _accept(self, scenes: BarrierSet) -> None:
        """Accept changed scenes, or set why they are refused."""
        self.is_refused, self.refusal = False, None
        try:
            with np.errstate(all="ignore"):
                n = self.plant.model.n
                self._needs_time = self.plant.period is None and scenes.depends_on_time(n)
                self.check_limits(scenes)
                if self._config.gate is not None:
                    gatekeeper.check_scene(scenes)
                self._check_inputs(self._rows.accept(scenes))
        except Exception as error:  # a user's own barriers may raise anything
            self.is_refused, self.refusal, self.error = True, error, error
            self._rows.forget()

    def _differs(self, given: BarrierSet) -> Mask:
        """Return (N,) whether the barriers of a plant are other objects than before."""
        if self.is_refused:
            return np.ones(self._config.count, dtype=np.bool_)
        pairs = zip(given.listed, self._given.listed, strict=True)
        return np.array([not are_same(now, before) for now, before in pairs])

    def _finite_times(self) -> Array:
        """Return (N,) the times of the states [s], or of the last valid states if they are NaN."""
        now, last = self._samples.time, self._samples.plants["accepted_at"]
        return np.where(np.isfinite(now), now, last)

    def _write_moves(self) -> None:
        """Write into the records which plants a region approaches faster than declared."""
        samples, uncertainty = self._samples, self._config.uncertainty
        plants, covariance = samples.plants, samples.states.covariance
        plants["moves"], self.checks_moves = 0, False
        if not self._nearness.is_some:
            return
        variance = covariance[:, 0, 0] + covariance[:, 1, 1] if samples.is_uncertain else 0.0
        error = uncertainty.distance + uncertainty.confidence * np.sqrt(variance)
        error = np.broadcast_to(error, self._config.count)
        is_moving = self._nearness.moves(plants["elapsed"], error)
        plants["moves"] = is_moving.any(axis=1)
        if is_moving.any():
            self.checks_moves = True
            plant, condition = np.argwhere(is_moving)[0].tolist()
            self.moving_region = self.current.conditions(plant)[condition].name

    @cached_property
    def _late_inputs(self) -> LateInputs:
        return LateInputs(self.plant.model)

    def _check_inputs(self, changed: ReachedBarriers) -> None:
        """Refuse barriers whose rows miss an input that moves them later; warn of it once."""
        missed = self._late_inputs.find(*changed) if changed.barriers else []
        if not missed:
            return
        is_allowed = self._config.settings.allow_late_inputs
        text = "; ".join(missed) + (": allowed" if is_allowed else f"; {REMEDY}")
        if is_allowed or not self._samples.fresh.all():
            self._warn_once("late", text)
        if not is_allowed:
            raise InvalidInputError(text)
