"""A search for counterexamples to the lemmas of `docs/rows.md`, under exactly what they assume.

Each claim is a function from numbers in [0, 1] to slacks, NaN where its assumptions do not hold.
Random numbers are drawn, and the worst of them moved by shrinking steps. The rows are the package's
compiled ones; distances and motion stand here once more.
"""

import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.barriers import (
    BarrierSet, Capsule, ConvexPolygon, Disc, Ellipse, HalfPlane, LinearClassK, LogClassK,
    RowSettings, layout, margins, row_kernels,
)  # fmt: skip
from hcbf_gym.models.plant import Uncertainty

Array = NDArray[np.float64]
NUMBERS, LOOKS, CORNERS, WORST = 16, 24, 5, 60
ROUNDING = 1e-9
BETA = 1.0


class Case(NamedTuple):
    """A region, its numbers as `value` reads them, and how rows are made."""

    kind: str
    c: Array
    barriers: BarrierSet
    how: RowSettings
    velocity: Array


def value(kind: str, c: Array, p: Array) -> tuple[Array, Array]:
    """Return the signed distances of points p (..., 2) from a region, and their gradients."""
    if kind == "wall":
        return p @ c[:2] - c[2], np.broadcast_to(c[:2], p.shape)
    if kind == "ellipse":
        return _ellipse(c, p)
    if kind == "disc":
        foot, radius = np.zeros(2), c[0]
    elif kind == "capsule":
        share = np.clip(p @ c[:2] / (c[:2] @ c[:2]), 0.0, 1.0)
        foot, radius = share[..., None] * c[:2], c[2]
    else:
        return _polygon(c.reshape(-1, 2), p)
    way = p - foot
    far = np.linalg.norm(way, axis=-1)
    return far - radius, way / np.maximum(far, 1e-300)[..., None]


def _polygon(corner: Array, p: Array) -> tuple[Array, Array]:
    edge = np.roll(corner, -1, axis=0) - corner
    long = np.linalg.norm(edge, axis=1)
    normal = np.column_stack([edge[:, 1], -edge[:, 0]]) / long[:, None]
    over = p[..., None, :] - corner
    height = (over * normal).sum(-1)
    share = np.clip((over * edge).sum(-1) / long**2, 0.0, 1.0)
    way = over - share[..., None] * edge
    far = np.linalg.norm(way, axis=-1)
    nearest, highest = far.argmin(-1)[..., None], height.argmax(-1)
    out = np.take_along_axis(far, nearest, -1)[..., 0]
    beside = np.take_along_axis(way, nearest[..., None], -2)[..., 0, :]
    beside = beside / np.maximum(out, 1e-300)[..., None]
    inside = height.max(-1) <= 1e-13
    h = np.where(inside, height.max(-1), out)
    return h, np.where(inside[..., None], normal[highest], beside)


def _ellipse(c: Array, p: Array) -> tuple[Array, Array]:
    a, b = c[:2]
    q = np.abs(p) + 1e-15
    low, high = np.full(q.shape[:-1], -b * b), a * np.linalg.norm(q, axis=-1)
    for _ in range(64):  # of λ in (a x/(a² + λ))² + (b y/(b² + λ))² = 1
        mid = 0.5 * (low + high)
        more = (a * q[..., 0] / (a * a + mid)) ** 2 + (b * q[..., 1] / (b * b + mid)) ** 2 > 1.0
        low, high = np.where(more, mid, low), np.where(more, high, mid)
    w = np.stack([q[..., 0] / (a * a + high), q[..., 1] / (b * b + high)], axis=-1)
    size = np.linalg.norm(w, axis=-1)
    return high * size, np.copysign(w / size[..., None], p)


KINDS = ("wall", "disc", "ellipse", "polygon", "capsule")


def draw(rng: np.random.Generator, kind: str = "") -> Case:
    """Return a case, drawn; steep slopes and long holds among them."""
    period = float(10.0 ** rng.uniform(-2.3, -0.5))
    top = min(1.0 / period, 20.0)
    share = rng.choice([1.0, rng.uniform(0.05, 1.0)])
    log = LogClassK(1.0, rng.uniform(0.1, 2.0), rng.uniform(0.02, 0.5))
    alpha1: Any = log.scaled(share * top / log.derivative(0.0))
    if rng.random() < 0.4:
        alpha1 = LinearClassK(share * top)
    alpha2 = LinearClassK(rng.choice([1.0, rng.uniform(0.02, 1.0)]) * top * (1.0 - 1e-12))
    alpha1 = alpha1.scaled(1.0 - 1e-12)
    how = RowSettings(alpha1, alpha2, period, float(10.0 ** rng.uniform(-0.5, 1.3)))
    kind = kind or str(rng.choice(KINDS))
    w = rng.choice([0.0, 0.5]) * rng.normal(0.0, 1.0, 2) * (kind != "wall")
    v, angle = (float(w[0]), float(w[1])), rng.uniform(0.0, 2.0 * np.pi)
    side = np.array([np.cos(angle), np.sin(angle)])
    made: Any
    if kind == "wall":
        c = np.array([*side, rng.normal()])
        made = HalfPlane(kind, 1, (c[0], c[1]), c[2])
    elif kind == "disc":
        c = 10.0 ** rng.uniform(-3.5, 0.3, 1)
        made = Disc(kind, 1, (0.0, 0.0), float(c[0]), v)
    elif kind == "ellipse":
        c = np.sort(10.0 ** rng.uniform(-2.0, 0.3, 2))[::-1].copy()
        made = Ellipse(kind, 1, (0.0, 0.0), (c[0], c[1]), 0.0, v)
    elif kind == "capsule":
        c = np.array([*10.0 ** rng.uniform(-2.0, 0.3) * side, 10.0 ** rng.uniform(-3.5, 0.0)])
        made = Capsule(kind, 1, (0.0, 0.0), (c[0], c[1]), c[2], v)
    else:
        turn = np.sort(angle + 2.0 * np.pi * (np.arange(CORNERS) + rng.uniform(0, 0.8, CORNERS)) / 5)
        round_ = np.column_stack([np.cos(turn), np.sin(turn) * 10.0 ** rng.uniform(-1.5, 0.0)])
        corner = round_ * 10.0 ** rng.uniform(-2.0, 0.3)
        made, c = ConvexPolygon(kind, 1, tuple(map(tuple, corner.tolist())), v), corner.ravel()
    return Case(kind, c, BarrierSet([(made,)]), how, np.array(v))


def rows(case: Case, x: Array, margin: Array, held: bool = True) -> tuple[Array, Array, Array]:
    """Return a (N, 2), b (N,) and ψ (N,) of compiled rows; `margin` is (3, N)."""
    n, settings = len(x), case.how.packed.copy()
    settings[row_kernels.HELD] = held
    kind, numbers = case.barriers.kind.repeat(n, 0), case.barriers.parameters.repeat(n, 0)
    a, out, reserved = np.empty((n, 1, 2)), np.empty((4, n, 1)), margin[:, :, None].copy()
    row_kernels.rows(kind, numbers, reserved, x.copy(), np.zeros(n), settings, a, out)
    return a[:, 0], out[row_kernels.B, :, 0], out[row_kernels.PSI, :, 0]


def rounding(case: Case) -> float:
    """Return what held rows reserve besides, as the table of shapes has it."""
    half = 0.5 * u_max(case) * period(case) ** 2
    return max(0.0, half - (np.inf if case.kind == "wall" else deep(case)))


def deep(case: Case) -> float:
    """Return how far a region reaches beyond its core."""
    if case.kind == "ellipse":
        return float(case.c[1] ** 2 / case.c[0])
    return float(case.c[-1]) if case.kind in ("disc", "capsule") else 0.0


def period(case: Case) -> float:
    """Return T [s]."""
    assert case.how.period is not None
    return case.how.period


def u_max(case: Case) -> float:
    """Return the largest norm of an input [m/s²]."""
    assert case.how.u_max is not None
    return case.how.u_max


def log_of(share: Array, low: float, high: float) -> Array:
    """Return 10 to the power of what lies between low and high, 0 below the first tenth."""
    return np.where(share < 0.1, 0.0, 10.0 ** (low + (high - low) * (share - 0.1) / 0.9))


def place(case: Case, z: Array, away: Array) -> tuple[Array, Array]:
    """Return points (N, 2) at the distance `away` from the region, and ∇h there."""
    size = 1.5 * max(float(np.abs(case.c).max()), 1e-3)
    angle = 2.0 * np.pi * z[:, 0]
    p = size * (1.0 + z[:, 1:2]) * np.column_stack([np.cos(angle), np.sin(angle)])
    h, n = value(case.kind, case.c, p)
    p = p - (h - away)[:, None] * n
    h, n = value(case.kind, case.c, p)
    return p, np.where(np.abs(h - away)[:, None] < 1e-9 + 1e-6 * away[:, None], n, np.nan)


def across(n: Array) -> Array:
    """Return n turned by a right angle."""
    return np.stack([-n[..., 1], n[..., 0]], axis=-1)


class Hold(NamedTuple):
    """States beside a region, an input that meets its row, and what one hold makes of them."""

    h: Array
    n: Array
    r: Array
    margin: Array
    k: Array
    rate: Array
    b: Array
    u: Array
    tau: Array
    later: Array
    turned: Array
    psi: Array


def hold(case: Case, z: Array, literal: bool = False) -> Hold:
    """Return what numbers z (N, NUMBERS) say; `literal` leaves the rounding out of m."""
    T, extra = period(case), 0.0 if literal else rounding(case)
    margin = np.stack([log_of(z[:, 2], -4, -0.5), 0.5 * log_of(z[:, 3], -3, 0), log_of(z[:, 4], -2, 1)])
    margin[1] *= np.where(z[:, 5] < 0.3, -1.0, 1.0)
    margin[1] = np.maximum(margin[1], -margin[0] / T)  # m ≥ 0 stays
    margin[2] *= z[:, 5] > 0.6
    k = log_of(z[:, 6], -6.0, 0.5)
    p, n = place(case, z, k + margin[0] + extra)
    psi = log_of(z[:, 7], -5.0, 0.8)
    rate = psi - case.how.alpha1.values(k)
    r_n = rate + margin[1]
    r = r_n[:, None] * n + (2.0 * z[:, 8] - 1.0)[:, None] * 10.0 ** (2.0 * z[:, 9:10] - 1.5) * across(n)
    x = np.hstack([p, r + case.velocity])
    _, b, _ = rows(case, x, margin)
    u = push(case, n, b, z[:, 10], z[:, 11])
    tau = np.linspace(0.0, T, LOOKS + 1)
    way = p[:, None] + r[:, None] * tau[:, None] + 0.5 * u[:, None] * tau[:, None] ** 2
    later, turned = value(case.kind, case.c, way)
    return Hold(k + margin[0] + extra, n, r, margin, k, rate, b, u, tau, later, turned, psi)


def push(case: Case, n: Array, b: Array, surplus: Array, aside: Array) -> Array:
    """Return inputs of the norm u_max at most that meet a·u ≥ b, NaN where there is none."""
    top = u_max(case)
    level = np.maximum(b, -top) + np.where(surplus < 0.5, 0.0, (2.0 * surplus - 1.0) * 2.0 * top)
    level = np.where(b <= top, np.minimum(level, top), np.nan)
    left = np.sqrt(np.maximum(0.0, top**2 - level**2))
    return level[:, None] * n + ((2.0 * aside - 1.0) * left)[:, None] * across(n)


def kept(s: Hold) -> Array:
    """Return h(τ) − m(τ) (N, LOOKS + 1) without the rounding."""
    return s.later - s.margin[0][:, None] - s.margin[1][:, None] * s.tau


def lemma_1(case: Case, z: Array) -> Array:
    """A tangent lies below."""
    s = hold(case, z)
    tangent = s.h[:, None] + (s.n * s.r).sum(1)[:, None] * s.tau
    tangent += 0.5 * (s.n * s.u).sum(1)[:, None] * s.tau**2
    return (s.later - tangent).min(1)


def lemma_2(case: Case, z: Array) -> Array:
    """Between samples h ≥ m, rounding included, and so the theorem's first half."""
    s = hold(case, z)
    return kept(s).min(1) - rounding(case)


def lemma_2_literal(case: Case, z: Array) -> Array:
    """The same of an m without the rounding."""
    return kept(hold(case, z, literal=True)).min(1)


def turn(case: Case, s: Hold) -> tuple[Array, Array, Array, Array]:
    """Return D, d(0), d(T) and ℓ."""
    radius = deep(case)
    reach = np.linalg.norm(s.r, axis=1) * period(case) + 0.5 * u_max(case) * period(case) ** 2
    return s.turned[:, -1] - s.n, s.h + radius, s.later[:, -1] + radius, reach


def lemma_3(case: Case, z: Array) -> Array:
    """D·r̄ T ≥ d̄ ‖D‖²."""
    s = hold(case, z)
    D, d, d_T, _ = turn(case, s)
    T = period(case)
    slack = (D * (s.r * T + 0.5 * s.u * T**2)).sum(1) - 0.5 * (d + d_T) * (D**2).sum(1)
    return np.where((d >= 0.0) & (d_T >= 0.0), slack, np.nan)


def lemma_4(case: Case, z: Array) -> Array:
    """D·r(T) ≥ −A."""
    s = hold(case, z)
    D, d, d_T, _ = turn(case, s)
    loss = u_max(case) ** 2 * period(case) ** 3 / (8.0 * (d + d_T))
    slack = (D * (s.r + s.u * period(case))).sum(1) + loss
    return np.where((d > 0.0) & (d_T > 0.0), slack, np.nan)


def lemma_5(case: Case, z: Array) -> Array:
    """D·r(T) ≥ −ν, of discs and ends of capsules."""
    s = hold(case, z)
    D, d, d_T, reach = turn(case, s)
    T = period(case)
    loss = u_max(case) ** 2 * T**3 / (8.0 * (d + np.maximum(0.0, d - reach)))
    round_ = np.maximum(0.0, np.abs((s.r * across(s.n)).sum(1)) - 0.5 * u_max(case) * T)
    gain = d * round_ * np.sqrt(T / (d + reach) ** 3)
    if case.kind == "capsule":
        along = (s.h + case.c[2])[:, None] * s.n @ case.c[:2] / np.linalg.norm(case.c[:2])
        gain[np.abs(along) < reach] = 0.0  # beside an end, n leans away from the segment by more
    if case.kind not in ("disc", "capsule"):
        gain = 0.0 * gain
    nu = loss - np.maximum(0.0, gain - np.sqrt(loss)) ** 2
    return (D * (s.r + s.u * T)).sum(1) + nu


def after(case: Case, s: Hold, extra: float) -> Array:
    """Return by how much ψ(T) is above ψ − T α₂(ψ)."""
    T, how = period(case), case.how
    rate = (s.turned[:, -1] * (s.r + s.u * T)).sum(1) - s.margin[1] - s.margin[2] * T
    psi = rate + how.alpha1.values(kept(s)[:, -1] - extra)
    return (psi - s.psi + T * how.alpha2.values(s.psi)) / (1.0 + np.abs(s.psi))


def lemma_6(case: Case, z: Array) -> Array:
    """ψ(T) ≥ ψ − T α₂(ψ), where h ≥ m and ψ ≥ 0, rounding included."""
    return after(case, hold(case, z), rounding(case))


def lemma_6_nearer(case: Case, z: Array) -> Array:
    """The same in the rounding itself, h − m ≥ 0 but k < 0: there ν is not proved."""
    half = rounding(case)
    z = z.copy()
    z[:, 2] = 0.0
    s = hold(case, z)
    share = 10.0 ** (-4.0 * z[:, 12]) * half
    p, n = place(case, z, share)
    x = np.hstack([p, s.r + case.velocity])
    margin = np.stack([0.0 * share, s.margin[1], s.margin[2]])
    _, b, psi = rows(case, x, margin)
    u = push(case, n, b, z[:, 10], z[:, 11])
    way = p[:, None] + s.r[:, None] * s.tau[:, None] + 0.5 * u[:, None] * s.tau[:, None] ** 2
    later, turned = value(case.kind, case.c, way)
    s = s._replace(n=n, h=share, u=u, later=later, turned=turned, psi=psi, margin=margin)
    return after(case, s, half)


def lemma_11(case: Case, z: Array) -> Array:
    """Two pieces: rows of those within the horizon keep h ≥ m, and ψ ≥ 0 of both."""
    T, how, half = period(case), case.how, 0.5 * u_max(case) * period(case) ** 2
    if case.kind != "polygon":
        return np.full(len(z), np.nan)
    shift = np.array([3.0 * np.ptp(case.c), 0.3 * np.ptp(case.c)])
    m = np.stack([0.1 * z[:, 2], 0.0 * z[:, 2], 0.0 * z[:, 2]])
    p, _ = place(case, z, m[0] + half + log_of(z[:, 3], -4, 0.5))
    v = 10.0 ** (2.0 * z[:, 4:5] - 1.5) * np.column_stack(
        [np.cos(2.0 * np.pi * z[:, 5]), np.sin(2.0 * np.pi * z[:, 5])]
    )
    v -= case.velocity * 0.0
    fast = np.linalg.norm(v, axis=1)
    far = [how.alpha1.inverse(y) for y in np.minimum(fast + u_max(case) * T, 1e3)]
    H = m[0] + half + np.array(far) + fast * T + half
    tau = np.linspace(0.0, T, LOOKS + 1)
    turn_ = 2.0 * np.pi * z[:, 10]
    u = u_max(case) * z[:, 11:12] * np.column_stack([np.cos(turn_), np.sin(turn_)])
    q = p[:, None] + v[:, None] * tau[:, None] + 0.5 * u[:, None] * tau[:, None] ** 2
    worst, meets = np.full(len(z), np.inf), np.ones(len(z), dtype=np.bool_)
    for by in (0.0 * shift, shift):
        a, b, psi = rows(case, np.hstack([p - by, v + case.velocity]), m)
        h, n = value(case.kind, case.c, q - by)
        meets &= (h[:, 0] - m[0] >= half) & (psi >= 0.0)
        meets &= ((a * u).sum(1) >= b) | (h[:, 0] > H)
        k = h - m[0][:, None] - half
        later = (n[:, -1] * (v + u * T)).sum(1) + how.alpha1.values(k[:, -1])
        worst = np.minimum(worst, np.minimum(k.min(1), later))
    return np.where(meets, worst, np.nan)


def speed(case: Case, z: Array, zone: bool) -> tuple[Array, Array]:
    """Return by how much lemma 7 or 12 holds, and by how much b is below a stop (and ṁ)."""
    T, top = period(case), u_max(case)
    own = log_of(z[:, 0], -3, 0)
    limit = (top * T + 2.0 * own) * (1.0 + log_of(z[:, 1], -4, 1))
    drift = log_of(z[:, 2], -3, 0) * zone
    away, inside = log_of(z[:, 3], -4, 0.5), z[:, 4] < 0.3
    if zone:
        gained = T * np.sqrt(top**2 + BETA * top + BETA**2)
        limit = (own + np.hypot(own, gained)) * (1.0 + log_of(z[:, 1], -4, 1))
        gap = 0.3 * np.where(inside, -z[:, 5], away)
    p, n = place(case, z[:, 6:], np.maximum(gap, 0.0) + 1.0) if zone else (z[:, :2], z[:, :2])
    way = np.maximum(gap, 0.0) if zone else np.zeros(len(z))
    rate = log_of(z[:, 8], -3, 0) + (drift * BETA / limit * (way > 0.0) if zone else 0.0)
    k = log_of(z[:, 9], -6, 0) * limit
    v2 = limit**2 + 2.0 * BETA * way - 2.0 * limit * (own + k)
    v = np.sqrt(np.where(v2 >= 0.0, v2, np.nan))
    angle = 2.0 * np.pi * z[:, 10]
    v = v[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    numbers, a, out = np.zeros((len(z), 1, layout.WIDTH)), np.empty((len(z), 1, 2)), np.empty((4, len(z), 1))
    numbers[:, 0, layout.V_MAX], numbers[:, 0, layout.AWAY] = limit, way
    if zone:
        numbers[:, 0, layout.AWAY_X : layout.AWAY_Y + 1] = n * (way > 0.0)[:, None]
    kind = np.full((len(z), 1), layout.ZONE if zone else layout.SPEED_LIMIT)
    reserved = np.stack([own, rate, 0.0 * own])[:, :, None]
    x = np.hstack([p, v])
    row_kernels.rows(kind, numbers, reserved, x, np.zeros(len(z)), case.how.packed, a, out)
    size, b = np.linalg.norm(a[:, 0], axis=1), out[row_kernels.B, :, 0]
    ahead = a[:, 0] / np.maximum(size, 1e-300)[:, None]
    u = push(case, ahead, b / np.maximum(size, 1e-300), z[:, 11], z[:, 12])
    tau = np.linspace(0.0, T, LOOKS + 1)
    later = ((v[:, None] + u[:, None] * tau[:, None]) ** 2).sum(-1)
    h = (limit**2)[:, None] - later
    if zone:
        q = p[:, None] + v[:, None] * tau[:, None] + 0.5 * u[:, None] * tau[:, None] ** 2
        d = value(case.kind, case.c, q)[0] - 1.0 - np.minimum(0.0, 0.0 * gap)[:, None]
        d = d + np.minimum(gap, 0.0)[:, None] - drift[:, None] * tau
        h = h + 2.0 * BETA * np.maximum(0.0, d)
    h = h / (2.0 * limit[:, None])
    base = log_of(z[:, 8], -3, 0)[:, None]
    stop = (v**2).sum(1) / (limit * T)
    return (h - own[:, None] - base * tau).min(1), stop - b


def lemma_7(case: Case, z: Array) -> Array:
    """A speed limit between samples."""
    return speed(case, z, zone=False)[0]


def a_stop(case: Case, z: Array) -> Array:
    """No row of a speed limit asks for more than ‖v‖²/(v_max T)."""
    return speed(case, z, zone=False)[1]


def lemma_12(case: Case, z: Array) -> Array:
    """A speed zone between samples, while what position rows reserve grows."""
    return speed(case, z, zone=True)[0]


def lemma_8(case: Case, z: Array) -> Array:
    """Usual rows of standing regions ask for D at most, at ψ ≥ 0."""
    s = hold(case, z)
    alpha1, reserved = case.how.alpha1, np.stack([s.margin[0] + rounding(case), 0 * s.k, 0 * s.k])
    r = s.r - s.margin[1][:, None] * s.n
    p, n = place(case, z, s.h)
    _, b, psi = rows(case, np.hstack([p, r + case.velocity]), reserved, held=False)
    fast = np.minimum(np.maximum(0.0, -(r * n).sum(1)), alpha1.hardest_speed)
    most = [v * alpha1.derivative(alpha1.inverse(v)) for v in np.nan_to_num(fast)]
    return np.where(psi >= 0.0, (np.array(most) - b) / (1.0 + np.abs(b)), np.nan)


def held_bound(case: Case, z: Array) -> Array:
    """The bound on b of a held row at ψ = 0 and e ≥ η."""
    z = z.copy()
    z[:, 3:6], z[:, 7] = 0.0, 0.1  # ψ = 1e-5: at 0, rounding makes half of the rows late
    s, how, T = hold(case, z), case.how, period(case)
    half = 0.5 * u_max(case) * T**2
    fast = how.alpha1.values(s.k)
    e = s.k - fast * T
    steep, least = (np.array([how.alpha1.derivative(x) for x in e + o]) for o in (-half, half))
    nu = u_max(case) * T / 8.0
    most = fast * steep + 0.5 * u_max(case) * T * (steep - least) + nu / T
    return np.where(e >= half, most / (1.0 + 0.5 * least * T) - s.b, np.nan)


def braking(case: Case, z: Array) -> Array:
    """Braking at −5v, and u_max/8 away from what is sharp, meets rows of the paper's α's."""
    how = RowSettings(period=0.02, u_max=5.0 * 2.0**0.5, limits=((-5.0, -5.0), (5.0, 5.0)))
    case, z = case._replace(how=how), z.copy()
    z[:, 2:6] = 0.0
    s = hold(case, z)
    p, n = place(case, z, s.h)
    _, b, psi = rows(case, np.hstack([p, s.r + case.velocity]), s.margin)
    given = 0.0 if case.kind == "wall" else u_max(case) / 8.0
    fine = (np.linalg.norm(s.r, axis=1) <= 1.0) & (psi >= 0.0)
    return np.where(fine, given - 5.0 * (s.r * n).sum(1) - b, np.nan)


def lemma_9(case: Case, z: Array) -> Array:
    """Straight braking stops short."""
    s = hold(case, z)
    r = s.r - s.margin[1][:, None] * s.n
    p, _ = place(case, z, s.h)
    fast = np.linalg.norm(r, axis=1)
    share = np.linspace(0.0, 1.0, LOOKS + 1)[:, None]
    brake = 0.5 * case.how.alpha1.derivative(0.0) * fast
    way = r * (fast / (2.0 * brake))[:, None]
    least = value(case.kind, case.c, p[:, None] + share * way[:, None])[0].min(1)
    return least - s.margin[0] - rounding(case)


def lemma_10(case: Case, z: Array) -> Array:
    """Beyond the horizon k ≥ 0 and ψ(T) ≥ 0 under every input."""
    T, how, half = period(case), case.how, 0.5 * u_max(case) * period(case) ** 2
    angle, v = 2.0 * np.pi * z[:, 3], log_of(z[:, 4], -2, 0.7)
    v = v[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    m, drift = log_of(z[:, 5], -3, 0), log_of(z[:, 6], -3, 0)
    fast = np.linalg.norm(v, axis=1)
    H = m + drift * T + half + fast * T + half
    H += np.array([how.alpha1.inverse(s) for s in fast + u_max(case) * T + drift])
    p, n = place(case, z, np.where(H < 1e3, H * (1.0 + log_of(z[:, 7], -4, 0)), np.nan))
    u = push(case, n, np.full(len(z), -u_max(case)), z[:, 8], z[:, 9])
    tau = np.linspace(0.0, T, LOOKS + 1)
    q = p[:, None] + v[:, None] * tau[:, None] + 0.5 * u[:, None] * tau[:, None] ** 2
    h, turned = value(case.kind, case.c, q)
    k = h - m[:, None] - drift[:, None] * tau - half
    psi = (turned[:, -1] * (v + u * T)).sum(1) - drift + how.alpha1.values(k[:, -1])
    return np.minimum(k.min(1), psi)


def stopping(case: Case, z: Array, held: bool) -> Array:
    """Return the least k while rows with ψ < 0 are met, ten samples long."""
    T, extra = period(case), rounding(case) if held else 0.0
    m = np.stack([log_of(z[:, 2], -4, -0.5), 0.3 * log_of(z[:, 3], -3, 0), 0.0 * z[:, 0]])
    k = 10.0 ** (4.0 * z[:, 4] - 3.5)
    p, n = place(case, z, k + m[0] + extra)
    fast = case.how.alpha1.values(k) + 10.0 ** (4.0 * z[:, 5] - 3.5)
    r = (m[1] - fast)[:, None] * n + ((2.0 * z[:, 6] - 1.0) * 10.0 ** (2 * z[:, 7] - 1))[:, None] * across(n)
    least, active = np.full(len(z), np.nan), np.isfinite(n[:, 0])
    tau = np.linspace(0.0, T, LOOKS + 1)
    for step in range(10):
        h, n = value(case.kind, case.c, p)
        k, rate = h - m[0] - extra, (n * r).sum(1) - m[1]
        x = np.hstack([p, r + case.velocity])
        _, b, psi = rows(case, x, m, held)
        active &= (psi < 0.0) & (rate < 0.0) & (k > 0.0) & (b < u_max(case) * (1.0 - 1e-9))
        u = push(case, n, b, z[:, 10 + step % 3], z[:, 13 + step % 3])
        q = p[:, None] + r[:, None] * tau[:, None] + 0.5 * u[:, None] * tau[:, None] ** 2
        seen = value(case.kind, case.c, q)[0] - m[0][:, None] - m[1][:, None] * tau - extra
        least = np.where(active, np.fmin(least, seen.min(1)), least)
        p, r, m = q[:, -1], r + u * T, m + np.stack([m[1] * T, 0 * m[1], 0 * m[1]])
    return least


def lemma_13(case: Case, z: Array) -> Array:
    """A stop under held rows."""
    return stopping(case, z, held=True)


def lemma_13_usual(case: Case, z: Array) -> Array:
    """A stop under usual rows, of which lemma 1 says less than they take off."""
    return stopping(case, z, held=False)


def growth(case: Case, z: Array) -> Array:
    """The margin of an estimate grows by ṁT at most, and ṁ by m̈T."""
    T, n = period(case), len(z)
    root = (z[:, :16].reshape(n, 4, 4) - 0.5) * 10.0 ** (z[:, 0] * 3.0 - 2.0)[:, None, None]
    P = root @ root.transpose(0, 2, 1)
    q = np.outer(10.0 ** (3.0 * z[:, 1] - 3.0), [z[0, 2], z[0, 3]])
    g = q.max(1) * T
    F = np.eye(4)

    def at(tau: float) -> Array:
        F[:2, 2:] = tau * np.eye(2)
        out = F @ P @ F.T
        for i in range(2):
            out[:, i, i] += q[:, i] * tau**3 / 3.0
            out[:, i, i + 2] += q[:, i] * tau**2 / 2.0
            out[:, i + 2, i] += q[:, i] * tau**2 / 2.0
            out[:, i + 2, i + 2] += q[:, i] * tau
        return out

    numbers = Uncertainty(distance=0.0, body=0.0, confidence=3.0)
    scenes, x = _repeat(case, n), np.zeros((n, 4))
    x[:, :2] = place(case, z, 0.1 + z[:, 4])[0]
    state = np.zeros(n), x, np.zeros((n, 4))

    def reserved(tau: float) -> Array:
        return margins.derive_all(numbers, scenes, x, *state, at(tau), g, T)[:, :, 0]

    now = reserved(0.0)
    slack = [now[0] + tau * now[1] - reserved(tau)[0] for tau in (0.3 * T, T)]
    return np.minimum.reduce([*slack, now[1] + now[2] * T - reserved(T)[1]]) / (1.0 + now[0])


def _repeat(case: Case, n: int) -> BarrierSet:
    out = BarrierSet([()] * n)
    for name in ("kind", "parameters", "own_margin"):
        setattr(out, name, getattr(case.barriers, name).repeat(n, 0))
    return out


CLAIMS: dict[str, Callable[[Case, Array], Array]] = {
    "1 tangent": lemma_1, "2 between samples": lemma_2, "2 without the rounding": lemma_2_literal,
    "3 turn": lemma_3, "4 loss": lemma_4, "5 going round": lemma_5, "6 next sample": lemma_6,
    "6 within the rounding": lemma_6_nearer,
    "7 speed limit": lemma_7, "7 no more than a stop": a_stop, "8 U can brake": lemma_8,
    "8 held bound": held_bound,
    "9 braking at -5v": braking, "9 straight braking": lemma_9, "10 horizon": lemma_10,
    "11 two pieces": lemma_11,
    "12 speed zones": lemma_12, "13 stop, held": lemma_13, "13 stop, usual": lemma_13_usual,
    "margin of an estimate": growth,
}  # fmt: skip


def search(name: str, cases: int, count: int = 400, steps: int = 12) -> tuple[int, float, Any]:
    """Return how many samples met the assumptions, the worst slack and its case."""
    rng, looked, worst, where = np.random.default_rng(list(name.encode())), 0, np.inf, None
    for _ in range(cases):
        case = draw(rng)
        z, width = rng.random((count, NUMBERS)), 0.3
        slack = np.full(count, np.inf)
        for step in range(steps):
            if step:
                best = z[np.argsort(slack)[: WORST // 4]]
                z = best[rng.integers(0, len(best), count)]
                moves = rng.normal(0.0, width, z.shape) * (rng.random(z.shape) < 0.4)
                z, width = np.clip(z + moves, 0.0, 1.0 - 1e-12), 0.6 * width
                z[: len(best)] = best
            with np.errstate(all="ignore"):
                found = CLAIMS[name](case, z)
            looked += int(np.isfinite(found).sum())
            slack = np.where(np.isfinite(found), found, np.inf)
            if slack.min() < worst:
                worst, where = float(slack.min()), (case, z[slack.argmin()])
    return looked, worst, where


def main(quick: bool) -> dict[str, float]:
    """Print what was searched, and return the worst slack of each claim."""
    out = {}
    print(f"{'claim':<26}{'samples':>12}{'worst slack':>14}  refuted")
    for name in CLAIMS:
        looked, out[name], _ = search(name, *((4, 100, 4) if quick else (40, 400, 12)))
        print(f"{name:<26}{looked:>12,}{out[name]:>14.2e}  {'yes' if out[name] < -ROUNDING else 'no'}")
    return out


if __name__ == "__main__":
    main("--quick" in sys.argv)
