"""The monitor of N plants of any model: what its steps say of input and motion.

The input: Δu = g⁺(x' − step(x, u, T)) / T. The motion is what no input explains: with û = u + Δu,
the input that seems to have arrived, and Π = I − g g⁺, the part of the state that no input reaches
within one period,

    s = Π (x' − step(x, û, T)),        Δ = Π (x' − x).

A state that an input drives at once and that drives no other, such as the position of a robot that
takes velocities, belongs to the motion, too. `monitor` has what is made of them.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask, Records, numbers_of
from hcbf_gym.barriers.relative_degree import samples
from hcbf_gym.errors import UNREADABLE
from hcbf_gym.filtering.belief import State
from hcbf_gym.models.input_sets import Box, InputSet
from hcbf_gym.models.reduced_order import ReducedOrderModel


class Watched(NamedTuple):
    """What a monitor never changes.

    Attributes:
        period: T [s].
        radius: the largest norm of an input.
        confidence: κ.
        largest: (n_u,) of each input.
        steered: (n,) the states that Δu is read from.
    """

    period: float
    radius: float
    confidence: float
    largest: Array
    steered: Mask


class Sample(NamedTuple):
    """What a sample says of N plants.

    Attributes:
        body: (N, n) its state.
        model: (N, n) that of the reduced-order model.
        f: (N, n) at the body's.
        g: (N, n, n_u) at the body's.
        g_model: (N, n, n_u) at the model's.
    """

    body: Array
    model: Array
    f: Array
    g: Array
    g_model: Array


class Arrival(NamedTuple):
    """What seems to have become of the input that was chosen, written to.

    Attributes:
        chosen: (N, n_u) u.
        to_input: (N, n_u, n) g⁺.
        u: (N, n_u) û.
        other: (N,) whether it is another one than was chosen.
        body: (N, n) what it leads to.
        model: (N, n) what the chosen one leads the model to.
    """

    chosen: Array
    to_input: Array
    u: Array
    other: Mask
    body: Array
    model: Array


class ModelMonitor:
    """Compares what N plants of any model do with what was chosen.

    Args:
        model: ẋ = f(x) + g(x)u.
        period: T [s]; None means that nothing can be expected of the next state.
        input_set: U.
        confidence: κ, standard deviations of the state that explain what is missed.
        count: N.
    """

    def __init__(
        self,
        model: ReducedOrderModel,
        period: float | None,
        input_set: InputSet,
        confidence: float,
        count: int,
    ):
        n, n_u = model.n, model.n_u
        largest = np.full(n_u, input_set.radius)
        if isinstance(input_set, Box):
            largest = np.maximum(-input_set.low, input_set.high)
        steered = ~_driven_alone(model)
        self._model, self._count = model, count
        self._watched = Watched(period or 0.0, input_set.radius, confidence, largest, steered)
        states, inputs = np.zeros((count, n)), np.zeros((count, n, n_u))
        self._last = Sample(states, states, states, inputs, inputs)
        self._sums = np.zeros((count, 3, n))  # r, m and m'
        self._arrival = Arrival(
            np.zeros((count, n_u)),
            np.zeros((count, n_u, n)),
            np.zeros((count, n_u)),
            np.zeros(count, dtype=np.bool_),
            states.copy(),
            states.copy(),
        )

    def forget(self, mask: Mask) -> None:
        """Begin new episodes of the masked plants (N,)."""
        self._sums[mask] = 0.0

    def remembered(self) -> tuple[Sample, Array]:
        """Return what is known of the plants."""
        return self._last, self._sums.copy()

    def restore(self, remembered: tuple[Sample, Array]) -> None:
        """Know what `remembered` returned."""
        self._last, sums = remembered
        self._sums[:] = sums

    def watch(
        self,
        plants: Records,
        states: State,
        inputs: Array,
        terms: tuple[Array, Array],
        believed: Mask,
        alone: bool,
    ) -> None:
        """Account for what came of the last inputs, and raise the alarms that there are.

        Args:
            plants: (N,) `plants.PLANT`, written to.
            states: of them.
            inputs: (N, n_u) that were chosen at the sample before.
            terms: f (N, n) and g (N, n, n_u) at x.
            believed: (N,) whether this sample is.
            alone: whether model and body are one.
        """
        records, now = numbers_of(plants), self._sample(states, terms, alone)
        last, watched, arrival = self._last, self._watched, self._arrival
        arrival.chosen[:] = inputs
        if watched.period > 0.0:
            self._expect(arrival.body, last.body, inputs)
            if last.model is last.body:
                arrival.model[:] = arrival.body
            else:
                self._expect(arrival.model, last.model, inputs)
            if _core.model_arrivals(watched, records, believed, now.body, last.g, arrival):
                led = arrival.body.copy()
                self._expect(led, last.body, arrival.u)
                arrival.body[arrival.other] = led[arrival.other]
        _core.model_observe(
            watched, records, believed, states.covariance, (now, last), arrival, self._sums
        )
        self._last = now

    def _sample(self, states: State, terms: tuple[Array, Array], alone: bool) -> Sample:
        """Return what this sample says."""
        f, g = terms
        if alone:
            x = states.x.copy()
            return Sample(x, x, f, g, g)
        model, body = states.model.copy(), states.model + states.lag
        f, g = self._terms(body, terms)
        return Sample(body, model, f, g, self._terms(model, terms)[1])

    def _terms(self, x: Array, known: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return f and g at states; those that are known where the model returns none."""
        try:
            return self._model.terms_of(x)
        except UNREADABLE:
            return known

    def _expect(self, out: Array, x: Array, u: Array) -> None:
        """Write (N, n) where the model gets in a period; NaN where it does not say."""
        try:
            out[:] = self._model.steps_of(x, u, self._watched.period)
        except UNREADABLE:
            out[:] = np.nan


def _driven_alone(model: ReducedOrderModel) -> Mask:
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
