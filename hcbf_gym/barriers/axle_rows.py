r"""Rows of a differential drive: regions that stand bind its axle, all others the point before it.

A row ``n·p̈ ≥ b`` on the axle is one in the point's acceleration u (`models.axle`), linear because
the axle's is,

.. math::
    \big((n·ê) e + (T v/ℓ) (n·ê_⊥) e_⊥\big)·u ≥ b - v\, n·(ê - e)/T,

with ê the heading after one period at the present turning rate. `docs/rows.md` proves when braking
along the heading meets them all.
"""

from dataclasses import replace

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.rows import HIGH, LOW, RowSettings
from hcbf_gym.compilation import kernel
from hcbf_gym.models.axle import Axle, speeds

USED = 0.85
"""Share of the braking along the heading that a single row may ask for."""
PLACES = 200
"""How many approach speeds are looked at."""


@kernel(error_model="numpy")
def limit_axle(axle: Axle, x: Array, heading: float, settings: Array) -> None:
    """Write what the axle's acceleration may be at a state of the point into row settings.

    Args:
        axle: what limits the drive.
        x: (4,) state of the point.
        heading: of the axle [rad].
        settings: (15,) `RowSettings.packed`, written to.
    """
    v, _ = speeds(axle, x, heading)
    along, across = axle.braking, abs(v) * axle.turn
    cos, sin = abs(np.cos(heading)), abs(np.sin(heading))
    settings[HIGH], settings[HIGH + 1] = cos * along + sin * across, sin * along + cos * across
    settings[LOW], settings[LOW + 1] = -settings[HIGH], -settings[HIGH + 1]


@kernel(error_model="numpy")
def of_axle(
    axle: Axle, x: Array, heading: float, period: float, nx: float, ny: float, b: float
) -> tuple[float, float, float]:
    """Return a (2,) and b of a row in the point's acceleration, of one on the axle's mean one.

    Args:
        axle: what limits the drive.
        x: (4,) state of the point.
        heading: of the axle [rad].
        period: T [s]; 0 where it is not known.
        nx: of the row's gradient n.
        ny: likewise.
        b: of the row ``n·p̈ ≥ b`` [m/s²].
    """
    v, turning = speeds(axle, x, heading)
    cos, sin = np.cos(heading), np.sin(heading)
    later_cos, later_sin = np.cos(heading + turning * period), np.sin(heading + turning * period)
    along, across = nx * later_cos + ny * later_sin, ny * later_cos - nx * later_sin
    turned = period * v / axle.look_ahead * across
    if period > 0.0:
        b -= v * (along - nx * cos - ny * sin) / period
    else:
        b -= v * turning * across
    return along * cos - turned * sin, along * sin + turned * cos, b


@kernel(error_model="numpy")
def of_point(
    axle: Axle, x: Array, heading: float, period: float, nx: float, ny: float, b: float
) -> tuple[float, float, float]:
    """Return a (2,) and b of a row on the point: its velocity turns with the heading besides.

    Args: as `of_axle` takes them.
    """
    _, turning = speeds(axle, x, heading)
    turn = turning * period
    cos, sin = np.cos(turn), np.sin(turn)
    vx, vy = cos * x[2] - sin * x[3], sin * x[2] + cos * x[3]
    if period > 0.0:
        b -= (nx * (vx - x[2]) + ny * (vy - x[3])) / period
    else:
        b -= turning * (ny * x[2] - nx * x[3])
    turned = period / axle.look_ahead * (ny * vx - nx * vy)
    e_x, e_y = -np.sin(heading), np.cos(heading)
    return cos * nx + sin * ny + turned * e_x, cos * ny - sin * nx + turned * e_y, b


def share(settings: RowSettings, axle: Axle) -> float:
    """Return the greatest c ≤ 1 with which braking along the heading meets every row of α₁(c h).

    On ψ = 0 the robot nears a wall at the speed s = v cos φ and the row asks for b(s), to which
    braking along the heading gives A cos φ. With ``v ≤ V`` that is enough at every angle where
    ``(b(s) − b(0)) V/s ≤ .85 A`` for all s ≤ V. What it asks for at a glance, b(0), is reserved
    as a length, see `at_a_glance`. The slope of α₁ counts, at all speeds alike; so it is distances
    that are stretched, and not α₁ that is scaled.

    Args:
        settings: α₁, α₂ and the hold, with the axle's greatest acceleration.
        axle: what limits the drive.
    """
    if _asked(settings, axle) <= USED * axle.braking:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        scaled = replace(settings, alpha1=settings.alpha1.stretched(middle))
        if _asked(scaled, axle) <= USED * axle.braking:
            low = middle
        else:
            high = middle
    return low


def _asked(settings: RowSettings, axle: Axle) -> float:
    """Return the largest (b(s) − b(0)) V/s [m/s²]."""
    at_rest = _bound(settings, 0.0, 0.0)
    most = 0.0
    for speed in np.linspace(0.0, axle.forward, PLACES + 1)[1:].tolist():
        b = _bound(settings, settings.alpha1.inverse(speed), speed)
        most = max(most, (b - at_rest) * axle.forward / speed)
    return most


def at_a_glance(settings: RowSettings, jerk: float) -> float:
    """Return the least h − m at which a row asks for nothing of what does not near the wall [m].

    Args:
        settings: α₁, α₂ and the hold.
        jerk: what the row reserves of the acceleration, `Axle.jerk` [m/s²].
    """
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _bound(settings, middle, 0.0) + jerk <= 0.0:
            high = middle
        else:
            low = middle
    return high


def _bound(settings: RowSettings, kept: float, speed: float) -> float:
    """Return b of the row beside a wall that is `kept` away and neared at a speed."""
    if settings.held:
        return _core.held_row(kept, -speed, 0.0, speed, 0.0, np.inf, settings.packed)[0]
    psi = settings.alpha1.values(np.array([kept]))[0] - speed
    return settings.alpha1.derivative(kept) * speed - settings.alpha2.values(np.array([psi]))[0]
