"""The filter of N plants of any model: rows, alarms and braking inputs, made step by step."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.barrier import Barrier, reads_time
from hcbf_gym.barriers.convexity import warn_of_concave
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.general import GeneralRows, Prepared, check_barriers
from hcbf_gym.barriers.general_kernels import FAST, MARGIN, PLACED, WIDTH
from hcbf_gym.barriers.relative_degree import Reach, samples
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import UNREADABLE, InvalidInputError
from hcbf_gym.filtering import belief
from hcbf_gym.filtering.core import FilterCore, SceneArrays
from hcbf_gym.filtering.model_monitor import ModelMonitor
from hcbf_gym.filtering.settings import FilterSettings, check_hold
from hcbf_gym.models.constants import FARTHEST
from hcbf_gym.models.input_sets import Box, InputSet
from hcbf_gym.models.plant import Plant, Reason
from hcbf_gym.models.reduced_order import ReducedOrderModel


class ModelCore(FilterCore):
    """The filter of N plants of a model that is not compiled: usual rows from jets, any inputs.

    Where inputs are two and no solver is named, the compiled program answers, for all plants in
    one call; else a program does, one plant after the other.

    Args: as `FilterCore` takes them; nothing guides the plants.
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
        model = plant.model
        if settings.guidance is not None:
            raise InvalidInputError(
                f"guidance: got {settings.guidance!r} with {type(model).__name__}, expected "
                "None: only the planar double integrator is guided"
            )
        self._rows_of = GeneralRows(model, self.alpha1, self.alpha2, input_set.support)
        self._rows_of.kinks = self._kinks
        self._check_uncertainty()
        confidence = plant.uncertainty.confidence
        self._monitor = ModelMonitor(model, plant.period, input_set, confidence, self.count)
        self._velocity_at = -1 if model.velocity_at is None else model.velocity_at
        self._coasts = type(model).brake is not ReducedOrderModel.brake
        self._prepared: Prepared | None = None
        self._said_concave = False
        self._reserved = False
        self._make_room(0)
        self._read_static()

    def restart(self, mask: Mask) -> None:
        """Forget what was known of the masked plants (N,): new episodes have begun there."""
        super().restart(mask)
        self._monitor.forget(mask)

    def _read_barriers(self, barriers: Any) -> BarrierSet:
        """Return barriers as a set; see `FilterCore`.

        Raises:
            InvalidInputError: if they are none, or arrays, which have rows of the planar double
                integrator alone.
        """
        if isinstance(barriers, BarrierSet):
            raise InvalidInputError(
                f"plant: got the scenes of an environment with {self.plant.model}, expected a "
                "sequence of barriers: they have rows of the planar double integrator alone"
            )
        given = super()._read_barriers(barriers)
        if given is not self._given:
            for listed in given.listed:
                check_barriers(listed)
        return given

    def _moves(self, scene: BarrierSet) -> bool:
        """Return whether a scene depends on time."""
        seen = {id(one): one for listed in scene.listed for one in listed}
        n = self.plant.model.n
        return any(reads_time(one, n) for one in seen.values() if isinstance(one, Barrier))

    def _make_room(self, m: int) -> None:
        """Make room for m rows."""
        self._buffer.widen(m, m)
        self._own = np.zeros((self.count, m, WIDTH + self.input_set.n_u))
        self._reserved = False

    def _check_uncertainty(self) -> None:
        """Refuse what has no meaning for the model.

        Raises:
            InvalidInputError: if a lag in velocity is reserved, and nothing but the input changes
                the velocity; or something of a speed limit, which the model has none of.
        """
        model, declared = self.plant.model, self.plant.uncertainty
        without = [name for name in ("speed", "speed_per_velocity") if model.velocity_at != 2]
        why = dict.fromkeys(without, "it has no velocity in x[2:4] that a speed limit reads")
        if declared.per_velocity > 0.0 and not self._drifts():
            why["per_velocity"] = "its velocity is the input, so that no body lags behind it"
        for name, reason in why.items():
            value = getattr(declared, name)
            if value > 0.0:
                raise InvalidInputError(
                    f"plant: uncertainty: {name}: got {value:g} with {model}, expected 0: {reason}"
                )

    def _drifts(self) -> bool:
        """Return whether the velocity under one input differs from state to state."""
        f, g = self.plant.model.terms_of(samples(self.plant.model)[0])
        placed = self.plant.model.n_p
        return bool(np.ptp(f[:, :placed], axis=0).any() or np.ptp(g[:, :placed], axis=0).any())

    def _reserve(self, prepared: Prepared) -> None:
        """Write what rows reserve: again where a sample said more than x, or ∇h may turn."""
        taken, reserve = self._samples, self.reserve
        changes = taken.told or (reserve.is_steep and bool(prepared.entries))
        if self._reserved and not changes:
            self._own[..., FAST] = 0.0  # of a body that is its model, h itself shows it
            return
        self._reserved = not changes
        states = taken.states
        own = states.model if taken.told else states.x
        known = reserve.know(states.x, taken.time, own, states.lag, states.covariance)
        if taken.told:
            self._filter_of.grow_all(known.drift, self.plant.model.n_p)
            known = known._replace(growth=taken.plants["growth"].copy())
        out, scene = self._own[..., MARGIN : FAST + 1], prepared.scene
        entries = prepared.entries if changes else ()
        least = prepared.margins(reserve.fixed)
        reserve.write((scene.kind, scene.parameters), least, entries, known, out)
        self._own[..., PLACED] = prepared.share > 0.0

    def _accept(self, scene: BarrierSet) -> tuple[Sequence[Barrier], Sequence[Reach]]:
        """Look at a scene that is news, and return its barriers and how inputs reach them."""
        self._prepared = None
        first: Any = scene.listed[0]
        same = all(listed is first for listed in scene.listed)
        scenes: Any = [first] * self.count if same else scene.listed
        if not self._said_concave:
            self._said_concave = True
            own = [one for one in first if isinstance(one, Function)]
            warn_of_concave(own, self.plant.model)
        prepared = self._rows_of.prepare(scenes)
        shape = scene.is_region  # as of time 0
        prepared.scene.parameters[shape] = scene.parameters[shape]
        reaches = [reach for one in prepared.reaches for reach in one]
        period = self.plant.period
        if period is not None and any(reach.degree > 1 for reach in reaches):
            check_hold(period, alpha1=self.alpha1)
        self._prepared, self._reserved = prepared, False
        distinct = prepared.scenes[: len(prepared.reaches)]
        return [one for entries in distinct for one in entries], reaches

    def _enter(self, goal: object, extent: object, is_first: bool) -> None:
        """Nothing more is known of scenes that begin."""

    def _remembered(self) -> Any:
        """Return what is known of the plants, for `_restore`."""
        return super()._remembered(), self._monitor.remembered()

    def _restore(self, remembered: Any) -> None:
        """Know what was known before."""
        samples, monitor = remembered
        super()._restore(samples)
        self._monitor.restore(monitor)

    def _made(self, scene: BarrierSet, u_nominal: Array) -> tuple[SceneArrays, Array]:
        """Look at the states, compare them with what was expected, and make the rows."""
        if np.isfinite(u_nominal).all():
            with np.errstate(all="ignore"):
                self._look()
        numbers = scene.kind, scene.parameters, scene.priority, scene.own_margin
        return (*numbers, scene.atlas.numbers), self._own

    def _look(self) -> None:
        """Write reasons, alarms, rows and braking inputs."""
        samples, told = self._samples, self._buffer.plants
        records, states = samples.plants, samples.states
        compiled = self._filter_of
        if compiled.believe_all(self._velocity_at):
            self._carry_on(told["reason"] != 0)
            compiled.replace_all()
        terms, known = self._terms(states.x)
        if not known.all():
            told["reason"][(told["reason"] == 0) & ~known] = Reason.BARRIERS
        believed = told["reason"] == 0
        if self._prepared is not None:
            self._reserve(self._prepared)
        self._monitor.watch(records, states, samples.input, terms, believed, not samples.told)
        if self._prepared is not None:
            self._rows_of.write(self._prepared, states.x, samples.time, terms, self._own)
        if self._coasts:
            self._note_stops(states.x, records["known"] != 0)

    def _carry_on(self, mask: Mask) -> None:
        """Take for the states of masked plants what the model makes of those believed last."""
        samples = self._samples
        records, states = samples.plants, samples.states
        for i in np.flatnonzero(mask & (records["known"] != 0) & (records["elapsed"] > 0.0)):
            last, u = states.believed[i].copy(), samples.input[i].copy()
            try:
                after = self.plant.model.step(last, u, float(records["elapsed"][i]))
            except UNREADABLE:
                after = None
            carried = belief.real_numbers(after, last.shape)
            near = carried is not None and (np.abs(carried) <= FARTHEST).all()
            records["known"][i] = near
            states.believed[i] = carried if near else last

    def _terms(self, x: Array) -> tuple[tuple[Array, Array], Mask]:
        """Return f and g at N states, and (N,) where the model gives them."""
        model = self.plant.model
        try:
            return model.terms_of(x), np.ones(len(x), dtype=np.bool_)
        except UNREADABLE:
            pass
        f, g = np.zeros((len(x), model.n)), np.zeros((len(x), model.n, model.n_u))
        known = np.zeros(len(x), dtype=np.bool_)
        for i in range(len(x)):
            try:
                f[i], g[i] = model.terms(x[i])
                known[i] = True
            except UNREADABLE:
                continue
        return (f, g), known

    def _note_stops(self, x: Array, known: Mask) -> None:
        """Write the inputs of U nearest to those that stop the model; nearest 0 where unknown."""
        period, stops = self.plant.period, self._samples.plants["stop"]
        if period is None:
            return
        try:
            wanted = self.plant.model.brakes_of(x, period)
        except UNREADABLE:
            wanted = np.full(stops.shape, np.nan)
        wanted[~(np.isfinite(wanted).all(axis=1) & known)] = 0.0
        if isinstance(self.input_set, Box):
            stops[:] = self.input_set.project(wanted)
        else:
            stops[:] = [self.input_set.project(one) for one in wanted]
