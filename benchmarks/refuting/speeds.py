"""Lemmas 7 and 12, of limits on the speed."""

import numpy as np

from benchmarks.refuting.cases import BETA, LOOKS, Array, Case, log_of
from hcbf_gym import _core
from hcbf_gym.barriers import layout, rows


def speed(case: Case, z: Array, zone: bool) -> tuple[Array, Array]:
    """Return by how much lemma 7 or 12 holds, and by how much b is below a stop (and ṁ)."""
    span, top = case.period, case.u_max
    own = log_of(z[:, 0], -3, 0)
    limit = (top * span + 2.0 * own) * (1.0 + log_of(z[:, 1], -4, 1))
    drift = log_of(z[:, 2], -3, 0) * zone
    away, inside = log_of(z[:, 3], -4, 0.5), z[:, 4] < 0.3
    gap = 0.3 * np.where(inside, -z[:, 5], away)
    if zone:
        gained = span * np.sqrt(top**2 + BETA * top + BETA**2)
        limit = (own + np.hypot(own, gained)) * (1.0 + log_of(z[:, 1], -4, 1))
    p, n = case.place(z[:, 6:], np.maximum(gap, 0.0) + 1.0) if zone else (z[:, :2], z[:, :2])
    away = np.maximum(gap, 0.0) if zone else np.zeros(len(z))
    rate = log_of(z[:, 8], -3, 0) + (drift * BETA / limit * (away > 0.0) if zone else 0.0)
    k = log_of(z[:, 9], -6, 0) * limit
    v2 = limit**2 + 2.0 * BETA * away - 2.0 * limit * (own + k)
    v = np.sqrt(np.where(v2 >= 0.0, v2, np.nan))
    angle = 2.0 * np.pi * z[:, 10]
    v = v[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    numbers, a, out = (
        np.zeros((len(z), 1, layout.WIDTH)),
        np.empty((len(z), 1, 2)),
        np.empty((4, len(z), 1)),
    )
    numbers[:, 0, layout.V_MAX], numbers[:, 0, layout.AWAY] = limit, away
    if zone:
        numbers[:, 0, layout.AWAY_X : layout.AWAY_Y + 1] = n * (away > 0.0)[:, None]
    kind = np.full((len(z), 1), layout.ZONE if zone else layout.SPEED_LIMIT)
    reserved = np.stack([own, rate, 0.0 * own])[:, :, None]
    x = np.hstack([p, v])
    _core.planar_rows(kind, numbers, reserved, x, np.zeros(len(z)), case.how.packed, a, out)
    size, b = np.linalg.norm(a[:, 0], axis=1), out[rows.B, :, 0]
    ahead = a[:, 0] / np.maximum(size, 1e-300)[:, None]
    u = case.push(ahead, b / np.maximum(size, 1e-300), z[:, 11], z[:, 12])
    tau = np.linspace(0.0, span, LOOKS + 1)
    later = ((v[:, None] + u[:, None] * tau[:, None]) ** 2).sum(-1)
    h = (limit**2)[:, None] - later
    if zone:
        q = p[:, None] + v[:, None] * tau[:, None] + 0.5 * u[:, None] * tau[:, None] ** 2
        d = case.value(q)[0] - 1.0
        d = d + np.minimum(gap, 0.0)[:, None] - drift[:, None] * tau
        h = h + 2.0 * BETA * np.maximum(0.0, d)
    h = h / (2.0 * limit[:, None])
    base = log_of(z[:, 8], -3, 0)[:, None]
    stop = (v**2).sum(1) / (limit * span)
    return (h - own[:, None] - base * tau).min(1), stop - b


def lemma_7(case: Case, z: Array) -> Array:
    """Check: a speed limit between samples."""
    return speed(case, z, zone=False)[0]


def a_stop(case: Case, z: Array) -> Array:
    """Check: no row of a speed limit requires more than ‖v‖²/(v_max T)."""
    return speed(case, z, zone=False)[1]


def lemma_12(case: Case, z: Array) -> Array:
    """Check: a speed zone between samples, while what position rows reserve grows."""
    return speed(case, z, zone=True)[0]
