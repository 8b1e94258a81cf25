"""Lemmas 1 to 6 and 11, of rows for an input that is held."""

import numpy as np

from benchmarks.refuting.cases import LOOKS, Array, Case, Hold, across, kept, log_of


def lemma_1(case: Case, z: Array) -> Array:
    """Check: a tangent lies below."""
    s = case.hold(z)
    tangent = s.h[:, None] + (s.n * s.r).sum(1)[:, None] * s.tau
    tangent += 0.5 * (s.n * s.u).sum(1)[:, None] * s.tau**2
    return (s.later - tangent).min(1)


def lemma_2(case: Case, z: Array) -> Array:
    """Check: between samples h ≥ m, rounding included, and so the theorem's first half."""
    s = case.hold(z)
    return kept(s).min(1) - case.rounding


def lemma_2_literal(case: Case, z: Array) -> Array:
    """Check: the same of an m without the rounding."""
    return kept(case.hold(z, literal=True)).min(1)


def turn(case: Case, s: Hold) -> tuple[Array, Array, Array, Array]:
    """Return D, d(0), d(T) and ℓ."""
    radius = case.deep
    reach = np.linalg.norm(s.r, axis=1) * case.period + 0.5 * case.u_max * case.period**2
    return s.turned[:, -1] - s.n, s.h + radius, s.later[:, -1] + radius, reach


def lemma_3(case: Case, z: Array) -> Array:
    """Check: D·r̄ T ≥ d̄ ‖D‖²."""
    s = case.hold(z)
    change, d, d_end, _ = turn(case, s)
    span = case.period
    slack = (change * (s.r * span + 0.5 * s.u * span**2)).sum(1) - 0.5 * (d + d_end) * (
        change**2
    ).sum(1)
    return np.where((d >= 0.0) & (d_end >= 0.0), slack, np.nan)


def lemma_4(case: Case, z: Array) -> Array:
    """Check: D·r(T) ≥ −A."""
    s = case.hold(z)
    change, d, d_end, _ = turn(case, s)
    loss = case.u_max**2 * case.period**3 / (8.0 * (d + d_end))
    slack = (change * (s.r + s.u * case.period)).sum(1) + loss
    return np.where((d > 0.0) & (d_end > 0.0), slack, np.nan)


def lemma_5(case: Case, z: Array) -> Array:
    """Check: D·r(T) ≥ −ν, of discs and ends of capsules."""
    s = case.hold(z)
    change, d, _d_end, reach = turn(case, s)
    span = case.period
    loss = case.u_max**2 * span**3 / (8.0 * (d + np.maximum(0.0, d - reach)))
    round_ = np.maximum(0.0, np.abs((s.r * across(s.n)).sum(1)) - 0.5 * case.u_max * span)
    gain = d * round_ * np.sqrt(span / (d + reach) ** 3)
    if case.kind == "capsule":
        along = (s.h + case.c[2])[:, None] * s.n @ case.c[:2] / np.linalg.norm(case.c[:2])
        gain[np.abs(along) < reach] = 0.0  # beside an end, n points away from the segment by more
    if case.kind not in ("disc", "capsule"):
        gain = 0.0 * gain
    nu = loss - np.maximum(0.0, gain - np.sqrt(loss)) ** 2
    return (change * (s.r + s.u * span)).sum(1) + nu


def after(case: Case, s: Hold, extra: float) -> Array:
    """Return by how much ψ(T) is above ψ − T α₂(ψ)."""
    span, how = case.period, case.how
    rate = (s.turned[:, -1] * (s.r + s.u * span)).sum(1) - s.margin[1] - s.margin[2] * span
    psi = rate + how.alpha1.values(kept(s)[:, -1] - extra)
    return (psi - s.psi + span * how.alpha2.values(s.psi)) / (1.0 + np.abs(s.psi))


def lemma_6(case: Case, z: Array) -> Array:
    """Check: ψ(T) ≥ ψ − T α₂(ψ), where h ≥ m and ψ ≥ 0, rounding included."""
    return after(case, case.hold(z), case.rounding)


def lemma_6_nearer(case: Case, z: Array) -> Array:
    """Check: the same in the rounding itself, h − m ≥ 0 but k < 0: there ν is not proved."""
    half = case.rounding
    z = z.copy()
    z[:, 2] = 0.0
    s = case.hold(z)
    share = 10.0 ** (-4.0 * z[:, 12]) * half
    p, n = case.place(z, share)
    x = np.hstack([p, s.r + case.velocity])
    margin = np.stack([0.0 * share, s.margin[1], s.margin[2]])
    _, b, psi = case.rows(x, margin)
    u = case.push(n, b, z[:, 10], z[:, 11])
    path = p[:, None] + s.r[:, None] * s.tau[:, None] + 0.5 * u[:, None] * s.tau[:, None] ** 2
    later, turned = case.value(path)
    s = s._replace(n=n, h=share, u=u, later=later, turned=turned, psi=psi, margin=margin)
    return after(case, s, half)


def lemma_11(case: Case, z: Array) -> Array:
    """Check: two pieces: rows of those within the horizon keep h ≥ m, and ψ ≥ 0 of both."""
    span, how, half = case.period, case.how, 0.5 * case.u_max * case.period**2
    if case.kind != "polygon":
        return np.full(len(z), np.nan)
    shift = np.array([3.0 * np.ptp(case.c), 0.3 * np.ptp(case.c)])
    m = np.stack([0.1 * z[:, 2], 0.0 * z[:, 2], 0.0 * z[:, 2]])
    p, _ = case.place(z, m[0] + half + log_of(z[:, 3], -4, 0.5))
    v = 10.0 ** (2.0 * z[:, 4:5] - 1.5) * np.column_stack(
        [np.cos(2.0 * np.pi * z[:, 5]), np.sin(2.0 * np.pi * z[:, 5])]
    )
    v -= case.velocity * 0.0
    fast = np.linalg.norm(v, axis=1)
    far = [how.alpha1.inverse(y) for y in np.minimum(fast + case.u_max * span, 1e3)]
    beyond = m[0] + half + np.array(far) + fast * span + half
    tau = np.linspace(0.0, span, LOOKS + 1)
    turn_ = 2.0 * np.pi * z[:, 10]
    u = case.u_max * z[:, 11:12] * np.column_stack([np.cos(turn_), np.sin(turn_)])
    q = p[:, None] + v[:, None] * tau[:, None] + 0.5 * u[:, None] * tau[:, None] ** 2
    worst, meets = np.full(len(z), np.inf), np.ones(len(z), dtype=np.bool_)
    for by in (0.0 * shift, shift):
        a, b, psi = case.rows(np.hstack([p - by, v + case.velocity]), m)
        h, n = case.value(q - by)
        meets &= (h[:, 0] - m[0] >= half) & (psi >= 0.0)
        meets &= ((a * u).sum(1) >= b) | (h[:, 0] > beyond)
        k = h - m[0][:, None] - half
        later = (n[:, -1] * (v + u * span)).sum(1) + how.alpha1.values(k[:, -1])
        worst = np.minimum(worst, np.minimum(k.min(1), later))
    return np.where(meets, worst, np.nan)
