"""The proposition of `docs/guarantees.md` under attack: random scenes, judged between the samples.

Motion and errors of the estimate stand here once more; distances are the package's. The rows read a
state that moves as p̈ = u; the robot is where the worst error allows, up to κ standard deviations
away. A region is *entered unannounced* where the body is in it during a
step whose status is none of VIOLATED, UNSAFE and BACKUP.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import (
    BarrierSet,
    Capsule,
    ConvexPolygon,
    Disc,
    Ellipse,
    HalfPlane,
    LinearClassK,
    LogClassK,
)
from hcbf_gym.filter.core import FilterCore
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models.input_sets import Ball, Box
from hcbf_gym.models.plant import Estimate, Plant, Uncertainty
from hcbf_gym.models.reduced_order import DoubleIntegrator
from hcbf_gym.programs import FilterStatus

SHAPES = ("wall", "disc", "ellipse", "polygon", "capsule")
SECONDS = 5.0
LOOK = 1e-3  # Between two looks [s]
ROUNDING = 1e-9  # What counts as not entered [m]
CORNERS = 5  # Of a polygon
DIRECTIONS = 8  # In which the robot may be off


def least_while_held(
    scenes: BarrierSet, x: Array, u: Array, t: float, period: float, spread: Array
) -> Array:
    """Return the least distance (N,) from any region, seen from all places where the robot may be.

    `spread` (looks + 1, 2, 2) is what a unit vector is multiplied by to be an error.
    """
    looks, count = len(spread) - 1, len(x)
    s = period * np.arange(looks + 1)[:, None] / looks
    angle = 2.0 * np.pi * np.arange(DIRECTIONS if spread.any() else 1) / DIRECTIONS
    errors = np.column_stack([np.cos(angle), np.sin(angle)]) @ spread.transpose(0, 2, 1)
    path = x[:, None, :2] + s * x[:, None, 2:] + 0.5 * s * s * u[:, None]
    seen = (path[:, :, None] + errors).reshape(-1, 2)  # (N, looks + 1, directions)
    states, times = np.zeros((len(seen), 4)), np.tile((t + s).repeat(len(angle)), count)
    states[:, :2] = seen
    each, h = len(seen) // count, np.empty((len(seen), scenes.kind.shape[1]))
    kind, numbers = scenes.kind.repeat(each, 0), scenes.parameters.repeat(each, 0)
    _core.barrier_values(kind, numbers, None, states, times, h)
    return h.reshape(count, -1).min(axis=1)


class Draw(NamedTuple):
    """What the scenes of one batch share."""

    period: float  # T [s]
    alpha1: Any  # α₁
    alpha2: float  # α₂'s gain [1/s]
    input_set: Any  # U
    body: float  # ρ [m]
    distance: float  # d [m]
    known: str  # how the covariance grows: "exact", "constant", "dead reckoning", "accelerating"
    kinds: tuple[str, ...]  # (m,) of `SHAPES`
    moving: bool  # whether regions move
    program: str  # its name


KNOWN = ("exact", "constant", "dead reckoning", "accelerating")
KAPPA = 3.0


def draw(rng: np.random.Generator) -> Draw:
    """Return what a batch shares, drawn."""
    period = float(rng.choice([0.01, 0.02, 0.05, 0.1, 0.2]))
    steepest = 1.0 / period
    log = LogClassK(rng.uniform(0.5, 2.0), 0.5, rng.uniform(0.1, 0.4))
    alpha1 = log if rng.random() < 0.6 else LinearClassK(rng.uniform(0.5, 3.0))
    if alpha1.derivative(0.0) > steepest:
        alpha1 = alpha1.scaled((1.0 - ROUNDING) * steepest / alpha1.derivative(0.0))
    size = rng.uniform(1.5, 6.0)
    sets = (
        Box.symmetric(size),
        Ball(size, int(rng.integers(6, 20))),
        Box(-size * rng.uniform(0.5, 1.0, 2), size * rng.uniform(0.5, 1.0, 2)),
    )
    return Draw(
        period,
        alpha1,
        float(rng.uniform(0.5, min(4.0, steepest))),
        sets[rng.integers(3)],
        float(rng.choice([0.0, 0.2, 0.46])),
        float(rng.choice([0.0, 0.02])),
        str(rng.choice(KNOWN, p=[0.55, 0.15, 0.15, 0.15])),
        tuple(SHAPES[k] for k in rng.integers(0, len(SHAPES), rng.integers(1, 4))),
        bool(rng.random() < 0.3),
        str(rng.choice(["lex-cbf-qp", "lex-cbf-qp", "cbf-qp", "eh-cbf-qp"])),
    )


def region(kind: str, rng: np.random.Generator, moving: bool) -> Any:
    """Return a region of one of `SHAPES`."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    away = rng.uniform(0.3, 2.5) * np.array([np.cos(angle), np.sin(angle)])
    w = tuple(rng.uniform(-0.3, 0.3, 2)) if moving and kind != "wall" else (0.0, 0.0)
    at = away[0], away[1]
    if kind == "wall":
        return HalfPlane(kind, 1, (-np.cos(angle), -np.sin(angle)), -rng.uniform(0.5, 2.5))
    if kind == "disc":
        return Disc(kind, 1, at, 10.0 ** rng.uniform(-3.0, 0.0), w)
    if kind == "ellipse":
        axes = 10.0 ** rng.uniform(-1.5, 0.2, 2)
        return Ellipse(kind, 1, at, (axes[0], axes[1]), rng.uniform(0.0, 2.0 * np.pi), w)
    if kind == "capsule":
        end = away + rng.normal(0.0, 0.7, 2)
        return Capsule(kind, 1, at, (end[0], end[1]), 10.0 ** rng.uniform(-2.5, -0.3), w)
    turn = rng.uniform(0.0, 6.0) + 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    squeeze = np.array([1.0, rng.uniform(0.1, 1.0)]) * rng.uniform(0.1, 1.0)
    cos, sin = np.cos(angle), np.sin(angle)
    corners = np.column_stack([np.cos(turn), np.sin(turn)]) * squeeze
    corners = away + corners @ np.array([[cos, sin], [-sin, cos]])
    return ConvexPolygon(kind, 1, tuple(map(tuple, corners.tolist())), w)


def covariance(known: str, t: float, size: float, shape: Array) -> Array:
    """Return P (4, 4) of the state at the time t, whose own errors grow as in its model."""
    out = np.zeros((4, 4))
    if known == "exact":
        return out
    of_position, mixed, of_velocity = (0.3 * size) ** 2, 0.0, 0.0
    if known != "constant":
        of_velocity, mixed = size**2, size**2 * t
        of_position += size**2 * t * t
    if known == "accelerating":
        noise = size**2
        of_velocity += noise * t
        mixed += noise * t * t / 2.0
        of_position += noise * t**3 / 3.0
    out[:2, :2], out[2:, 2:] = of_position * shape, of_velocity * shape
    out[:2, 2:] = out[2:, :2] = mixed * shape
    return out


class Start(NamedTuple):
    """One robot beside one region."""

    region: Any
    start: Array  # (4,) [m] and [m/s]
    seconds: float  # how long it is followed
    size: float = 0.0  # of the errors of velocity [m/s]


def follow(d: Draw, at: Start, policy: Callable[[Array], Array]) -> tuple[float, bool]:
    """Return the least distance of the body from the region, and whether no status reported it."""
    core, scenes = filter_of(d, [at.region], None), BarrierSet([[at.region]])
    x, shape, silent, nearest = at.start[None].astype(np.float64), np.eye(2), False, np.inf
    for step in range(round(at.seconds / d.period)):
        t = step * d.period
        known = None if d.known == "exact" else covariance(d.known, t, at.size, shape)
        u, report = core.step(policy(x[0]), [at.region], Estimate(x[0], t, known))
        spreads = _spreads(d, t, at.size, shape, shape)
        seen = least_while_held(scenes, x, u[None], t, d.period, spreads)
        least = float(seen[0]) - d.body
        nearest = min(nearest, least)
        silent |= least < -ROUNDING and report["status"] < FilterStatus.VIOLATED
        x = _moved(x, u[None], d.period)
    return nearest, bool(silent)


def filter_of(d: Draw, barriers: Any, batch: int | None) -> FilterCore:
    """Return the filter of a draw."""
    plant = Plant(
        DoubleIntegrator(), barriers, lambda *_: None, d.input_set, period=d.period,
        uncertainty=Uncertainty(distance=d.distance, body=d.body, confidence=KAPPA),
    )  # fmt: skip
    options = {"alpha1": d.alpha1, "alpha2": LinearClassK(d.alpha2)}
    settings = FilterSettings(d.program, "held", None, None, None, "warn", False, options)
    return FilterCore(plant, d.input_set, settings, batch)


def _spreads(d: Draw, t: float, size: float, shape: Array, root: Array) -> Array:
    """Return (looks + 1, 2, 2) what a unit vector is multiplied by to be an error, in one hold."""
    looks = max(1, round(d.period / LOOK))
    out = np.zeros((looks + 1, 2, 2))
    for look in range(looks + 1) if d.known != "exact" else ():
        later = covariance(d.known, t + d.period * look / looks, size, shape)
        out[look] = KAPPA * np.sqrt(later[0, 0] / shape[0, 0]) * root
    return out


def _moved(x: Array, u: Array, period: float) -> Array:
    """Return the states (N, 4) after one hold."""
    position = x[:, :2] + period * x[:, 2:] + 0.5 * period**2 * u
    return np.hstack([position, x[:, 2:] + period * u])


def walk(seed: int, count: int) -> dict[str, int]:
    """Attack the scenes of one batch for `SECONDS`; return in how many something was seen."""
    rng = np.random.default_rng(seed)
    d = draw(rng)
    listed = [[region(kind, rng, d.moving) for kind in d.kinds] for _ in range(count)]
    scenes, core = BarrierSet(listed), filter_of(d, listed, count)
    x = np.zeros((count, 4))
    x[:, :2] = rng.normal(0.0, 0.4, (count, 2))
    x[:, 2:] = rng.normal(0.0, 0.6, (count, 2)) * (rng.random((count, 1)) >= 0.5)
    size = 0.15 * rng.random() if d.known != "constant" else 0.5 * rng.random()
    stretch, turn = rng.uniform(0.2, 1.0), rng.uniform(0.0, np.pi)
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    shape, root = (axes.T @ np.diag([1.0, one]) @ axes for one in (stretch, np.sqrt(stretch)))
    core.restart(np.ones(count, dtype=np.bool_))
    style, every = rng.integers(0, 4, count)[:, None], np.arange(count)
    sign, corner = np.ones((count, 1)), np.zeros((count, 2))
    entered, silent, reported = np.zeros((3, count), dtype=np.bool_)
    radius = d.input_set.radius
    for step in range(int(SECONDS / d.period)):
        t = step * d.period
        known = np.tile(covariance(d.known, t, size, shape), (count, 1, 1))
        estimate = Estimate(x, np.full(count, t), None if d.known == "exact" else known)
        h, sensed = scenes.sense(x, np.full(count, t))
        normal = sensed[every, h.argmin(axis=1), 1:3]
        sign[rng.random(count) < d.period / 0.7] *= -1.0
        changes = rng.random(count) < d.period / 0.3
        corner[changes] = radius * rng.choice([-1.0, 1.0], (int(changes.sum()), 2))
        along = sign * np.column_stack([-normal[:, 1], normal[:, 0]]) - normal
        pushes = [corner, -radius * normal, radius * along, radius * sign * normal]
        wanted = np.choose(style, pushes)
        if step == 0:
            core.begin(listed, estimate, None, None)
        u, report = core.step(wanted, listed, estimate)
        bad = np.array(report["status"]) >= FilterStatus.VIOLATED
        reported |= bad
        spreads = _spreads(d, t, size, shape, root)
        least = least_while_held(scenes, x, u, t, d.period, spreads) - d.body
        silent |= (least < -ROUNDING) & ~bad
        entered |= least < -ROUNDING
        x = _moved(x, np.array(u), d.period)
    found = {"reported": reported, "entered": entered, "silent": silent}
    return {name: int(seen.sum()) for name, seen in found.items()}
