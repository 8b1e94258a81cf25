"""The proposition of `docs/guarantees.md` under attack: random scenes, judged between the samples.

Nothing but the filter is the package's: distances, motion and errors of the estimate stand here
once more. The rows read a state that moves as p̈ = u; the robot is where the worst error allows, up
to κ standard deviations away. A region is *entered unannounced* where the body is in it during a
step whose status is none of VIOLATED, UNSAFE and BACKUP.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers
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
CORNERS = 5
WIDTH = 2 + 2 * CORNERS
DIRECTIONS = 8  # In which the robot may be off
FAR = 0.5
"""[m], more than any body: a region that stays so far away for a whole hold is looked at once."""

BOTH_SIDES = 1e-13
AT_ONCE = 16_384
"""Places whose distances are taken together: their arrays stay in the processor's cache."""


def _to_segment(x: Array, y: Array, ax: Array, ay: Array, bx: Array, by: Array) -> Array:
    """Return the distances from segments."""
    ex, ey = bx - ax, by - ay
    share = np.clip(((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey), 0.0, 1.0)
    return np.hypot(x - ax - share * ex, y - ay - share * ey)


def _to_ellipse(x: Array, y: Array, a: Array, b: Array) -> Array:
    """Return the signed distances from the ellipses x²/a² + y²/b² = 1, by bisection."""
    x, y = np.abs(x), np.abs(y) + BOTH_SIDES
    x, y = np.where(a < b, y, x), np.where(a < b, x + BOTH_SIDES, y)
    a, b = np.maximum(a, b), np.minimum(a, b)
    apart, ax, by = a * a - b * b, a * x, b * y
    low, high = by, by + ax + b * b  # of s in (a x/(s + apart))² + (b y/s)² = 1
    for _ in range(60):
        s = 0.5 * (low + high)
        before = (ax / (s + apart)) ** 2 + (by / s) ** 2 > 1.0
        low, high = np.where(before, s, low), np.where(before, high, s)
    s = 0.5 * (low + high)
    return (s - b * b) * np.hypot(x / (s + apart), y / s)


def _to_polygon(x: Array, y: Array, c: Array) -> Array:
    """Return the signed distances from polygons whose corners run against the clock."""
    nearest, inside = np.asarray(np.inf), np.asarray(True)
    for i in range(CORNERS):
        j = (i + 1) % CORNERS
        ax, ay, bx, by = (c[..., k] for k in (2 * i, 2 * i + 1, 2 * j, 2 * j + 1))
        nearest = np.minimum(nearest, _to_segment(x, y, ax, ay, bx, by))
        inside = inside & ((bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0)
    return np.where(inside, -nearest, nearest)


def distance(kind: int, c: Array, x: Array, y: Array) -> Array:
    """Return the signed distances (…,) from regions of one kind with the numbers c (…, WIDTH)."""
    if kind == 0:
        return c[..., 0] * x + c[..., 1] * y - c[..., 2]
    if kind == 1:
        return np.hypot(x - c[..., 0], y - c[..., 1]) - c[..., 2]
    if kind == 2:
        cos, sin = np.cos(c[..., 4]), np.sin(c[..., 4])
        dx, dy = x - c[..., 0], y - c[..., 1]
        return _to_ellipse(cos * dx + sin * dy, cos * dy - sin * dx, c[..., 2], c[..., 3])
    if kind == 4:
        return _to_segment(x, y, *(c[..., k] for k in range(4))) - c[..., 4]
    return _to_polygon(x, y, c)


def least_while_held(
    kind: Integers,
    numbers: Array,
    velocity: Array,
    x: Array,
    u: Array,
    t: float,
    period: float,
    spread: Array,
) -> Array:
    """Return the least distance (N,) from any region, seen from all places where the robot may be.

    Of regions that stay farther away than `FAR` a lower bound of it is taken.
    """
    looks = len(spread) - 1
    s = period * np.arange(looks + 1)[:, None] / looks
    angle = 2.0 * np.pi * np.arange(DIRECTIONS if spread.any() else 1) / DIRECTIONS
    errors = np.column_stack([np.cos(angle), np.sin(angle)]) @ spread.transpose(0, 2, 1)
    widest = np.sqrt((spread**2).sum(axis=(1, 2)).max())
    travel = period * (np.hypot(x[:, 2], x[:, 3]) + 0.5 * period * np.hypot(u[:, 0], u[:, 1]))
    least = np.full(len(x), np.inf)
    for k, shape in enumerate(kind.tolist()):
        c, w = numbers[:, k], velocity[:, k]
        bound = distance(shape, c, *(x[:, :2] - w * t).T) - travel - widest
        bound -= period * np.hypot(w[:, 0], w[:, 1])
        far = bound > FAR  # distances change no faster than places
        least[far] = np.minimum(least[far], bound[far])
        near = np.flatnonzero(~far)
        for few in np.array_split(near, 1 + near.size * errors[..., 0].size // AT_ONCE):
            start, speed, held = x[few, None, :2], x[few, None, 2:], u[few, None]
            place = start + s * speed + 0.5 * s * s * held - w[few, None] * (t + s)
            px, py = np.moveaxis(place[:, :, None] + errors, -1, 0)  # (few, looks + 1, directions)
            seen = distance(shape, c[few, None, None], px, py).min(axis=(1, 2))
            least[few] = np.minimum(least[few], seen)
    return least


class Draw(NamedTuple):
    """What the scenes of one batch share."""

    period: float  # T [s]
    alpha1: Any  # α₁
    alpha2: float  # α₂'s gain [1/s]
    input_set: Any  # U
    body: float  # ρ [m]
    distance: float  # d [m]
    known: str  # how the covariance grows: "exact", "constant", "dead reckoning", "accelerating"
    kinds: tuple[int, ...]  # (m,) of `SHAPES`
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
        tuple(rng.integers(0, len(SHAPES), rng.integers(1, 4)).tolist()),
        bool(rng.random() < 0.3),
        str(rng.choice(["lex-cbf-qp", "lex-cbf-qp", "cbf-qp", "eh-cbf-qp"])),
    )


def region(kind: int, rng: np.random.Generator, moving: bool) -> tuple[Any, Array, Array]:
    """Return a region as the package and as `distance` have it, and its velocity."""
    c = np.zeros(WIDTH)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    away = rng.uniform(0.3, 2.5) * np.array([np.cos(angle), np.sin(angle)])
    velocity = rng.uniform(-0.3, 0.3, 2) if moving and kind else np.zeros(2)
    w = float(velocity[0]), float(velocity[1])
    if kind == 0:
        c[:3] = -np.cos(angle), -np.sin(angle), -rng.uniform(0.5, 2.5)
        return HalfPlane("wall", 1, (c[0], c[1]), c[2]), c, velocity
    if kind == 1:
        c[:3] = *away, 10.0 ** rng.uniform(-3.0, 0.0)
        return Disc("disc", 1, (c[0], c[1]), c[2], w), c, velocity
    if kind == 2:
        c[:5] = *away, *10.0 ** rng.uniform(-1.5, 0.2, 2), rng.uniform(0.0, 2.0 * np.pi)
        return Ellipse("ellipse", 1, (c[0], c[1]), (c[2], c[3]), c[4], w), c, velocity
    if kind == 4:
        end = away + rng.normal(0.0, 0.7, 2)
        c[:5] = *away, *end, 10.0 ** rng.uniform(-2.5, -0.3)
        return Capsule("capsule", 1, (c[0], c[1]), (c[2], c[3]), c[4], w), c, velocity
    turn = rng.uniform(0.0, 6.0) + 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    squeeze = np.array([1.0, rng.uniform(0.1, 1.0)]) * rng.uniform(0.1, 1.0)
    cos, sin = np.cos(angle), np.sin(angle)
    corners = np.column_stack([np.cos(turn), np.sin(turn)]) * squeeze
    corners = away + corners @ np.array([[cos, sin], [-sin, cos]])
    c[: 2 * CORNERS] = corners.ravel()
    return ConvexPolygon("polygon", 1, tuple(map(tuple, corners.tolist())), w), c, velocity


def covariance(known: str, t: float, size: float, shape: Array) -> Array:
    """Return P (4, 4) of the state at the time t, whose own errors grow as in its model."""
    out = np.zeros((4, 4))
    if known == "exact":
        return out
    of_position, mixed, of_velocity = 1.0 * (0.3 * size) ** 2, 0.0, 0.0
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

    region: Any  # the package's
    kind: int  # of `SHAPES`
    numbers: tuple[float, ...]  # as `distance` reads them
    start: Array  # (4,) [m] and [m/s]
    seconds: float  # how long it is followed
    size: float = 0.0  # of the errors of velocity [m/s]


def follow(d: Draw, at: Start, policy: Callable[[Array], Array]) -> tuple[float, bool]:
    """Return the least distance of the body from the region, and whether no status reported it."""
    core = _core(d, [at.region], None)
    numbers, x = np.zeros((1, 1, WIDTH)), at.start[None].astype(np.float64)
    numbers[0, 0, : len(at.numbers)] = at.numbers
    silent, nearest = False, np.inf
    kinds, still, shape = np.array([at.kind]), np.zeros((1, 1, 2)), np.eye(2)
    for step in range(round(at.seconds / d.period)):
        t = step * d.period
        known = None if d.known == "exact" else covariance(d.known, t, at.size, shape)
        u, report = core.step(policy(x[0]), [at.region], Estimate(x[0], t, known))
        spreads = _spreads(d, t, at.size, shape, shape)
        seen = least_while_held(kinds, numbers, still, x, u[None], t, d.period, spreads)
        least = float(seen[0]) - d.body
        nearest = min(nearest, least)
        silent |= least < -ROUNDING and report["status"] < FilterStatus.VIOLATED
        x = _moved(x, u[None], d.period)
    return nearest, bool(silent)


def _core(d: Draw, barriers: Any, batch: int | None) -> FilterCore:
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
    made = [[region(kind, rng, d.moving) for kind in d.kinds] for _ in range(count)]
    numbers, velocity = (np.array([[one[k] for one in scene] for scene in made]) for k in (1, 2))
    listed = tuple(tuple(one[0] for one in scene) for scene in made)
    scenes, kinds, core = BarrierSet(listed), np.array(d.kinds), _core(d, listed, count)
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
        least = least_while_held(kinds, numbers, velocity, x, u, t, d.period, spreads) - d.body
        silent |= (least < -ROUNDING) & ~bad
        entered |= least < -ROUNDING
        x = _moved(x, np.array(u), d.period)
    found = {"reported": reported, "entered": entered, "silent": silent}
    return {name: int(seen.sum()) for name, seen in found.items()}
