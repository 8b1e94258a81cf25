"""The gatekeeper's law again, in NumPy: one sample after the other, looked at densely in time."""

import numpy as np

from hcbf_gym.barriers import SpeedLimit

LOOKS = 60


def input_of(input_set, period, x, target, samples):
    """Return u of a manoeuvre that steers to a velocity for some more samples, then to rest."""
    wanted = target if samples > 0 else np.zeros(2)
    return input_set.project((wanted - x[2:]) / period)


def moved(x, u, span):
    """Return the state x (4,) after an input was held."""
    return np.concatenate([x[:2] + (x[2:] + 0.5 * u * span) * span, x[2:] + u * span])


def path(input_set, period, x, target, samples, most=2000):
    """Return the states (k + 1, 4) at the samples of a manoeuvre until rest, and inputs (k, 2)."""
    states, inputs = [x], []
    while (samples > 0 or np.linalg.norm(states[-1][2:]) > 1e-9) and len(inputs) < most:
        u = input_of(input_set, period, states[-1], target, samples)
        states.append(moved(states[-1], u, period))
        inputs.append(u)
        samples -= 1
    return np.array(states), np.array(inputs).reshape(-1, 2)


def reserves(barriers, period, states, inputs, start, keep, drift=0.0, sweep=8.0):
    """Return the least h − m − s t along a path and for some time at rest after it.

    Args:
        barriers: strict ones; of a speed limit the ends of periods count.
        period: T [s].
        states: (k + 1, 4) at the samples.
        inputs: (k, 2) between them.
        start: time of the first state [s].
        keep: m [m].
        drift: s [m/s].
        sweep: how long the robot is looked at while it rests [s].
    """
    least = np.inf
    for i, u in enumerate(inputs):
        for tau in np.linspace(0.0, period, LOOKS):
            since = i * period + tau
            x = moved(states[i], u, tau)
            least = min(least, _least(barriers, x, start + since) - keep - drift * since)
        for one in barriers:
            if isinstance(one, SpeedLimit):
                least = min(least, one.jet(moved(states[i], u, period)).h)
    end = len(inputs) * period
    rests = np.concatenate([states[-1][:2], np.zeros(2)])
    for later in np.arange(0.0, sweep, 0.01):
        least = min(least, _least(barriers, rests, start + end + later) - keep - drift * end)
    return least


def _least(barriers, x, t):
    """Return the least h of regions at a state and time."""
    return min(one.jet(x, t).h for one in barriers if not isinstance(one, SpeedLimit))
