"""Rows of N plants of any model: usual rows from jets, with alarms and braking inputs."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.barrier import Barrier, reads_time
from hcbf_gym.barriers.convexity import warn_of_concave
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.general import GeneralRows
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.barriers.mapped import Mapped
from hcbf_gym.barriers.prepared import Prepared
from hcbf_gym.barriers.relative_degree import Reach, samples
from hcbf_gym.barriers.rows import WIDTH, PackedRows, States
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.unknown import Entry, Known, largest, slopes
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.filter.bound import Bound
from hcbf_gym.filter.configured import Configured
from hcbf_gym.filter.samples import Samples
from hcbf_gym.filter.settings import check_hold
from hcbf_gym.models.compiled import compiled
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.reduced_order import ReducedOrderModel


class ModelRows:
    """Makes rows, alarms and braking inputs from f, g and jets.

    Raises:
        InvalidInputError: if something is to be reserved that has no meaning for the model.
    """

    def __init__(self, made: Configured, samples: Samples, bound: Bound):
        self._made, self._samples, self._bound = made, samples, bound
        model = made.plant.model
        self._rows_of = GeneralRows(
            model, made.alpha1, made.alpha2, made.input_set.support, made.alpha_speed
        )
        self._rows_of.kinks = self._kinks = Kinks()
        self._check_uncertainty()
        self._prepared: Prepared | None = None
        self._warned_of_concave = False
        self._step = self._make_step()
        self.widen(0)

    def __getstate__(self) -> dict[str, object]:
        """Return what a copy needs; its step is compiled anew."""
        return {**vars(self), "_step": self._step.memory()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._step, self._is_bound = self._make_step(), False
        self._step.restore(state["_step"])

    def _make_step(self) -> _core.ModelStep:
        """Return the compiled step of the plants, up to their rows."""
        made, plant, u_set = self._made, self._made.plant, self._made.input_set
        nothing, model = np.zeros(0), plant.model
        limits = nothing, nothing, u_set.vertices().ravel()
        if isinstance(u_set, Box):
            limits = u_set.low, u_set.high, nothing
        return _core.ModelStep(
            compiled(model),
            np.array(made.reserve.settings),
            self._rows_of.alphas,
            limits,
            largest(u_set),
            ~driven_alone(model),
            u_set.radius,
            plant.uncertainty.confidence,
            plant.period or 0.0,
            -1 if model.velocity_at is None else model.velocity_at,
            made.count,
        )

    def check(self, barriers: object, given: BarrierSet) -> None:
        """Refuse barriers that have no rows of the model."""
        if isinstance(barriers, BarrierSet):
            raise InvalidInputError(
                f"plant: got the scenes of an environment with {self._made.plant.model}, expected "
                "a sequence of barriers: they have rows of the planar double integrator alone"
            )
        for scene in given.listed:
            if not all(isinstance(one, Barrier) for one in scene):
                raise InvalidInputError(
                    f"barriers: got {scene!r}, expected a sequence of objects of classes derived "
                    "from hcbf_gym.barriers.Barrier"
                )
            mapped = [one.name for one in scene if isinstance(one, Mapped)]
            if mapped:
                raise InvalidInputError(
                    f"barriers: got the classes {mapped} of a map, expected them for a plant of "
                    "the planar double integrator: only its rows look beyond the nearest piece"
                )

    def moves(self, scene: BarrierSet) -> bool:
        """Return whether a scene depends on time."""
        seen = {id(one): one for listed in scene.listed for one in listed}
        n = self._made.plant.model.n
        return any(reads_time(one, n) for one in seen.values() if isinstance(one, Barrier))

    def widen(self, m: int) -> None:
        """Make room for m rows."""
        self._rows = PackedRows(np.zeros((self._made.count, m, WIDTH + self._made.input_set.n_u)))
        self._is_bound = False

    def remembered(self) -> Any:
        """Return what is known of the plants, for `restore`."""
        return self._samples.remembered(), self._step.memory()

    def restore(self, remembered: Any) -> None:
        """Know what was known before."""
        known, memory = remembered
        self._samples.restore(known)
        self._step.restore(memory)

    def accept(self, scene: BarrierSet) -> tuple[Sequence[Barrier], Sequence[Reach]]:
        """Look at a changed scene, and return its barriers and how inputs reach them."""
        self._prepared = None
        first: Any = scene.listed[0]
        same = all(listed is first for listed in scene.listed)
        scenes: Any = [first] * self._made.count if same else scene.listed
        if not self._warned_of_concave:
            self._warned_of_concave = True
            own = [one for one in first if isinstance(one, Function)]
            warn_of_concave(own, self._made.plant.model)
        prepared = self._rows_of.prepare(scenes)
        shape = scene.is_region  # as of time 0
        prepared.scenes.parameters[shape] = scene.parameters[shape]
        reaches = [reach for one in prepared.reaches for reach in one]
        period = self._made.plant.period
        if period is not None and any(reach.degree > 1 for reach in reaches):
            check_hold(period, alpha1=self._made.alpha1)
        self._prepared, self._is_bound = prepared, False
        distinct: Any = prepared.scenes.listed[: len(prepared.reaches)]
        return [one for entries in distinct for one in entries], reaches

    def look_back(self, scene: BarrierSet) -> bool:
        """Return False: what conditions lacked of the scene until now is unknown."""
        return False

    def make(self, scene: BarrierSet, u_nominal: Array) -> Array:
        """Check the states, compare them with what was expected, and return the rows."""
        self._kinks.u = u_nominal
        prepared, core = self._prepared, self._bound.core
        if core.sense(self._step, self._samples.has_parts) and prepared is not None:
            if not self._is_bound:
                self._bind(prepared)
            entries = prepared.entries
            if entries:
                self._write(prepared, entries)
            else:
                core.make_rows(self._step)
        return self._rows.numbers

    def _bind(self, prepared: Prepared) -> None:
        """Let the compiled step read the scene and write into the rows."""
        self._rows.reads_position[...] = prepared.scenes.keeps_margin
        margins = prepared.margins(self._made.reserve.fixed)
        self._step.bind(*prepared.built_in, margins, self._rows.numbers)
        self._is_bound = True

    def _write(self, prepared: Prepared, entries: list[Entry]) -> None:
        """Write the rows of scenes of which Python evaluates some entries."""
        states, time, reserve = self._samples.states, self._samples.time, self._made.reserve
        known = Known(states.x, time, states.model, states.lag, states.covariance)
        uncertain = entries if self._samples.has_parts or reserve.is_steep else []
        m = self._rows.numbers.shape[1]
        with np.errstate(all="ignore"):
            self._step.reserve(*slopes(uncertain, known, reserve.settings, m))
            at = States(states.x, time, *self._step.terms())
            self._rows_of.write(prepared, at, self._rows)

    def _check_uncertainty(self) -> None:
        """Refuse what has no meaning for the model."""
        model, declared = self._made.plant.model, self._made.plant.uncertainty
        without = [name for name in ("speed", "speed_per_velocity") if model.velocity_at != 2]
        why = dict.fromkeys(without, "it has no velocity in x[2:4] that a speed limit reads")
        if declared.per_velocity > 0.0 and not drifts(model):
            why["per_velocity"] = "its velocity is the input, so that no body lags behind it"
        for name, reason in why.items():
            value = getattr(declared, name)
            if value > 0.0:
                raise InvalidInputError(
                    f"plant: uncertainty: {name}: got {value:g} with {model}, expected 0: {reason}"
                )


def drifts(model: ReducedOrderModel) -> bool:
    """Return whether the velocity under one input differs from state to state."""
    f, g = model.terms_of(samples(model)[0])
    return bool(np.ptp(f[:, : model.n_p], axis=0).any() or np.ptp(g[:, : model.n_p], axis=0).any())


def driven_alone(model: ReducedOrderModel) -> Mask:
    """Return (n,) which states an input drives at once, with no drift in them or from them."""
    states, _ = samples(model)
    driven = np.zeros(model.n, dtype=np.bool_)
    moves = np.zeros(model.n, dtype=np.bool_)
    for x in states:
        f = model.f(x)
        driven |= (model.g(x) != 0.0).any(axis=1)
        moves |= f != 0.0
        for k in range(model.n):
            moved = x + 0.1 * (np.arange(model.n) == k)
            moves[k] |= bool((model.f(moved) != f).any())
    return driven & ~moves
