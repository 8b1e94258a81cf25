"""Declared noise of a velocity raises the alarm INPUT, although the plant is its model.

``python -m benchmarks.noisy_velocity`` prints for each deviation in how many drives of 20 s it did:
with measured states, and with those of a Kalman filter that knows the input.
"""

import warnings

import numpy as np

import hcbf_gym
from hcbf_gym._core import Reason
from hcbf_gym.barriers import Barrier, Disc, SpeedLimit
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.plant import Estimate

T, LARGEST, COUNT, STEPS = 0.02, 5.0, 100, 1000
DEVIATIONS = 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0  # of a velocity [mm/s]
POSITION, MODEL = 0.01, 0.05  # Deviations of a position [m], and of the model's input [m/s²]
SCENE: list[Barrier] = [
    Disc("rock", 1, (2.0, 0.0), 0.5), Disc("grass", 2, (-2.0, 0.5), 0.6), SpeedLimit("cap", 1, 1.5)
]  # fmt: skip
STEP = np.kron([[1.0, T], [0.0, 1.0]], np.eye(2))  # x' = STEP x + HELD u
HELD = np.kron([[0.5 * T**2], [T]], np.eye(2))


def alarmed(deviation: float, filters: bool) -> int:
    """Return how many of `COUNT` drives to changing goals raised an alarm."""
    rng, safe = np.random.default_rng(0), hcbf_gym.BatchFilter(Box.symmetric(LARGEST), T, COUNT)
    safe.set_scene(SCENE)
    noise = np.diag(np.repeat([POSITION, 1e-3 * deviation], 2) ** 2)
    x, t, seen = np.zeros((COUNT, 4)), np.zeros(COUNT), np.zeros(COUNT, dtype=np.bool_)
    guess, spread, u = x, noise, np.zeros((COUNT, 2))
    goals = x[:, :2]
    safe.reset(x=Estimate(x, t, np.tile(spread, (COUNT, 1, 1))))
    for k in range(STEPS):
        goals = rng.uniform(-3.0, 3.0, (COUNT, 2)) if k % 250 == 0 else goals
        measured = x + rng.normal(size=x.shape) * np.sqrt(np.diag(noise))
        if filters and k:
            guess = guess @ STEP.T + u @ HELD.T
            spread = STEP @ spread @ STEP.T + MODEL**2 * HELD @ HELD.T
            gain = spread @ np.linalg.inv(spread + noise)
            guess, spread = guess + (measured - guess) @ gain.T, spread - gain @ spread
        else:
            guess = measured
        wanted = np.clip(1.5 * (goals - x[:, :2]) - 2.0 * x[:, 2:], -LARGEST, LARGEST)
        u, report = safe(wanted, Estimate(guess, t, np.tile(spread, (COUNT, 1, 1))), t)
        seen |= report["reason"] == Reason.INPUT
        x, t = x @ STEP.T + u @ HELD.T, t + T
    return int(seen.sum())


def main() -> None:
    """Print what is seen."""
    warnings.simplefilter("ignore")
    for deviation in DEVIATIONS:
        measured, filtered = alarmed(deviation, False), alarmed(deviation, True)
        print(f"{deviation:4.1f} mm/s: {measured} measured, {filtered} filtered, of {COUNT}")


if __name__ == "__main__":
    main()
