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

from hcbf_gym.arrays import Array, Mask, Record, Records
from hcbf_gym.barriers.relative_degree import samples
from hcbf_gym.compilation import kernel
from hcbf_gym.errors import UNREADABLE
from hcbf_gym.filtering.belief import State
from hcbf_gym.filtering.monitor import (
    ALARM,
    INPUT,
    MOTION,
    SHARE,
    WINDOW,
    account,
    fade,
    latch,
    strays,
)
from hcbf_gym.models.input_sets import Box, InputSet
from hcbf_gym.models.reduced_order import ReducedOrderModel

STILL = 0.002
"""Share of what the largest inputs change in τ below which a motion tells nothing."""

_ROUNDING = 1e-9
_EPSILON, _MOST_SWEEPS = 1e-15, 30  # of `pseudo_inverse`
_WRAPPED = 0.5  # how near to a whole turn a jump must be to be one [rad]


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


class Seen(NamedTuple):
    """What two samples show of N plants.

    Attributes:
        now: this one.
        last: the one before.
        arrival: what came of the input between them.
        sums: (N, 3, n) r, m and m', written to.
    """

    now: Sample
    last: Sample
    arrival: Arrival
    sums: Array


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
        now = self._sample(states, terms, alone)
        last, watched, arrival = self._last, self._watched, self._arrival
        arrival.chosen[:] = inputs
        if watched.period > 0.0:
            self._expect(arrival.body, last.body, inputs)
            if last.model is last.body:
                arrival.model[:] = arrival.body
            else:
                self._expect(arrival.model, last.model, inputs)
            if _arrivals(watched, plants, believed, now.body, last.g, arrival):
                led = arrival.body.copy()
                self._expect(led, last.body, arrival.u)
                arrival.body[arrival.other] = led[arrival.other]
        seen = Seen(now, last, arrival, self._sums)
        observe(watched, plants, believed, states.covariance, seen)
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


@kernel(error_model="numpy", inline="always")
def _compares(watched: Watched, plant: Record, believed: bool) -> bool:
    """Return whether two samples are one period apart, and both are believed."""
    period = watched.period
    return believed and plant.follows != 0 and period > 0.0 and plant.elapsed == period


@kernel(error_model="numpy")
def _arrivals(
    watched: Watched,
    plants: Records,
    believed: Mask,
    x: Array,
    g: Array,
    arrival: Arrival,
) -> bool:
    """Write û and g⁺, and return whether any input seems to have been another one than chosen.

    Args:
        watched: what never changes.
        plants: (N,) `plants.PLANT`.
        believed: (N,) whether this sample is.
        x: (N, n) states of the bodies.
        g: (N, n, n_u) at the sample before.
        arrival: written to; its `body` holds what is expected of u.
    """
    some = False
    n, n_u = g.shape[1], g.shape[2]
    steered, columns, turns = np.empty((n, n_u)), np.empty((n, n_u)), np.empty((n_u, n_u))
    for i in range(plants.size):
        arrival.other[i] = False
        if not _compares(watched, plants[i], believed[i]):
            continue
        for k in range(n):
            for j in range(n_u):
                steered[k, j] = g[i, k, j] if watched.steered[k] else 0.0
        pseudo_inverse(steered, arrival.to_input[i], columns, turns)
        furthest = 0.0
        for j in range(n_u):
            off = 0.0
            for k in range(n):
                off += arrival.to_input[i, j, k] * _missed(x[i, k], arrival.body[i, k])
            most = 2.0 * watched.largest[j]
            off = min(max(off / watched.period, -most), most)
            arrival.u[i, j] = arrival.chosen[i, j] + off
            furthest = max(furthest, abs(off))
        arrival.other[i] = furthest > _ROUNDING * watched.radius
        some |= arrival.other[i]
    return some


@kernel(error_model="numpy")
def observe(
    watched: Watched,
    plants: Records,
    believed: Mask,
    covariance: Array,
    seen: Seen,
) -> None:
    """Account for a sample of N plants, and raise their alarms.

    Args:
        watched: what never changes.
        plants: (N,) `plants.PLANT`, written to.
        believed: (N,) whether this sample is.
        covariance: (N, n, n) of x; 0 where that is the truth.
        seen: what two samples show.
    """
    now, last, arrival = seen.now, seen.last, seen.arrival
    n, n_u = now.g.shape[1], now.g.shape[2]
    inverse, columns, turns = np.empty((n_u, n)), np.empty((n, n_u)), np.empty((n_u, n_u))
    parts = np.empty((4, n))
    for i in range(plants.size):
        plant = plants[i]
        if not believed[i]:
            continue
        if plant.fault >= ALARM:
            latch(plant, plant.fault)
        if _compares(watched, plant, True):
            pseudo_inverse(last.g_model[i], inverse, columns, turns)
            noisy = 0.0 if plant.has_model else _trace(inverse, covariance[i])
            chosen = arrival.chosen[i]
            if _misses(watched, plant, inverse, now.model[i], arrival.model[i], chosen, noisy):
                latch(plant, INPUT)
            if _moves_off(watched, plant, i, seen, covariance[i], parts):
                latch(plant, MOTION)
        plant.follows = 1


@kernel(error_model="numpy")
def _misses(
    watched: Watched,
    plant: Record,
    to_input: Array,
    x: Array,
    expected: Array,
    u: Array,
    noisy: float,
) -> bool:
    """Account for Δu, where the state's noise does not hide it; return whether that alarms.

    Args:
        watched: what never changes.
        plant: a `plants.PLANT` record, written to.
        to_input: (n_u, n) g⁺ at the state before.
        x: (n,) state of the model.
        expected: (n,) what was expected of it.
        u: (n_u,) chosen.
        noisy: tr(g⁺ P g⁺ᵀ).
    """
    period, error, chosen = watched.period, 0.0, 0.0
    for j in range(u.size):
        off = 0.0
        for k in range(x.size):
            off += to_input[j, k] * _missed(x[k], expected[k])
        off /= period
        error += off * off
        chosen += u[j] * u[j]
    if not np.isfinite(error):
        return False
    if SHARE**2 * chosen <= 2.0 * watched.confidence**2 * noisy / period**2 and noisy > 0.0:
        chosen = 0.0
    return account(plant, error, chosen, period / WINDOW, watched.radius)


@kernel(error_model="numpy")
def _moves_off(
    watched: Watched,
    plant: Record,
    i: int,
    seen: Seen,
    covariance: Array,
    parts: Array,
) -> bool:
    """Account for what no input explains of plant i, and return whether that alarms."""
    period, sums = watched.period, seen.sums[i]
    now, last, arrival = seen.now, seen.last, seen.arrival
    x, before, g, to_input = now.body[i], last.body[i], last.g[i], arrival.to_input[i]
    size = driven = 0.0
    for k in range(x.size):
        parts[0, k] = _missed(x[k], arrival.body[i, k])
        parts[1, k] = arrival.body[i, k] - before[k]
        parts[2, k] = now.f[i, k] - last.f[i, k]
        size = max(size, abs(x[k]))
        for j in range(arrival.u.shape[1]):
            parts[2, k] += (now.g[i, k, j] - g[k, j]) * arrival.u[i, j]
            driven += (g[k, j] * watched.largest[j]) ** 2
    for part in range(3):
        _unreached(g, watched.steered, to_input, parts[part], parts[3])
    change = total = 0.0
    for k in range(x.size):
        change += parts[2, k] ** 2
        total += parts[0, k] + parts[1, k] + parts[2, k]
    if not np.isfinite(total + change):
        return False
    left = fade(period)
    off = moved = meant = 0.0
    for k in range(x.size):
        sums[0, k] = left * sums[0, k] + parts[0, k]
        sums[1, k] = left * sums[1, k] + parts[1, k] + parts[0, k]
        sums[2, k] = left * sums[2, k] + parts[1, k]
        off += sums[0, k] ** 2
        moved += sums[1, k] ** 2
        meant += sums[2, k] ** 2
    rest = STILL * WINDOW * np.sqrt(driven) + _ROUNDING * size
    spread = watched.confidence * np.sqrt(
        _unreached_trace(g, watched.steered, to_input, covariance, parts)
    )
    return strays(
        plant, np.sqrt(off), np.sqrt(max(moved, meant)), np.sqrt(change), rest, spread, period
    )


@kernel(error_model="numpy", inline="always")
def _unreached(g: Array, steered: Mask, to_input: Array, v: Array, scratch: Array) -> None:
    """Take Π v in the place of v (n,); g counts in the steered states alone."""
    scratch[:] = v
    for j in range(g.shape[1]):
        along = 0.0
        for k in range(v.size):
            along += to_input[j, k] * scratch[k]
        for k in range(v.size):
            if steered[k]:
                v[k] -= g[k, j] * along


@kernel(error_model="numpy", inline="always")
def _unreached_trace(
    g: Array, steered: Mask, to_input: Array, covariance: Array, parts: Array
) -> float:
    """Return tr(Π P Π); Π is symmetric, so that it is tr(Π P)."""
    trace = 0.0
    for k in range(covariance.shape[0]):
        if covariance[k, k] == 0.0:
            continue
        parts[0, :] = covariance[:, k]
        _unreached(g, steered, to_input, parts[0], parts[3])
        trace += parts[0, k]
    return max(0.0, trace)


@kernel(error_model="numpy", inline="always")
def _trace(a: Array, covariance: Array) -> float:
    """Return tr(A P Aᵀ)."""
    trace = 0.0
    for j in range(a.shape[0]):
        for k in range(a.shape[1]):
            for q in range(a.shape[1]):
                trace += a[j, k] * covariance[k, q] * a[j, q]
    return trace


@kernel(error_model="numpy")
def pseudo_inverse(g: Array, out: Array, columns: Array, turns: Array) -> None:
    """Write g⁺ (n_u, n), by turning pairs of columns until all are orthogonal (Jacobi).

    Where the columns of g V are orthogonal, ``g⁺ = V diag(1/σ²) (g V)ᵀ``, σ their lengths; those
    below `_EPSILON` of the greatest count as 0.

    Args:
        g: (n, n_u).
        out: (n_u, n) written to.
        columns: (n, n_u) written to.
        turns: (n_u, n_u) written to.
    """
    n, n_u = g.shape
    columns[:, :] = g
    turns[:, :] = 0.0
    for j in range(n_u):
        turns[j, j] = 1.0
    for _ in range(_MOST_SWEEPS):
        still = True
        for i in range(n_u):
            for j in range(i + 1, n_u):
                a = b = along = 0.0
                for k in range(n):
                    a += columns[k, i] ** 2
                    b += columns[k, j] ** 2
                    along += columns[k, i] * columns[k, j]
                if not abs(along) > _EPSILON * np.sqrt(a * b):
                    continue
                still = False
                twist = (b - a) / (2.0 * along)
                tan = 1.0 / (abs(twist) + np.sqrt(1.0 + twist * twist))
                tan = tan if twist >= 0.0 else -tan
                cos = 1.0 / np.sqrt(1.0 + tan * tan)
                _turn(columns, i, j, cos, tan)
                _turn(turns, i, j, cos, tan)
        if still:
            break
    largest = 0.0
    for j in range(n_u):
        largest = max(largest, (columns[:, j] ** 2).sum())
    out[:, :] = 0.0
    for j in range(n_u):
        size = (columns[:, j] ** 2).sum()
        if size > _EPSILON**2 * largest:
            for i in range(n_u):
                for k in range(n):
                    out[i, k] += turns[i, j] / size * columns[k, j]


@kernel(error_model="numpy", inline="always")
def _turn(part: Array, i: int, j: int, cos: float, tan: float) -> None:
    """Turn two columns."""
    for k in range(part.shape[0]):
        first, second = part[k, i], part[k, j]
        part[k, i] = cos * (first - tan * second)
        part[k, j] = cos * (second + tan * first)


@kernel(error_model="numpy", inline="always")
def _missed(x: float, expected: float) -> float:
    """Return x − expected, without the whole turn of an angle that is wrapped."""
    missed = x - expected
    turned = missed - 2.0 * np.pi * np.sign(missed)
    return turned if abs(turned) < _WRAPPED else missed


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
