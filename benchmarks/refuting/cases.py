"""Regions, states beside them, and inputs that meet rows."""

from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import (
    BarrierSet,
    BrakeClassK,
    Capsule,
    ConvexPolygon,
    Disc,
    Ellipse,
    HalfPlane,
    LinearClassK,
    LogClassK,
    RowSettings,
)
from hcbf_gym.barriers.rows import PSI, B

NUMBERS, LOOKS, CORNERS, WORST = 16, 24, 5, 60
ROUNDING = 1e-9
BETA = 1.0


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


def log_of(share: Array, low: float, high: float) -> Array:
    """Return 10 to the power of what lies between low and high, 0 below the first tenth."""
    return np.where(share < 0.1, 0.0, 10.0 ** (low + (high - low) * (share - 0.1) / 0.9))


def across(n: Array) -> Array:
    """Return n turned by a right angle."""
    return np.stack([-n[..., 1], n[..., 0]], axis=-1)


def kept(s: Hold) -> Array:
    """Return h(τ) − m(τ) (N, LOOKS + 1) without the rounding."""
    return s.later - s.margin[0][:, None] - s.margin[1][:, None] * s.tau


class Case(NamedTuple):
    """A region, its sizes, and how rows are made."""

    kind: str
    c: Array
    barriers: BarrierSet
    how: RowSettings
    velocity: Array

    @property
    def period(self) -> float:
        """T [s]."""
        assert self.how.period is not None
        return self.how.period

    @property
    def u_max(self) -> float:
        """The largest norm of an input [m/s²]."""
        assert self.how.u_max is not None
        return self.how.u_max

    @property
    def deep(self) -> float:
        """How far the region reaches beyond its core [m]."""
        if self.kind == "ellipse":
            return float(self.c[1] ** 2 / self.c[0])
        return float(self.c[-1]) if self.kind in ("disc", "capsule") else 0.0

    @property
    def rounding(self) -> float:
        """What held rows reserve besides, as the table of shapes has it [m]."""
        half = 0.5 * self.u_max * self.period**2
        return max(0.0, half - (np.inf if self.kind == "wall" else self.deep))

    def value(self, p: Array) -> tuple[Array, Array]:
        """Return the signed distances of points p (..., 2) from the region, and their gradients."""
        x = np.zeros((p[..., 0].size, 4))
        x[:, :2] = p.reshape(-1, 2)
        kind, numbers = self.barriers.kind.repeat(len(x), 0), self.barriers.parameters
        h, sensed = np.empty((len(x), 1)), np.empty((len(x), 1, 4))
        numbers = numbers.repeat(len(x), 0)
        _core.barrier_sense(kind, numbers, None, x, np.zeros(len(x)), h, sensed)
        return h.reshape(p.shape[:-1]), sensed[:, 0, 1:3].reshape(p.shape)

    def rows(self, x: Array, margin: Array, held: bool = True) -> tuple[Array, Array, Array]:
        """Return a (N, 2), b (N,) and ψ (N,) of compiled rows; `margin` is (3, N)."""
        n, settings = len(x), self.how.packed.copy()
        settings[14] = held  # as `RowSettings.packed` has it
        kind, numbers = self.barriers.kind.repeat(n, 0), self.barriers.parameters.repeat(n, 0)
        a, out, reserved = np.empty((n, 1, 2)), np.empty((4, n, 1)), margin[:, :, None].copy()
        _core.planar_rows(kind, numbers, reserved, x.copy(), np.zeros(n), settings, a, out)
        return a[:, 0], out[B, :, 0], out[PSI, :, 0]

    def place(self, z: Array, away: Array) -> tuple[Array, Array]:
        """Return points (N, 2) at the distance `away` from the region, and ∇h there."""
        size = 1.5 * max(float(np.abs(self.c).max()), 1e-3)
        angle = 2.0 * np.pi * z[:, 0]
        p = size * (1.0 + z[:, 1:2]) * np.column_stack([np.cos(angle), np.sin(angle)])
        h, n = self.value(p)
        p = p - (h - away)[:, None] * n
        h, n = self.value(p)
        return p, np.where(np.abs(h - away)[:, None] < 1e-9 + 1e-6 * away[:, None], n, np.nan)

    def push(self, n: Array, b: Array, surplus: Array, aside: Array) -> Array:
        """Return inputs of the norm u_max at most that meet a·u ≥ b, NaN where there is none."""
        top = self.u_max
        level = np.maximum(b, -top) + np.where(
            surplus < 0.5, 0.0, (2.0 * surplus - 1.0) * 2.0 * top
        )
        level = np.where(b <= top, np.minimum(level, top), np.nan)
        left = np.sqrt(np.maximum(0.0, top**2 - level**2))
        return level[:, None] * n + ((2.0 * aside - 1.0) * left)[:, None] * across(n)

    def hold(self, z: Array, literal: bool = False) -> Hold:
        """Return what numbers z (N, NUMBERS) say; `literal` leaves the rounding out of m."""
        span, extra = self.period, 0.0 if literal else self.rounding
        margin = np.stack(
            [log_of(z[:, 2], -4, -0.5), 0.5 * log_of(z[:, 3], -3, 0), log_of(z[:, 4], -2, 1)]
        )
        margin[1] *= np.where(z[:, 5] < 0.3, -1.0, 1.0)
        margin[1] = np.maximum(margin[1], -margin[0] / span)  # m ≥ 0 stays
        margin[2] *= z[:, 5] > 0.6
        k = log_of(z[:, 6], -6.0, 0.5)
        p, n = self.place(z, k + margin[0] + extra)
        psi = log_of(z[:, 7], -5.0, 0.8)
        rate = psi - self.how.alpha1.values(k)
        r_n = rate + margin[1]
        r = r_n[:, None] * n + (2.0 * z[:, 8] - 1.0)[:, None] * 10.0 ** (
            2.0 * z[:, 9:10] - 1.5
        ) * across(n)
        x = np.hstack([p, r + self.velocity])
        _, b, _ = self.rows(x, margin)
        u = self.push(n, b, z[:, 10], z[:, 11])
        tau = np.linspace(0.0, span, LOOKS + 1)
        path = p[:, None] + r[:, None] * tau[:, None] + 0.5 * u[:, None] * tau[:, None] ** 2
        later, turned = self.value(path)
        return Hold(k + margin[0] + extra, n, r, margin, k, rate, b, u, tau, later, turned, psi)


KINDS = ("wall", "disc", "ellipse", "polygon", "capsule")


def draw(rng: np.random.Generator, kind: str = "") -> Case:
    """Return a case, drawn; steep slopes and long holds among them."""
    period = float(10.0 ** rng.uniform(-2.3, -0.5))
    top = min(1.0 / period, 20.0)
    share = rng.choice([1.0, rng.uniform(0.05, 1.0)])
    log = LogClassK(1.0, rng.uniform(0.1, 2.0), rng.uniform(0.02, 0.5))
    alpha1: Any = log.scaled(share * top / log.derivative(0.0))
    other = rng.random()
    if other < 0.4:
        alpha1 = LinearClassK(share * top)
    elif other > 0.8:
        alpha1 = BrakeClassK(share * top * 0.1, 0.1)
    alpha2 = LinearClassK(rng.choice([1.0, rng.uniform(0.02, 1.0)]) * top * (1.0 - 1e-12))
    alpha1 = alpha1.scaled(1.0 - 1e-12)
    u_max = float(10.0 ** rng.uniform(-0.5, 1.3))
    how = RowSettings(alpha1, alpha2, period, u_max, alpha_speed=alpha2)
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
        turn = np.sort(
            angle + 2.0 * np.pi * (np.arange(CORNERS) + rng.uniform(0, 0.8, CORNERS)) / 5
        )
        round_ = np.column_stack([np.cos(turn), np.sin(turn) * 10.0 ** rng.uniform(-1.5, 0.0)])
        corner = round_ * 10.0 ** rng.uniform(-2.0, 0.3)
        made, c = ConvexPolygon(kind, 1, tuple(map(tuple, corner.tolist())), v), corner.ravel()
    return Case(kind, c, BarrierSet([(made,)]), how, np.array(v))
