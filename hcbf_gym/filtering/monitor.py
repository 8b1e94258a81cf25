"""Does the environment apply what the filter chose? The input it seems to have received tells.

At every sample the state's change over one period is compared with what the model makes of the
chosen input. The difference, as an input Δu, says two things.

``model_error`` is its root mean square with the time constant `WINDOW`,
``E ← E + (T/τ)(‖Δu‖² − E)``.

The alarm counts samples, so that it makes no difference how large they are. A sample tells
something where the filter asked for something, ``‖u‖ > FLOOR ū`` with ū the largest input; then it
is missed where ``‖Δu‖ > SHARE ‖u‖``. The alarm is raised where most of the last `TELLING` samples
that tell were missed. A gain of 2 misses every one that is not cut off at the limits.

A double integrator that meets most of them to ``‖Δu‖ ≤ EXACT ‖u‖`` is exact, and few
misses are significant there: where more than `FEW` of them are off by ``OFF_EXACT ‖u‖``, that
alarms, too. So every third input that is reversed, or braking that is weakened, is seen.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from hcbf_gym.arrays import Array, Mask, Records
from hcbf_gym.barriers.relative_degree import samples
from hcbf_gym.models.input_sets import Box, InputSet
from hcbf_gym.models.plant import Reason
from hcbf_gym.models.reduced_order import ReducedOrderModel

WINDOW = 0.5
"""τ, over which squared errors are averaged [s]."""
FLOOR = 0.05
"""Share of the largest input below which a chosen input tells nothing: rounding, noise at rest."""
SHARE = 0.5
"""Share of the chosen input from which on it was missed: a gain of 2 is off by all of it."""
TELLING = 25
"""Samples over which the share of misses is averaged."""
LEAST_SAMPLES = 10
"""Telling samples since the reset before which no alarm is raised."""
MOST = 0.5
"""Share of misses above which the alarm is raised; of exact samples above which a plant is so."""
EXACT, OFF_EXACT = 0.02, 0.1
"""Share of the chosen input up to which it was met exactly, and from which on it was not at all."""
FEW = 0.1
"""Share of samples that are off above which an exact plant alarms: three in a row."""

STILL = 0.002
"""Share of what the largest inputs change in τ below which a motion tells nothing."""
OFF = 0.08
"""Share of the motion from which on it is another one than the model's."""
APART = 0.6
"""By how much of T (ẋ' − ẋ) two ways to integrate differ: one half for Euler's, and rounding."""
IN_A_ROW = 3
"""Samples in a row at which the motion must be off."""
CONFIDENCE = 3.0
"""κ, standard deviations of the state that explain what is missed."""

_ROUNDING = 1e-9
_EPSILON, _MOST_SWEEPS = 1e-15, 30  # of `pseudo_inverse`
_WRAPPED = 0.5  # how near to a whole turn a jump must be to be one [rad]

ACCOUNT = [
    ("error", "f8"),  # E
    ("missed", "f8"),  # the share of misses
    ("exact", "f8"),  # the share that was met exactly
    ("off", "f8"),  # the share that was off by more than an exact plant ever is
    ("samples", "f8"),  # that tell
]
"""What is remembered of the input's signal; zeros at a reset."""
_MEMORY = np.dtype((np.record, [*ACCOUNT, ("bend", "f8"), ("in_a_row", "f8")]))  # c, samples off
_NO_COVARIANCE = np.zeros((0, 0))


@njit(cache=True)
def account(memory: Any, error: float, chosen: float, rate: float, radius: float) -> bool:
    """Count one sample's ‖Δu‖² and ‖u‖², and return whether most were missed.

    Args:
        memory: a record with the fields of `ACCOUNT`, written to.
        error: ‖Δu‖².
        chosen: ‖u‖².
        rate: T/τ.
        radius: the largest norm of an input.
    """
    memory.error += min(1.0, rate) * (error - memory.error)
    if chosen > (FLOOR * radius) ** 2:
        memory.samples += 1.0
        share = 1.0 / min(memory.samples, TELLING)
        memory.missed += share * ((error > SHARE * SHARE * chosen) - memory.missed)
        memory.exact += share * ((error <= EXACT * EXACT * chosen) - memory.exact)
        memory.off += share * ((error > OFF_EXACT * OFF_EXACT * chosen) - memory.off)
    return memory.samples >= LEAST_SAMPLES and memory.missed > MOST


@njit(cache=True)
def breaks_off(memory: Any) -> bool:
    """Return whether a plant that meets inputs exactly has missed more than few of the last ones.

    Args:
        memory: a record with the fields of `ACCOUNT`, of a plant whose steps have no rounding.
    """
    return memory.samples >= TELLING and memory.exact > MOST and memory.off > FEW


class Watched(NamedTuple):
    """What a monitor never changes.

    Attributes:
        period: T [s].
        radius: the largest norm of an input.
        largest: (n_u,) of each input.
        steered: (n,) the states that Δu is read from.
    """

    period: float
    radius: float
    largest: Array
    steered: Mask


class Monitor:
    r"""Whether one plant of any model does what was chosen, and moves as its state says.

    Two channels. The *input*: Δu = g⁺(x' − step(x, u, T)) / T is accounted for as above.

    The *motion*: what no input explains. With û = u + Δu, the input that seems to have arrived,
    and Π = I − g g⁺, the part of the state that no input reaches within one period,

    .. math::
        r ← (1 − T/τ) r + Π (x' − \text{step}(x, û, T)), \qquad m ← (1 − T/τ) m + Π (x' − x),

    and m' likewise for the step that the model expects. The alarm is raised where at `IN_A_ROW`
    samples

    .. math::
        ‖r‖ > \text{REST} + \text{OFF} · \max(‖m‖, ‖m'‖) + c + κ \sqrt{\text{tr}(Π P Π)}.

    REST is `STILL` of what the largest inputs change in τ, P the covariance of the state, and
    c ← (1 − T/τ) c + .6 T ‖Π(ẋ' − ẋ)‖ what two ways to integrate over one period can be apart.
    A state that an input drives at once and that drives no other, such as the position of a robot
    that takes velocities, belongs to the motion, too.

    Args:
        model: ẋ = f(x) + g(x)u.
        period: T [s]; None means that nothing can be expected of the next state.
        input_set: U.
    """

    def __init__(self, model: ReducedOrderModel, period: float | None, input_set: InputSet):
        self._model, self._period = model, period
        largest = np.full(model.n_u, input_set.radius)
        if isinstance(input_set, Box):
            largest = np.maximum(-input_set.low, input_set.high)
        steered = ~_driven_alone(model)
        self._watched = Watched(period or 1.0, input_set.radius, largest, steered)
        self._memory = np.zeros(1, dtype=_MEMORY)
        self._sums = np.zeros((3, model.n))  # r, m and m'
        self.forget()

    def forget(self) -> None:
        """Start a new episode."""
        self._memory[:] = 0
        self._sums[:] = 0.0
        self._last: tuple[Array, Array, Array] | None = None
        self._terms: tuple[Array, Array] | None = None

    def skip(self) -> None:
        """Expect nothing of the next state, as the present one is not known."""
        self._last = None

    def expect(self, x: Array, model: Array, u: Array) -> None:
        """Note the states (n,) of the plant and of its model, and the input (n_u,) chosen now.

        Args:
            x: as it was observed last.
            model: likewise.
            u: held for one period.
        """
        if self._period is not None:
            self._last = x, model, u

    @property
    def error(self) -> float:
        """How far the plant's response is from the chosen input [unit of u]."""
        return math.sqrt(self._memory["error"][0])

    def observe(
        self,
        x: Array,
        model: Array,
        covariance: Array | None,
        terms: tuple[Array, Array] | None = None,
    ) -> Reason:
        """Account for what came of the last input, and return the alarm that this raises.

        Args:
            x: (n,) state of the body.
            model: (n,) the reduced-order model's own state; x where there is no other.
            covariance: (n, n) of x; None where it is the truth.
            terms: f (n,) and g (n, n_u) of the model at x, where they are known already.
        """
        now = self._model.terms(x) if terms is None else terms
        before, self._terms = self._terms, now
        if self._last is None or before is None:
            return Reason.NONE
        last, last_model, u = self._last
        watched, memory, period = self._watched, self._memory, self._watched.period
        spread = _NO_COVARIANCE if covariance is None else covariance
        alone = last is last_model
        g = before[1] if alone else self._model.terms(last_model)[1]
        expected = self._model.step(last_model, u, period)
        of_model = spread if model is x else _NO_COVARIANCE
        missed = _misses(watched, memory, model, expected, g, u, of_model)
        if not alone:
            expected = self._model.step(last, u, period)
        arrived, other, unreached = _arrival(watched, x, expected, before[1], u)
        if other:
            expected = self._model.step(last, arrived, period)
        sample = last, x, arrived, expected
        strays = _strays(watched, memory, self._sums, sample, before, now, unreached, spread)
        if missed:
            return Reason.INPUT
        return Reason.MOTION if strays else Reason.NONE


@njit(cache=True, error_model="numpy")
def _misses(
    watched: Watched,
    memory: Records,
    x: Array,
    expected: Array,
    g: Array,
    u: Array,
    covariance: Array,
) -> bool:
    """Account for Δu, where the state's noise does not hide it; return whether that alarms.

    Args:
        watched: what never changes.
        memory: (1,) written to.
        x: (n,) state of the model.
        expected: (n,) what was expected of it.
        g: (n, n_u) at the state before.
        u: (n_u,) chosen there.
        covariance: (n, n) of x; (0, 0) where it is the truth.
    """
    period = watched.period
    to_input = pseudo_inverse(g)
    off = to_input @ _missed(x, expected) / period
    error, chosen = (off * off).sum(), (u * u).sum()
    if not np.isfinite(error):
        return False
    if covariance.size > 0:
        noise = 2.0 * CONFIDENCE**2 * _trace(to_input, covariance) / period**2
        chosen *= SHARE**2 * chosen > noise
    return account(memory[0], error, chosen, period / WINDOW, watched.radius)


@njit(cache=True, error_model="numpy")
def _arrival(
    watched: Watched, x: Array, expected: Array, g: Array, u: Array
) -> tuple[Array, bool, Array]:
    """Return û (n_u,), whether it is not u, and Π (n, n).

    Args:
        watched: what never changes.
        x: (n,) state of the body.
        expected: (n,) what was expected of it.
        g: (n, n_u) at the state before.
        u: (n_u,) chosen there.
    """
    steered = g * watched.steered.reshape(-1, 1)
    to_input = pseudo_inverse(steered)
    off = to_input @ _missed(x, expected) / watched.period
    arrived = u + np.minimum(np.maximum(off, -2.0 * watched.largest), 2.0 * watched.largest)
    other = np.abs(arrived - u).max() > _ROUNDING * watched.radius
    return arrived, other, np.eye(x.size) - steered @ to_input


@njit(cache=True, error_model="numpy")
def _strays(
    watched: Watched,
    memory: Records,
    sums: Array,
    sample: tuple[Array, Array, Array, Array],
    before: tuple[Array, Array],
    now: tuple[Array, Array],
    unreached: Array,
    covariance: Array,
) -> bool:
    """Account for what no input explains, and return whether that alarms.

    Args:
        watched: what never changes.
        memory: (1,) written to.
        sums: (3, n) r, m and m', written to.
        sample: (n,) the state before, (n,) the present one, (n_u,) û, and (n,) what û leads to.
        before: f (n,) and g (n, n_u) at the state before.
        now: at the present one.
        unreached: Π.
        covariance: (n, n) of x; (0, 0) where it is the truth.
    """
    (last, x, arrived, expected), (f, g), period = sample, before, watched.period
    missed, meant = _missed(x, expected), expected - last
    strayed, expected_move = unreached @ missed, unreached @ meant
    turned = unreached @ (now[0] + now[1] @ arrived - f - g @ arrived)
    change = np.sqrt((turned * turned).sum())
    if not (np.isfinite(strayed.sum() + expected_move.sum()) and np.isfinite(change)):
        return False
    note = memory[0]
    fade = max(0.0, 1.0 - period / WINDOW)
    sums[0] = fade * sums[0] + strayed
    sums[1] = fade * sums[1] + expected_move + strayed
    sums[2] = fade * sums[2] + expected_move
    note.bend = fade * note.bend + APART * period * change
    off, moved, meant_to = np.sqrt((sums * sums).sum(axis=1))
    driven = g * watched.largest
    bound = STILL * WINDOW * np.sqrt((driven * driven).sum())
    bound += OFF * max(moved, meant_to) + note.bend + _ROUNDING * np.abs(x).max()
    if covariance.size > 0:
        bound += CONFIDENCE * np.sqrt(_trace(unreached, covariance))
    note.in_a_row = note.in_a_row + 1.0 if off > bound else 0.0
    return note.in_a_row >= IN_A_ROW


@njit(cache=True, error_model="numpy", inline="always")
def _trace(a: Array, covariance: Array) -> float:
    """Return tr(A P Aᵀ)."""
    return (a @ covariance * a).sum()


@njit(cache=True, error_model="numpy")
def pseudo_inverse(g: Array) -> Array:
    """Return g⁺ (n_u, n), by turning pairs of columns until all are orthogonal (Jacobi).

    Where the columns of g V are orthogonal, ``g⁺ = V diag(1/σ²) (g V)ᵀ``, σ their lengths; those
    below `_EPSILON` of the greatest count as 0.
    """
    columns, turns = g.copy(), np.eye(g.shape[1])
    for _ in range(_MOST_SWEEPS):
        still = True
        for i in range(g.shape[1]):
            for j in range(i + 1, g.shape[1]):
                a, b = (columns[:, i] ** 2).sum(), (columns[:, j] ** 2).sum()
                along = (columns[:, i] * columns[:, j]).sum()
                if not abs(along) > _EPSILON * np.sqrt(a * b):
                    continue
                still = False
                twist = (b - a) / (2.0 * along)
                tan = 1.0 / (abs(twist) + np.sqrt(1.0 + twist * twist))
                tan = tan if twist >= 0.0 else -tan
                cos = 1.0 / np.sqrt(1.0 + tan * tan)
                for part in (columns, turns):
                    for k in range(part.shape[0]):
                        first, second = part[k, i], part[k, j]
                        part[k, i] = cos * (first - tan * second)
                        part[k, j] = cos * (second + tan * first)
        if still:
            break
    sizes = (columns * columns).sum(axis=0)
    for j in range(sizes.size):
        if sizes[j] > _EPSILON**2 * sizes.max():
            turns[:, j] /= sizes[j]
        else:
            turns[:, j] = 0.0
    return turns @ columns.T


@njit(cache=True, error_model="numpy", inline="always")
def _missed(x: Array, expected: Array) -> Array:
    """Return x − expected (n,), without the whole turn of an angle that is wrapped."""
    missed = x - expected
    for k in range(missed.size):
        turned = missed[k] - 2.0 * np.pi * np.sign(missed[k])
        if abs(turned) < _WRAPPED:
            missed[k] = turned
    return missed


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
