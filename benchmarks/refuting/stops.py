"""Lemmas 8 to 10 and 13, and the growth of a margin."""

import numpy as np

from benchmarks.refuting.cases import LOOKS, Array, Case, across, log_of
from hcbf_gym import _core
from hcbf_gym.barriers import BarrierSet, LinearClassK, RowSettings
from hcbf_gym.models.plant import Uncertainty


def lemma_8(case: Case, z: Array) -> Array:
    """Check: usual rows of regions at rest require D at most, at ψ ≥ 0."""
    s = case.hold(z)
    alpha1, reserved = case.how.alpha1, np.stack([s.margin[0] + case.rounding, 0 * s.k, 0 * s.k])
    r = s.r - s.margin[1][:, None] * s.n
    p, n = case.place(z, s.h)
    _, b, psi = case.rows(np.hstack([p, r + case.velocity]), reserved, held=False)
    fast = np.minimum(np.maximum(0.0, -(r * n).sum(1)), alpha1.hardest_speed)
    most = [v * alpha1.derivative(alpha1.inverse(v)) for v in np.nan_to_num(fast)]
    return np.where(psi >= 0.0, (np.array(most) - b) / (1.0 + np.abs(b)), np.nan)


def held_bound(case: Case, z: Array) -> Array:
    """Check: the bound on b of a held row at ψ = 0 and e ≥ η."""
    z = z.copy()
    z[:, 3:6], z[:, 7] = 0.0, 0.1  # ψ = 1e-5: at 0, rounding makes half of the rows late
    s, how, span = case.hold(z), case.how, case.period
    half = 0.5 * case.u_max * span**2
    fast = how.alpha1.values(s.k)
    e = s.k - fast * span
    steep, least = (np.array([how.alpha1.derivative(x) for x in e + o]) for o in (-half, half))
    nu = case.u_max * span / 8.0
    most = fast * steep + 0.5 * case.u_max * span * (steep - least) + nu / span
    return np.where(e >= half, most / (1.0 + 0.5 * least * span) - s.b, np.nan)


def braking(case: Case, z: Array) -> Array:
    """Check: braking at −5v, and u_max/8 away from what is sharp, meets rows of α₂ from 2 on."""
    alpha2, box = LinearClassK(2.0), ((-5.0, -5.0), (5.0, 5.0))  # larger ones request no more
    how = RowSettings(alpha2=alpha2, period=0.02, u_max=5.0 * 2.0**0.5, limits=box)
    case, z = case._replace(how=how), z.copy()
    z[:, 2:6] = 0.0
    s = case.hold(z)
    p, n = case.place(z, s.h)
    _, b, psi = case.rows(np.hstack([p, s.r + case.velocity]), s.margin)
    given = 0.002 + (0.0 if case.kind == "wall" else case.u_max / 8.0)
    fine = (np.linalg.norm(s.r, axis=1) <= 1.0) & (psi >= 0.0)
    return np.where(fine, given - 5.0 * (s.r * n).sum(1) - b, np.nan)


def lemma_9(case: Case, z: Array) -> Array:
    """Check: straight braking stops short."""
    s = case.hold(z)
    r = s.r - s.margin[1][:, None] * s.n
    p, _ = case.place(z, s.h)
    fast = np.linalg.norm(r, axis=1)
    share = np.linspace(0.0, 1.0, LOOKS + 1)[:, None]
    brake = 0.5 * case.how.alpha1.derivative(0.0) * fast
    path = r * (fast / (2.0 * brake))[:, None]
    least = case.value(p[:, None] + share * path[:, None])[0].min(1)
    return least - s.margin[0] - case.rounding


def lemma_10(case: Case, z: Array) -> Array:
    """Check: beyond the horizon k ≥ 0 and ψ(T) ≥ 0 under every input."""
    span, how, half = case.period, case.how, 0.5 * case.u_max * case.period**2
    angle, v = 2.0 * np.pi * z[:, 3], log_of(z[:, 4], -2, 0.7)
    v = v[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    m, drift = log_of(z[:, 5], -3, 0), log_of(z[:, 6], -3, 0)
    fast = np.linalg.norm(v, axis=1)
    far = m + drift * span + half + fast * span + half
    far += np.array([how.alpha1.inverse(s) for s in fast + case.u_max * span + drift])
    p, n = case.place(z, np.where(far < 1e3, far * (1.0 + log_of(z[:, 7], -4, 0)), np.nan))
    u = case.push(n, np.full(len(z), -case.u_max), z[:, 8], z[:, 9])
    tau = np.linspace(0.0, span, LOOKS + 1)
    q = p[:, None] + v[:, None] * tau[:, None] + 0.5 * u[:, None] * tau[:, None] ** 2
    h, turned = case.value(q)
    k = h - m[:, None] - drift[:, None] * tau - half
    psi = (turned[:, -1] * (v + u * span)).sum(1) - drift + how.alpha1.values(k[:, -1])
    return np.minimum(k.min(1), psi)


def stopping(case: Case, z: Array, held: bool) -> Array:
    """Return the least k while rows with ψ < 0 are met, ten samples long."""
    span, extra = case.period, case.rounding if held else 0.0
    m = np.stack([log_of(z[:, 2], -4, -0.5), 0.3 * log_of(z[:, 3], -3, 0), 0.0 * z[:, 0]])
    k = 10.0 ** (4.0 * z[:, 4] - 3.5)
    p, n = case.place(z, k + m[0] + extra)
    fast = case.how.alpha1.values(k) + 10.0 ** (4.0 * z[:, 5] - 3.5)
    r = (m[1] - fast)[:, None] * n + ((2.0 * z[:, 6] - 1.0) * 10.0 ** (2 * z[:, 7] - 1))[
        :, None
    ] * across(n)
    least, active = np.full(len(z), np.nan), np.isfinite(n[:, 0])
    tau = np.linspace(0.0, span, LOOKS + 1)
    for step in range(10):
        h, n = case.value(p)
        k, rate = h - m[0] - extra, (n * r).sum(1) - m[1]
        x = np.hstack([p, r + case.velocity])
        _, b, psi = case.rows(x, m, held)
        active &= (psi < 0.0) & (rate < 0.0) & (k > 0.0) & (b < case.u_max * (1.0 - 1e-9))
        u = case.push(n, b, z[:, 10 + step % 3], z[:, 13 + step % 3])
        q = p[:, None] + r[:, None] * tau[:, None] + 0.5 * u[:, None] * tau[:, None] ** 2
        seen = case.value(q)[0] - m[0][:, None] - m[1][:, None] * tau - extra
        least = np.where(active, np.fmin(least, seen.min(1)), least)
        p, r, m = q[:, -1], r + u * span, m + np.stack([m[1] * span, 0 * m[1], 0 * m[1]])
    return least


def lemma_13(case: Case, z: Array) -> Array:
    """Check: a stop under held rows."""
    return stopping(case, z, held=True)


def lemma_13_usual(case: Case, z: Array) -> Array:
    """Check: a stop under usual rows, whose reserve lemma 1 does not cover."""
    return stopping(case, z, held=False)


def growth(case: Case, z: Array) -> Array:
    """Check: the margin of an estimate grows by ṁT at most, and ṁ by m̈T."""
    span, n = case.period, len(z)
    root = (z[:, :16].reshape(n, 4, 4) - 0.5) * 10.0 ** (z[:, 0] * 3.0 - 2.0)[:, None, None]
    cov = root @ root.transpose(0, 2, 1)
    q = np.outer(10.0 ** (3.0 * z[:, 1] - 3.0), [z[0, 2], z[0, 3]])
    g = q.max(1) * span
    flow = np.eye(4)

    def at(tau: float) -> Array:
        flow[:2, 2:] = tau * np.eye(2)
        out = flow @ cov @ flow.T
        for i in range(2):
            out[:, i, i] += q[:, i] * tau**3 / 3.0
            out[:, i, i + 2] += q[:, i] * tau**2 / 2.0
            out[:, i + 2, i] += q[:, i] * tau**2 / 2.0
            out[:, i + 2, i + 2] += q[:, i] * tau
        return out

    numbers = np.array(Uncertainty(distance=0.0, body=0.0, confidence=3.0), dtype=float)
    scenes, x = BarrierSet([case.barriers.listed[0]] * n), np.zeros((n, 4))
    x[:, :2] = case.place(z, 0.1 + z[:, 4])[0]
    state = np.zeros(n), x, np.zeros((n, 4))

    def reserved(tau: float) -> Array:
        out = np.zeros((4, *scenes.kind.shape))
        scene = scenes.kind, scenes.parameters
        _core.margins_reserved(numbers, *scene, x, *state, at(tau), g, span, out)
        out[0] += scenes.own_margin
        return out[:, :, 0]

    now = reserved(0.0)
    slack = [now[0] + tau * now[1] - reserved(tau)[0] for tau in (0.3 * span, span)]
    return np.minimum.reduce([*slack, now[1] + now[2] * span - reserved(span)[1]]) / (1.0 + now[0])
