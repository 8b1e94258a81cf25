"""Rows of N plants of any model other than the planar double integrator.

A compiled step compares each sample with what the model predicted, raises alarms, chooses braking
inputs and makes rows from f, g and the jets of barriers. Python evaluates users' own barriers.
"""

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
from hcbf_gym.barriers.relative_degree import ReachedBarriers, samples
from hcbf_gym.barriers.rows import WIDTH, PackedRows, States
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.unknown import Entry, UncertainStates, largest_inputs, slopes_of
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.filter.bound import Bound
from hcbf_gym.filter.configured import FilterConfig
from hcbf_gym.filter.samples import Samples, Snapshot
from hcbf_gym.filter.settings import check_hold
from hcbf_gym.models.compiled import compiled
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.reduced_order import ReducedOrderModel


class ModelRows:
    """Makes the rows of all barriers. `PlanarRows` does the same for planar double integrators.

    Raises:
        InvalidInputError: if an uncertainty is declared that has no meaning for the model.
    """

    def __init__(self, config: FilterConfig, samples: Samples, bound: Bound):
        self._config, self._samples, self._bound = config, samples, bound
        model = config.plant.model
        self._general_rows = GeneralRows(
            model, config.alpha1, config.alpha2, config.input_set.support, config.alpha_speed
        )
        self._general_rows.kinks = self._kinks = Kinks()
        self._check_uncertainty()
        self._prepared: Prepared | None = None
        self._warned_of_concave = False
        self._step = self._make_step()
        self.resize(0)

    def __getstate__(self) -> dict[str, object]:
        """Return the attributes for a copy, with the memory of the step in place of the step."""
        return {**vars(self), "_step": self._step.memory()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._step, self._is_bound = self._make_step(), False
        self._step.restore(state["_step"])

    def _make_step(self) -> _core.ModelStep:
        """Return the compiled step, which reads samples and writes rows."""
        config, plant, u_set = self._config, self._config.plant, self._config.input_set
        nothing, model = np.zeros(0), plant.model
        limits = nothing, nothing, u_set.vertices().ravel()
        if isinstance(u_set, Box):
            limits = u_set.low, u_set.high, nothing
        return _core.ModelStep(
            compiled(model),
            np.array(config.reserve.settings),
            self._general_rows.alphas,
            limits,
            largest_inputs(u_set),
            ~driven_by_inputs_alone(model),
            u_set.radius,
            plant.uncertainty.confidence,
            plant.period or 0.0,
            -1 if model.velocity_at is None else model.velocity_at,
            config.count,
        )

    def check(self, barriers: object, given: BarrierSet) -> None:
        """Refuse barriers that have no rows of this model."""
        if isinstance(barriers, BarrierSet):
            raise InvalidInputError(
                f"plant: got the scenes of an environment with {self._config.plant.model}, "
                "expected a sequence of barriers: they have rows of the planar double integrator "
                "alone"
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
        """Return whether a barrier of N scenes depends on time."""
        distinct = {id(one): one for listed in scene.listed for one in listed}
        n = self._config.plant.model.n
        return any(reads_time(one, n) for one in distinct.values() if isinstance(one, Barrier))

    def resize(self, m: int) -> None:
        """Allocate the rows (N, m, WIDTH + n_u) of scenes of m barriers."""
        self._rows = PackedRows(
            np.zeros((self._config.count, m, WIDTH + self._config.input_set.n_u))
        )
        self._is_bound = False

    def snapshot(self) -> Snapshot:
        """Return a copy of the plants' records and of the step's memory, for `restore`."""
        return self._samples.snapshot()._replace(step=self._step.memory())

    def restore(self, snapshot: Snapshot) -> None:
        """Set records and memory back to a snapshot."""
        self._samples.restore(snapshot)
        self._step.restore(snapshot.step)

    def accept(self, scene: BarrierSet) -> ReachedBarriers:
        """Prepare changed scenes; return their barriers and how inputs reach them."""
        self._prepared = None
        first: Any = scene.listed[0]
        same = all(listed is first for listed in scene.listed)
        scenes: Any = [first] * self._config.count if same else scene.listed
        if not self._warned_of_concave:
            self._warned_of_concave = True
            own = [one for one in first if isinstance(one, Function)]
            warn_of_concave(own, self._config.plant.model)
        prepared = self._general_rows.prepare(scenes)
        placed = scene.is_region  # these shapes are where they are at time 0
        prepared.scenes.parameters[placed] = scene.parameters[placed]
        reaches = [reach for one in prepared.reaches for reach in one]
        period = self._config.plant.period
        if period is not None and any(reach.degree > 1 for reach in reaches):
            check_hold(period, alpha1=self._config.alpha1)
        self._prepared, self._is_bound = prepared, False
        distinct: Any = prepared.scenes.listed[: len(prepared.reaches)]
        return ReachedBarriers([one for entries in distinct for one in entries], reaches)

    def evaluate_previous(self, scene: BarrierSet) -> bool:
        """Return False: rows of other models are not evaluated for the scenes until now."""
        return False

    def make(self, scene: BarrierSet, u_nominal: Array) -> Array:
        """Return the rows at the present samples, whose states and motion are checked first."""
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
        """Let the compiled step read the prepared scenes and write into the rows."""
        self._rows.reads_position[...] = prepared.scenes.keeps_margin
        margins = prepared.margins(self._config.reserve.fixed)
        self._step.bind(*prepared.built_in, margins, self._rows.numbers)
        self._is_bound = True

    def _write(self, prepared: Prepared, entries: list[Entry]) -> None:
        """Write the rows of scenes in which Python evaluates `entries`."""
        states, time, reserve = self._samples.states, self._samples.time, self._config.reserve
        uncertain = UncertainStates(states.x, time, states.model, states.lag, states.covariance)
        sloping = entries if self._samples.has_parts or reserve.is_steep else []
        m = self._rows.numbers.shape[1]
        with np.errstate(all="ignore"):
            self._step.reserve(*slopes_of(sloping, uncertain, reserve.settings, m))
            at = States(states.x, time, *self._step.terms())
            self._general_rows.write(prepared, at, self._rows)

    def _check_uncertainty(self) -> None:
        """Refuse an uncertainty that has no meaning for the model."""
        model, declared = self._config.plant.model, self._config.plant.uncertainty
        reasons: dict[str, str] = {}
        if model.velocity_at != 2:
            without = "it has no velocity in x[2:4] that a speed limit reads"
            reasons = {"speed": without, "speed_per_velocity": without}
        if declared.per_velocity > 0.0 and not has_drift(model):
            reasons["per_velocity"] = "its velocity is the input, so that no body lags behind it"
        for name, reason in reasons.items():
            value = getattr(declared, name)
            if value > 0.0:
                raise InvalidInputError(
                    f"plant: uncertainty: {name}: got {value:g} with {model}, expected 0: {reason}"
                )


def has_drift(model: ReducedOrderModel) -> bool:
    """Return whether the velocity under one input differs between sampled states."""
    f, g = model.terms_of(samples(model)[0])
    return bool(np.ptp(f[:, : model.n_p], axis=0).any() or np.ptp(g[:, : model.n_p], axis=0).any())


def driven_by_inputs_alone(model: ReducedOrderModel) -> Mask:
    """Return (n,) the states that an input drives at once, and that have and cause no drift."""
    states, _ = samples(model)
    is_driven = np.zeros(model.n, dtype=np.bool_)
    drifts = np.zeros(model.n, dtype=np.bool_)
    for x in states:
        f = model.f(x)
        is_driven |= (model.g(x) != 0.0).any(axis=1)
        drifts |= f != 0.0
        for k in range(model.n):
            moved = x + 0.1 * (np.arange(model.n) == k)
            drifts[k] |= bool((model.f(moved) != f).any())
    return is_driven & ~drifts
