"""Rows of N plants of any model other than the planar double integrator.

A compiled step compares each sample with the model's prediction, raises alarms, chooses braking
inputs, and makes rows from f, g and the jets of barriers. Python evaluates users' own barriers.
"""

from itertools import chain
from typing import Any, cast

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.convexity import warn_of_concave
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.general import GeneralRows
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.barriers.prepared import Conditions, Prepared
from hcbf_gym.barriers.relative_degree import ReachedBarriers
from hcbf_gym.barriers.rows import PackedRows, States
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.unknown import Entry, UncertainStates, largest_inputs, slopes_of
from hcbf_gym.filter.bound import Bound
from hcbf_gym.filter.configured import FilterConfig
from hcbf_gym.filter.row_maker import RowMaker
from hcbf_gym.filter.samples import Samples, Snapshot
from hcbf_gym.filter.settings import check_hold, check_uncertainty, input_states
from hcbf_gym.models.compiled import compiled
from hcbf_gym.models.input_sets import Box


class ModelRows(RowMaker):
    """Makes the rows of all barriers, those of built-in shapes in a compiled step.

    `accept` prepares changed scenes, and `resize` allocates their rows. After either, the next
    `make` binds the compiled step to these arrays. Each `make` checks the samples, and then lets
    the compiled step write all rows. They are written here if Python evaluates a barrier.

    Raises:
        InvalidInputError: if an uncertainty is declared that has no meaning for the model.
    """

    def __init__(self, config: FilterConfig, samples: Samples, bound: Bound):
        super().__init__(config, samples, bound)
        check_uncertainty(config.plant)
        model, support = config.plant.model, config.input_set.support
        self._general_rows = GeneralRows(
            model, config.alpha1, config.alpha2, support, config.alpha_speed
        )
        self._prepared: Prepared | None = None  # the accepted scenes; None if refused
        self._bound_rows: PackedRows | None = None  # `_rows` once the step is bound to it
        self._warned_of_concave = False
        self._step = self._make_step()

    def __getstate__(self) -> dict[str, object]:
        """Return the attributes for a copy, and the memory of the step, which cannot be copied."""
        return {**vars(self), "_step": self._step.memory()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._step, self._bound_rows = self._make_step(), None
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
            uncertainty=np.array(config.row_margins.settings),
            alphas=self._general_rows.alphas,
            inputs=(low, high, vertices),
            largest=largest_inputs(input_set),
            steered=input_states(model),
            radius=input_set.radius,
            confidence=plant.uncertainty.confidence,
            period=plant.period or 0.0,
            velocity_at=-1 if model.velocity_at is None else model.velocity_at,
            count=config.count,
        )

    def accept(self, scenes: BarrierSet) -> ReachedBarriers:
        """Prepare changed scenes; return their distinct barriers and how inputs reach them."""
        listed = cast("list[Conditions]", scenes.listed)  # `check_general` refuses `Shapes`
        if not self._warned_of_concave:
            self._warned_of_concave = True
            functions = [barrier for barrier in listed[0] if isinstance(barrier, Function)]
            warn_of_concave(functions, self._config.plant.model)
        if all(scene is listed[0] for scene in listed):
            listed = listed[:1] * self._config.count
        prepared = self._general_rows.prepare(listed)
        # regions are placed as of time 0, unlike the objects that were returned or set
        is_region = scenes.is_region
        prepared.barrier_set.parameters[is_region] = scenes.parameters[is_region]
        reaches = list(chain.from_iterable(prepared.reaches))
        period = self._config.plant.period
        if period is not None and any(reach.degree > 1 for reach in reaches):
            check_hold(period, alpha1=self._config.alpha1)
        self._prepared, self._bound_rows = prepared, None
        distinct_scenes = listed[: len(prepared.reaches)]
        return ReachedBarriers(list(chain.from_iterable(distinct_scenes)), reaches)

    def forget(self) -> None:
        """Forget the prepared scenes."""
        self._prepared = None

    def make(self, scenes: BarrierSet, u_nominal: Array) -> Array:
        """Return the rows (N, m, WIDTH + n_u) of accepted scenes at the present samples and u*.

        No rows are made if u* (N, n_u) is not finite, or if the scenes are refused.
        """
        prepared, core, self.errors = self._prepared, self._bound.core, {}
        # checks the samples, raises alarms and chooses braking inputs
        u_is_finite = core.sense(self._step, self._samples.is_uncertain)
        if u_is_finite and prepared is not None:
            if self._bound_rows is not self._rows:
                self._bind(prepared)
            if entries := prepared.entries:
                self._make_in_python(prepared, entries, Kinks(u_nominal, self._warned_of_kinks))
            else:
                core.make_rows(self._step)
        return self._rows.numbers

    def _bind(self, prepared: Prepared) -> None:
        """Let the compiled step read the prepared scenes and write into the rows."""
        self._rows.reads_position[...] = prepared.barrier_set.keeps_margin
        margins = prepared.margins(self._config.row_margins.fixed)
        self._step.bind(*prepared.built_in, margins, self._rows.numbers)
        self._bound_rows = self._rows

    def _make_in_python(self, prepared: Prepared, entries: list[Entry], kinks: Kinks) -> None:
        """Write the rows of scenes in which Python evaluates the barriers of `entries`."""
        states, time, margins = self._samples.states, self._samples.time, self._config.row_margins
        uncertain = UncertainStates(states.x, time, states.model, states.lag, states.covariance)
        # only margins for an error of the position depend on slopes
        sloping = entries if self._samples.is_uncertain or margins.is_steep else []
        m = self._rows.numbers.shape[1]
        with np.errstate(all="ignore"):
            slopes = slopes_of(sloping, uncertain, margins.settings, m)
            self._step.reserve(*slopes)  # writes the margins of all rows
            at_states = States(states.x, time, *self._step.terms())
            self.errors = self._general_rows.write_isolating_errors(
                prepared, at_states, self._rows, kinks
            )

    def snapshot(self) -> Snapshot:
        """Return a copy of the samples and of the compiled step's memory, for `restore`."""
        return super().snapshot()._replace(model_step=self._step.memory())

    def restore(self, snapshot: Snapshot) -> None:
        """Set the samples and the compiled step's memory back to a snapshot."""
        super().restore(snapshot)
        self._step.restore(snapshot.model_step)
