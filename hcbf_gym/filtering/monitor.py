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

from typing import Any

import numpy as np
from numba import njit

from hcbf_gym.arrays import Array, Mask
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
_WRAPPED = 0.5  # how near to a whole turn a jump must be to be one [rad]

ACCOUNT = [
    ("error", "f8"),  # E
    ("missed", "f8"),  # the share of misses
    ("exact", "f8"),  # the share that was met exactly
    ("off", "f8"),  # the share that was off by more than an exact plant ever is
    ("samples", "f8"),  # that tell
]
"""What is remembered of the input's signal; zeros at a reset."""
_ACCOUNT = np.dtype((np.record, ACCOUNT))


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
        self._model = model
        self._period = period
        self._radius = input_set.radius
        largest = np.full(model.n_u, input_set.radius)
        self._largest = (
            np.maximum(-input_set.low, input_set.high) if isinstance(input_set, Box) else largest
        )
        self._steered = ~_driven_alone(model)
        self._memory = np.zeros(1, dtype=_ACCOUNT)
        self._inverses: list[tuple[Array, Array]] = []
        self.forget()

    def forget(self) -> None:
        """Start a new episode."""
        self._memory[:] = 0
        self._last: tuple[Array, Array, Array] | None = None
        self._sums = np.zeros((3, self._model.n))  # r, m and m'
        self._change, self._in_a_row = 0.0, 0

    def skip(self) -> None:
        """Expect nothing of the next state, as the present one is not known."""
        self._last = None

    def expect(self, x: Array, model: Array, u: Array) -> None:
        """Note the states (n,) of the plant and of its model, and the input (n_u,) chosen now."""
        if self._period is not None:
            self._last = x, model, u

    @property
    def error(self) -> float:
        """How far the plant's response is from the chosen input [unit of u]."""
        return float(np.sqrt(self._memory[0]["error"]))

    def observe(self, x: Array, model: Array, covariance: Array | None) -> Reason:
        """Account for what came of the last input, and return the alarm that this raises.

        Args:
            x: (n,) state of the body.
            model: (n,) the reduced-order model's own state; x where there is no other.
            covariance: (n, n) of x; None where it is the truth.
        """
        if self._last is None or self._period is None:
            return Reason.NONE
        last, last_model, u = self._last
        with np.errstate(all="ignore"):
            spread = covariance if model is x else None
            input_alarm = self._input_missed(last_model, model, u, spread)
            motion_alarm = self._motion_missed(last, x, u, covariance)
        if input_alarm:
            return Reason.INPUT
        return Reason.MOTION if motion_alarm else Reason.NONE

    def _input_missed(self, last: Array, x: Array, u: Array, covariance: Array | None) -> bool:
        """Account for Δu, where the state's noise does not hide it; tell whether that alarms."""
        period = self._period or 1.0
        g = self._model.g(last)
        to_input = self._inverse(g)
        off = to_input @ _missed(x, self._model.step(last, u, period)) / period
        error, chosen = float(off @ off), float(u @ u)
        if not np.isfinite(error):
            return False
        if covariance is not None:
            noise = 2.0 * CONFIDENCE**2 * np.trace(to_input @ covariance @ to_input.T)
            chosen *= float(SHARE**2 * chosen > noise / period**2)
        missed = account(self._memory[0], error, chosen, period / WINDOW, self._radius)
        return bool(missed)

    def _motion_missed(self, last: Array, x: Array, u: Array, covariance: Array | None) -> bool:
        """Account for what no input explains, and tell whether that alarms."""
        model = self._model
        period = self._period or 1.0
        g = model.g(last)
        steered = g * self._steered[:, None]
        to_input = self._inverse(steered)
        unreached = np.eye(model.n) - steered @ to_input
        expected = model.step(last, u, period)
        off = to_input @ _missed(x, expected) / period
        arrived = u + np.clip(off, -2.0 * self._largest, 2.0 * self._largest)
        if np.abs(arrived - u).max() > _ROUNDING * self._radius:
            expected = model.step(last, arrived, period)
        missed = _missed(x, expected)
        meant = expected - last
        turned = model.f(x) + model.g(x) @ arrived - model.f(last) - g @ arrived
        new = np.array([missed, meant + missed, meant]) @ unreached.T
        change = float(np.linalg.norm(unreached @ turned))
        if not np.isfinite(new).all() or not np.isfinite(change):
            return False
        fade = max(0.0, 1.0 - period / WINDOW)
        self._sums = fade * self._sums + new
        self._change = fade * self._change + APART * period * change
        strayed, moved, expected_move = np.linalg.norm(self._sums, axis=1).tolist()
        bound = STILL * WINDOW * float(np.linalg.norm(g * self._largest))
        bound += OFF * max(moved, expected_move) + self._change + _ROUNDING * np.abs(x).max()
        if covariance is not None:
            bound += CONFIDENCE * np.sqrt(np.trace(unreached @ covariance @ unreached.T))
        self._in_a_row = self._in_a_row + 1 if strayed > bound else 0
        return self._in_a_row >= IN_A_ROW

    def _inverse(self, g: Array) -> Array:
        """Return g⁺ (n_u, n), computed anew only where g has changed: mostly it is constant."""
        for known, inverse in self._inverses:
            if np.array_equal(known, g):
                return inverse
        inverse = np.linalg.pinv(g).astype(np.float64)
        self._inverses = [(g.copy(), inverse), *self._inverses[:1]]
        return inverse


def _missed(x: Array, expected: Array) -> Array:
    """Return x − expected (n,), without the whole turn of an angle that is wrapped."""
    missed = x - expected
    turn = 2.0 * np.pi * np.sign(missed)
    return np.where(np.abs(missed - turn) < _WRAPPED, missed - turn, missed)


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
