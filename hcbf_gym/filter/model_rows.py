"""Rows of N plants of any model other than the planar double integrator.

A compiled step compares each sample with the model's prediction, raises alarms, chooses braking
inputs, and makes rows from f, g and the jets of barriers. Python evaluates users' own barriers.
"""

from itertools import chain
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
    """Makes the rows of all barriers. `PlanarRows` has the same methods for its model.

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
        """Return the attributes for a copy, with the memory of the compiled step in its place."""
        return {**vars(self), "_step": self._step.memory()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._step, self._is_bound = self._make_step(), False
        self._step.restore(state["_step"])

    def _make_step(self) -> _core.ModelStep:
        """Return the compiled step, which reads the samples and writes the rows."""
        config, plant, input_set = self._config, self._config.plant, self._config.input_set
        model, unused = plant.model, np.zeros(0)
        if isinstance(input_set, Box):
            low, high, vertices = input_set.low, input_set.high, unused
        else:
            low, high, vertices = unused, unused, input_set.vertices().ravel()
        return _core.ModelStep(
            model=compiled(model),
            uncertainty=np.array(config.reserve.settings),
            alphas=self._general_rows.alphas,
            inputs=(low, high, vertices),
            largest=largest_inputs(input_set),
            steered=~driven_by_inputs_alone(model),
            radius=input_set.radius,
            confidence=plant.uncertainty.confidence,
            period=plant.period or 0.0,
            velocity_at=-1 if model.velocity_at is None else model.velocity_at,
            count=config.count,
        )

    def check(self, barriers: object, given: BarrierSet) -> None:
        """Refuse barriers, and the set that was read from them, if this model has no such rows."""
        if isinstance(barriers, BarrierSet):
            raise InvalidInputError(
                f"plant: got the scenes of an environment with {self._config.plant.model}, "
                "expected a sequence of barriers: they have rows of the planar double integrator "
                "alone"
            )
        for scene in given.listed:
            if not all(isinstance(barrier, Barrier) for barrier in scene):
                raise InvalidInputError(
                    f"barriers: got {scene!r}, expected a sequence of objects of classes derived "
                    "from hcbf_gym.barriers.Barrier"
                )
            mapped = [barrier.name for barrier in scene if isinstance(barrier, Mapped)]
            if mapped:
                raise InvalidInputError(
                    f"barriers: got the classes {mapped} of a map, expected them for a plant of "
                    "the planar double integrator: only its rows look beyond the nearest piece"
                )

    def moves(self, scenes: BarrierSet) -> bool:
        """Return whether a barrier of N scenes depends on time."""
        n = self._config.plant.model.n
        distinct = {id(barrier): barrier for scene in scenes.listed for barrier in scene}
        barriers = (barrier for barrier in distinct.values() if isinstance(barrier, Barrier))
        return any(reads_time(barrier, n) for barrier in barriers)

    def resize(self, m: int) -> None:
        """Allocate the rows (N, m, WIDTH + n_u) of scenes of m barriers."""
        shape = self._config.count, m, WIDTH + self._config.input_set.n_u
        self._rows = PackedRows(np.zeros(shape))
        self._is_bound = False

    def snapshot(self) -> Snapshot:
        """Return a copy of the samples and of the compiled step's memory, for `restore`."""
        return self._samples.snapshot()._replace(model_step=self._step.memory())

    def restore(self, snapshot: Snapshot) -> None:
        """Set the samples and the compiled step's memory back to a snapshot."""
        self._samples.restore(snapshot)
        self._step.restore(snapshot.model_step)

    def accept(self, scenes: BarrierSet) -> ReachedBarriers:
        """Prepare changed scenes; return their distinct barriers and how inputs reach them."""
        self._prepared = None
        first: Any = scenes.listed[0]
        if not self._warned_of_concave:
            self._warned_of_concave = True
            functions = [barrier for barrier in first if isinstance(barrier, Function)]
            warn_of_concave(functions, self._config.plant.model)
        listed: Any = scenes.listed
        if all(scene is first for scene in listed):
            listed = [first] * self._config.count
        prepared = self._general_rows.prepare(listed)
        # regions are placed as of time 0, unlike the objects that were returned or set
        is_region = scenes.is_region
        prepared.scenes.parameters[is_region] = scenes.parameters[is_region]
        reaches = list(chain.from_iterable(prepared.reaches))
        period = self._config.plant.period
        if period is not None and any(reach.degree > 1 for reach in reaches):
            check_hold(period, alpha1=self._config.alpha1)
        self._prepared, self._is_bound = prepared, False
        distinct: Any = prepared.scenes.listed[: len(prepared.reaches)]
        return ReachedBarriers(list(chain.from_iterable(distinct)), reaches)

    def evaluate_previous(self, scenes: BarrierSet) -> bool:
        """Return False: only `PlanarRows` evaluates the scenes until now."""
        return False

    def make(self, scenes: BarrierSet, u_nominal: Array) -> Array:
        """Return the rows (N, m, WIDTH + n_u) of accepted scenes at the present samples and u*.

        States and motion are checked first. No rows are made if u* (N, n_u) is not finite.
        """
        self._kinks.u = u_nominal
        prepared, core = self._prepared, self._bound.core
        is_finite = core.sense(self._step, self._samples.is_uncertain)
        if is_finite and prepared is not None:
            if not self._is_bound:
                self._bind(prepared)
            entries = prepared.entries
            if entries:
                self._make_in_python(prepared, entries)
            else:
                core.make_rows(self._step)
        return self._rows.numbers

    def _bind(self, prepared: Prepared) -> None:
        """Let the compiled step read the prepared scenes and write into the rows."""
        self._rows.reads_position[...] = prepared.scenes.keeps_margin
        margins = prepared.margins(self._config.reserve.fixed)
        self._step.bind(*prepared.built_in, margins, self._rows.numbers)
        self._is_bound = True

    def _make_in_python(self, prepared: Prepared, entries: list[Entry]) -> None:
        """Write the rows of scenes in which Python evaluates the barriers of `entries`."""
        states, time, reserve = self._samples.states, self._samples.time, self._config.reserve
        uncertain = UncertainStates(states.x, time, states.model, states.lag, states.covariance)
        # only margins for an error of the position depend on slopes
        sloping = entries if self._samples.is_uncertain or reserve.is_steep else []
        m = self._rows.numbers.shape[1]
        with np.errstate(all="ignore"):
            self._step.reserve(*slopes_of(sloping, uncertain, reserve.settings, m))
            at_states = States(states.x, time, *self._step.terms())
            self._general_rows.write(prepared, at_states, self._rows)

    def _check_uncertainty(self) -> None:
        """Refuse an uncertainty that has no meaning for the model."""
        model, declared = self._config.plant.model, self._config.plant.uncertainty
        meaningless: dict[str, str] = {}  # field of `Uncertainty` → why
        if model.velocity_at != 2:
            no_velocity = "it has no velocity in x[2:4] that a speed limit reads"
            meaningless = {"speed": no_velocity, "speed_per_velocity": no_velocity}
        if declared.per_velocity > 0.0 and not has_drift(model):
            reason = "its velocity is the input, so that no body lags behind it"
            meaningless["per_velocity"] = reason
        for name, reason in meaningless.items():
            value = getattr(declared, name)
            if value > 0.0:
                raise InvalidInputError(
                    f"plant: uncertainty: {name}: got {value:g} with {model}, expected 0: {reason}"
                )


def has_drift(model: ReducedOrderModel) -> bool:
    """Return whether the velocity under one input differs between sampled states."""
    terms = model.terms_of(samples(model)[0])
    return any(np.ptp(term[:, : model.n_p], axis=0).any() for term in terms)


def driven_by_inputs_alone(model: ReducedOrderModel) -> Mask:
    """Return (n,) which entries of x inputs drive directly, and f neither moves nor depends on."""
    states, _ = samples(model)
    is_driven = np.zeros(model.n, dtype=np.bool_)
    has_part_in_drift = np.zeros(model.n, dtype=np.bool_)
    for x in states:
        f = model.f(x)
        is_driven |= (model.g(x) != 0.0).any(axis=1)
        has_part_in_drift |= f != 0.0
        for k in range(model.n):
            shifted = x + 0.1 * (np.arange(model.n) == k)
            has_part_in_drift[k] |= bool((model.f(shifted) != f).any())
    return is_driven & ~has_part_in_drift
