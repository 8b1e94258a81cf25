"""The filter of N plants of any model: rows, alarms and braking inputs, made step by step."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.barrier import Barrier, reads_time
from hcbf_gym.barriers.convexity import warn_of_concave
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.general import GeneralRows, check_barriers
from hcbf_gym.barriers.prepared import Prepared
from hcbf_gym.barriers.relative_degree import Reach, samples
from hcbf_gym.barriers.rows import PLACED, WIDTH
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.unknown import Entry, Known, largest, slopes
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.filter.core import FilterCore, SceneArrays
from hcbf_gym.filter.settings import FilterSettings, check_hold
from hcbf_gym.models.compiled import compiled
from hcbf_gym.models.input_sets import Box, InputSet
from hcbf_gym.models.plant import Plant
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
        self._prepared: Prepared | None = None
        self._entries: list[Entry] = []  # conditions of the scene that are no built-in shapes
        self._said_concave = False
        self._step = self._make_step()
        self._make_room(0)
        self._read_static()

    def __getstate__(self) -> dict[str, object]:
        """Return what a copy needs; its step is compiled anew."""
        return {**vars(self), "_step": self._step.memory()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._step, self._is_bound = self._make_step(), False
        self._step.restore(state["_step"])

    def _make_step(self) -> _core.ModelStep:
        """Return the compiled step of the plants, up to their rows."""
        plant, u_set, model = self.plant, self.input_set, self.plant.model
        nothing = np.zeros(0)
        limits = nothing, nothing, u_set.vertices().ravel()
        if isinstance(u_set, Box):
            limits = u_set.low, u_set.high, nothing
        return _core.ModelStep(
            compiled(model),
            np.array(self.reserve.settings),
            np.stack((self.alpha1.parameters(), self.alpha2.parameters())),
            limits,
            largest(u_set),
            ~driven_alone(model),
            u_set.radius,
            plant.uncertainty.confidence,
            plant.period or 0.0,
            -1 if model.velocity_at is None else model.velocity_at,
            self.count,
        )

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
        self._is_bound = False

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

    def _bind(self, prepared: Prepared) -> None:
        """Let the step make the rows of these scenes from now on."""
        self._own[..., PLACED] = prepared.share > 0.0
        self._step.bind(*prepared.scene, prepared.margins(self.reserve.fixed), self._own)
        self._is_bound = True

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
        self._prepared, self._entries, self._is_bound = prepared, prepared.entries, False
        distinct = prepared.scenes[: len(prepared.reaches)]
        return [one for entries in distinct for one in entries], reaches

    def _enter(self, goal: object, extent: object, is_first: bool) -> None:
        """Nothing more is known of scenes that begin."""

    def _remembered(self) -> Any:
        """Return what is known of the plants, for `_restore`."""
        return super()._remembered(), self._step.memory()

    def _restore(self, remembered: Any) -> None:
        """Know what was known before."""
        samples, memory = remembered
        super()._restore(samples)
        self._step.restore(memory)

    def _made(self, scene: BarrierSet, u_nominal: Array) -> tuple[SceneArrays, Array]:
        """Look at the states, compare them with what was expected, and make the rows."""
        told, prepared = self._samples.told, self._prepared
        filter_of = self._filter_of
        if filter_of.sense(self._step, told) and prepared is not None:
            if not self._is_bound:
                self._bind(prepared)
            if self._entries:
                self._make_rows(prepared)
            else:
                filter_of.make_rows(self._step)
        numbers = scene.kind, scene.parameters, scene.priority, scene.own_margin
        return (*numbers, scene.atlas.numbers), self._own

    def _make_rows(self, prepared: Prepared) -> None:
        """Make the rows of scenes in which users have conditions of their own."""
        samples, reserve = self._samples, self.reserve
        states, time = samples.states, samples.time
        known = Known(states.x, time, states.model, states.lag, states.covariance)
        bends = samples.told or reserve.is_steep
        with np.errstate(all="ignore"):
            of_rows = self._entries if bends else (), known, reserve.settings.confidence
            self._step.reserve(*slopes(*of_rows, self._own.shape[1]))
            self._rows_of.write(prepared, states.x, time, self._step.terms(), self._own)


def driven_alone(model: ReducedOrderModel) -> Mask:
    """Return (n,) which states an input drives at once, with no drift in them or from them."""
    states, _ = samples(model)
    driven = np.zeros(model.n, dtype=np.bool_)
    drifts = np.zeros(model.n, dtype=np.bool_)
    for x in states:
        f = model.f(x)
        driven |= (model.g(x) != 0.0).any(axis=1)
        drifts |= f != 0.0
        for k in range(model.n):
            moved = x + 0.1 * (np.arange(model.n) == k)
            drifts[k] |= bool((model.f(moved) != f).any())
    return driven & ~drifts
