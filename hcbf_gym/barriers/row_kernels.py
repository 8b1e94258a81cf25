r"""Rows of the double integrator, compiled: the usual ones, and those for an input that is held.

`docs/rows.md` derives them. A held row keeps h ≥ 0 between two samples, too: with T the period, r
the velocity in the barrier's frame, m the margin and ṁ its rate, and H convex with ‖∇H‖ ≤ 1,

.. math::
    h(τ) - m(τ) & ≥ (h - m) + (\dot h - \dot m) τ + ½ a·u τ², \\
    \dot h(T) & ≥ \dot h + a·u T - ν,

and the row requests :math:`ψ(T) ≥ ψ - T α₂(ψ)` in terms of these bounds. It is linear in u because
a chord bounds α₁ from below.
"""

import numpy as np

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import class_k, kernels, layout, shapes, speed_limit, zone
from hcbf_gym.barriers.layout import CUSTOM, SPEED_LIMIT, ZONE
from hcbf_gym.barriers.rows import ALPHA1, ALPHA2, HELD, HIGH, LOW, PERIOD, U_MAX
from hcbf_gym.compilation import kernel

B, H, ALPHA2_PSI, PSI = range(4)
"""What `rows` writes into the first axis of its output."""

Row = tuple[float, float, float]
"""b, α₂(ψ) and ψ."""
PlacedRow = tuple[float, float, float, float]
"""Of a row on the position also by how much less h − m gains with every input than a·u [m/s²]."""


@kernel(error_model="numpy")
def rows(
    kind: Integers,
    parameters: Array,
    margin: Array,
    x: Array,
    t: Array,
    settings: Array,
    a: Array,
    out: Array,
) -> None:
    """Write the rows ``a·u ≥ b`` of N states; a user's own barriers are passed over.

    Classes of maps have no row, see `mapped.nearby`: NaN stands there.

    Args:
        kind: (N, m) as `BarrierSet` holds it.
        parameters: (N, m, 19) as `BarrierSet` holds it.
        margin: (3 or more, N, m) what each row reserves between h and zero, the rate of that, and
            the rate of that again.
        x: (N, 4) positions [m] and velocities [m/s].
        t: (N,) times [s].
        settings: (15,) `RowSettings.packed`.
        a: (N, m, 2) the gradients.
        out: (4, N, m) b, h, α₂(ψ) and ψ.
    """
    alpha1, alpha2 = settings[ALPHA1 : ALPHA1 + 4], settings[ALPHA2 : ALPHA2 + 4]
    for i in range(x.shape[0]):
        for k in range(kind.shape[1]):
            which, c = kind[i, k], parameters[i, k]
            if which == CUSTOM:
                continue
            if which == layout.NONE:
                leave_out(i, k, a, out)
                continue
            if which == layout.MAPPED or which == layout.ZONES:
                out[:, i, k], a[i, k, :] = np.nan, np.nan  # only the nearby pieces have rows
                continue
            if which == ZONE:
                limit = c[layout.V_MAX]
                a[i, k, 0], a[i, k, 1] = -x[i, 2] / limit, -x[i, 3] / limit
                h = zone.value(limit, c[layout.AWAY], x[i, 2], x[i, 3])
                closing = c[layout.AWAY_X] * x[i, 2] + c[layout.AWAY_Y] * x[i, 3]
                b, alpha2_psi, psi = zone.row(
                    h - margin[0, i, k], margin[1, i, k], closing, x[i, 2], x[i, 3], limit,
                    settings, settings[U_MAX],
                )  # fmt: skip
            elif which == SPEED_LIMIT:
                v_max = c[layout.V_MAX]
                a[i, k, 0], a[i, k, 1] = -x[i, 2] / v_max, -x[i, 3] / v_max
                h = speed_limit.value(v_max, x[i, 2], x[i, 3])
                b, alpha2_psi, psi = speed_row(
                    h - margin[0, i, k], margin[1, i, k], x[i, 2], x[i, 3], v_max, alpha2, settings
                )
            else:
                qx, qy = kernels.in_frame(c, x[i, 0], x[i, 1], t[i])
                rx, ry = x[i, 2] - c[layout.VELOCITY_X], x[i, 3] - c[layout.VELOCITY_Y]
                h, gx, gy, distance, tx, ty = shapes.jet(which, c, qx, qy)
                a[i, k, 0], a[i, k, 1] = gx, gy
                kept, rate = h - margin[0, i, k], gx * rx + gy * ry - margin[1, i, k]
                sideways = abs(tx * rx + ty * ry)
                if settings[HELD] == 0.0:
                    b, alpha2_psi, psi, lost = _usual_row(
                        kept, rate, margin[2, i, k], sideways, distance, alpha1, alpha2
                    )
                else:
                    speed = np.sqrt(rx * rx + ry * ry)
                    reach = reach_of(speed, settings)
                    distance, radius, is_point = shapes.core(which, c, qx, qy, h, distance, reach)
                    kept -= beside_core(radius, settings)
                    across = sideways if is_point else 0.0
                    b, alpha2_psi, psi, lost = held_row(
                        kept, rate, margin[2, i, k], speed, across, distance, settings
                    )
                if psi < 0.0:
                    b = max(b, late(kept, rate, lost, support(settings, gx, gy)))
            out[B, i, k], out[H, i, k] = b, h
            out[ALPHA2_PSI, i, k], out[PSI, i, k] = alpha2_psi, psi


@kernel(error_model="numpy", inline="always")
def leave_out(i: int, k: int, a: Array, rows: Array) -> None:
    """Write what stands where there is no row: every input meets it.

    Args:
        i: which state.
        k: which place.
        a: (N, M, n_u) gradients, written to.
        rows: (4, N, M) b, h, α₂(ψ) and ψ, written to.
    """
    a[i, k, :] = 0.0
    rows[B, i, k] = -1.0
    rows[H, i, k] = rows[ALPHA2_PSI, i, k] = rows[PSI, i, k] = 1.0


@kernel(error_model="numpy")
def _usual_row(
    kept: float,
    rate: float,
    quickening: float,
    sideways: float,
    distance: float,
    alpha1: Array,
    alpha2: Array,
) -> PlacedRow:
    """Return the row of a barrier on the position at this instant alone."""
    psi = rate + class_k.value(alpha1, kept)
    alpha2_psi = class_k.value(alpha2, psi)
    lost = quickening - sideways * sideways / distance  # what turns, turns h away by itself
    return lost - alpha2_psi - class_k.slope(alpha1, kept) * rate, alpha2_psi, psi, lost


@kernel(error_model="numpy")
def held_row(
    kept: float,
    rate: float,
    quickening: float,
    speed: float,
    sideways: float,
    distance: float,
    s: Array,
) -> PlacedRow:
    """Return the row of a barrier on the position while u is held for T.

    Args:
        kept: h − m, less what `beside_core` reserves [m].
        rate: ḣ − ṁ [m/s].
        quickening: m̈ [m/s²].
        speed: ‖r‖ in the barrier's frame [m/s].
        sideways: the speed across the direction from the core, 0 if that is no point [m/s].
        distance: from the core, as in `Core` [m]; infinite where the gradient does not turn.
        s: (15,) `RowSettings.packed`.
    """
    alpha1, alpha2 = s[ALPHA1 : ALPHA1 + 4], s[ALPHA2 : ALPHA2 + 4]
    period = s[PERIOD]
    half = half_step(s)
    psi = rate + class_k.value(alpha1, kept)
    alpha2_psi = class_k.value(alpha2, psi)

    end = kept + rate * period
    chord = min(class_k.slope(alpha1, end - half), class_k.slope(alpha1, end + half))
    promised = class_k.value(alpha1, end - half) + chord * half
    nu = turning(speed, sideways, distance, s) + quickening * period
    least = psi - period * alpha2_psi - rate + nu
    b = (least - promised) / (period + 0.5 * chord * period * period)
    if kept >= 0.0 and end >= 0.0:  # h >= 0 meanwhile, whatever α₁
        b = max(b, -2.0 * end / (period * period))
    return b, alpha2_psi, psi, nu / period


@kernel(error_model="numpy", inline="always")
def half_step(s: Array) -> float:
    """Return ½ ū T², the most that a held input moves h by [m]."""
    return 0.5 * s[U_MAX] * s[PERIOD] * s[PERIOD]


@kernel(error_model="numpy", inline="always")
def beside_core(radius: float, s: Array) -> float:
    """Return what h keeps so that no held input reaches the core of a region [m].

    Args:
        radius: how far the region reaches beyond its core [m].
        s: (15,) `RowSettings.packed`.
    """
    return max(0.0, half_step(s) - radius)


@kernel(error_model="numpy", inline="always")
def late(kept: float, rate: float, lost: float, most: float) -> float:
    """Return what a row requests where ψ < 0: to stop at h = m at a constant rate, if U can.

    Args:
        kept: h − m [m].
        rate: ḣ − ṁ [m/s].
        lost: of every input, by how much less h − m gains than a·u [m/s²].
        most: a·u of the input of U that gives most of it [m/s²].
    """
    if rate >= 0.0 or kept <= 0.0:
        return -np.inf
    return min(rate * rate / (2.0 * kept) + lost, most)


@kernel(error_model="numpy", inline="always")
def support(s: Array, ax: float, ay: float) -> float:
    """Return the most that an input of U gives of a·u; −∞ where U is not known.

    U counts as the intersection of its limits and its radius.
    """
    if s[U_MAX] == 0.0:
        return -np.inf
    along_x, along_y = max(ax * s[LOW], ax * s[HIGH]), max(ay * s[LOW + 1], ay * s[HIGH + 1])
    return min(along_x + along_y, s[U_MAX] * np.sqrt(ax * ax + ay * ay))


@kernel(error_model="numpy")
def turning(speed: float, sideways: float, distance: float, s: Array) -> float:
    """Return ν, by how much ḣ(T) may fall short of ḣ + a·u T as the gradient turns [m/s]."""
    if distance == np.inf:
        return 0.0
    period, u_max, reach = s[PERIOD], s[U_MAX], reach_of(speed, s)
    mean = max(0.5 * u_max * period * period, 0.5 * (distance + max(distance - reach, 0.0)))
    loss = u_max * u_max * period**3 / (16.0 * mean)
    across = max(0.0, sideways - 0.5 * u_max * period)
    gain = distance * across * np.sqrt(period / (distance + reach) ** 3)
    return loss - max(0.0, gain - np.sqrt(loss)) ** 2


@kernel(error_model="numpy")
def reach_of(speed: float, s: Array) -> float:
    """Return ℓ, how far the barrier's frame sees the robot get in one period [m]."""
    return speed * s[PERIOD] + half_step(s)


@kernel(error_model="numpy")
def speed_row(
    kept: float,
    margin_rate: float,
    vx: float,
    vy: float,
    v_max: float,
    alpha2: Array,
    s: Array,
) -> Row:
    """Return b, α₂(ψ) and ψ = h of a speed limit; h is concave in v, so that u costs ‖u‖²."""
    alpha2_psi = class_k.value(alpha2, kept)
    b = -alpha2_psi
    if s[HELD] != 0.0:
        period = s[PERIOD]
        cost = s[U_MAX] * s[U_MAX] * period / (2.0 * v_max)
        b = max(b, cost - kept / period) if kept >= 0.0 else b + cost
        b = min(b, (vx * vx + vy * vy) / (v_max * period))  # a full stop gives no more
    return b + margin_rate, alpha2_psi, kept
