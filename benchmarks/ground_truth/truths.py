"""Double integrators whose kernel is known: from which states an input exists that never enters.

T = 0.02 s, U = [−5, 5]² m/s². Beside a wall the kernel is a formula. Outside of discs it is
searched: a state belongs to it if a constant input, or one that changes once, stays outside until
the robot moves away. The search finds too few states rather than too many.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import Barrier, Disc, HalfPlane

PERIOD, REACH, RADIUS = 0.02, 5.0, 0.5
_SIDE = np.linspace(-REACH, REACH, 17)
BORDER = np.unique(
    np.vstack([np.c_[_SIDE, np.full(17, e)][:, ::o] for e in (-REACH, REACH) for o in (1, -1)]),
    axis=0,
)
"""(64, 2) inputs on the border of U."""
_MANY = 400
"""States that are searched at once: more need too much memory."""

Height = Callable[[Array], Array]
"""(…, 2) positions → h."""


class Truth(NamedTuple):
    """One region, and what is known of it."""

    name: str
    condition: Barrier
    h: Height
    value: Callable[[Array], Array]  # states (N, 4) → the greatest least h that an input reaches
    best: Callable[[Array], Array]  # states (N, 4) → the input (N, 2) that reaches it

    def aim(self, x: Array) -> Array:
        """Return the inputs (N, 2) that drive straight at the region."""
        away = x[:, :2] if self.name == "disc" else np.tile([1.0, 0.0], (len(x), 1))
        return -to_border(away)

    def permits(self, x: Array, u: Array) -> Mask:
        """Return (N,) whether the kernel contains a held input's path and its end."""
        after, inside = advance(x, u), least(x, u, self.h) >= 0.0
        # where braking on the straight line is enough, no search is needed
        known = self.h(after[:, :2]) >= (after[:, 2:] ** 2).sum(axis=1) / (2.0 * REACH)
        inside[inside & ~known] = self.value(after[inside & ~known]) >= 0.0
        return inside

    def sample(self, n: int, speed: float, rng: np.random.Generator) -> Array:
        """Return n states of the kernel, no faster than `speed` and within its reach."""
        far, found = 0.5 * (1.0 + speed), np.empty((0, 4))
        while len(found) < n:
            p = rng.uniform(-RADIUS - far, RADIUS + far, (2 * n, 2))
            if self.name == "half-plane":
                p[:, 0] = rng.uniform(0.0, far, 2 * n)
            p = p[(self.h(p) > 0.0) & (self.h(p) < far)]
            x = np.c_[p, of_speed(len(p), speed, rng)]
            found = np.vstack([found, x[self.value(x) >= 0.0]])
        return found[:n]


def to_border(direction: Array) -> Array:
    """Return the inputs (N, 2) on the border of U in directions (N, 2)."""
    return REACH * direction / np.maximum(np.abs(direction).max(axis=1, keepdims=True), 1e-9)


def of_speed(n: int, speed: float, rng: np.random.Generator) -> Array:
    """Return velocities (n, 2), uniform in a disc [m/s]."""
    angle, size = rng.uniform(0.0, 2.0 * np.pi, n), speed * np.sqrt(rng.uniform(0.0, 1.0, n))
    return np.c_[size * np.cos(angle), size * np.sin(angle)]


def advance(x: Array, u: Array) -> Array:
    """Return the states (N, 4) after a hold."""
    return np.c_[at(x, u, PERIOD), x[:, 2:] + PERIOD * u]


def at(x: Array, u: Array, t: float) -> Array:
    """Return the positions (N, 2) within a hold."""
    return x[:, :2] + t * x[:, 2:] + 0.5 * t * t * u


def least(x: Array, u: Array, h: Height, looks: int = 4) -> Array:
    """Return the least h (N,) within a hold."""
    return np.min([h(at(x, u, PERIOD * k / looks)) for k in range(looks + 1)], axis=0)


def wall() -> Truth:
    """Return the half-plane x ≥ 0, whose kernel is h ≥ v²/(2·5) of the approach."""
    return Truth(
        "half-plane",
        HalfPlane("wall", 1, normal=(1.0, 0.0), offset=0.0),
        lambda p: p[..., 0],
        lambda x: x[:, 0] - np.minimum(x[:, 2], 0.0) ** 2 / (2.0 * REACH),
        lambda x: np.tile([REACH, 0.0], (len(x), 1)),
    )


def disc() -> Truth:
    """Return the outside of one disc at the origin, whose kernel is searched."""
    return Truth(
        "disc",
        Disc("disc", 1, center=(0.0, 0.0), radius=RADIUS),
        _outside,
        lambda x: _search(x)[0],
        lambda x: BORDER[_search(x)[1]],
    )


def _outside(p: Array, center: tuple[float, float] = (0.0, 0.0)) -> Array:
    return np.hypot(p[..., 0] - center[0], p[..., 1] - center[1]) - RADIUS


def _search(x: Array) -> tuple[Array, Integers]:
    """Return the value (N,) of constant inputs, and which one of `BORDER` (N,) has it."""
    value, which = np.empty(len(x)), np.empty(len(x), dtype=np.int64)
    for i in range(0, len(x), _MANY):
        part = x[i : i + _MANY]
        end = np.maximum(2.5 * np.hypot(part[:, 2], part[:, 3]) / REACH, 0.1)
        h = _outside(_along(part, BORDER, end[:, None] * np.linspace(0.0, 1.0, 49))).min(axis=2)
        which[i : i + _MANY] = best = h.argmax(axis=1)
        finely = _along(part, BORDER[best][:, None], end[:, None] * np.linspace(0.0, 1.0, 401))
        value[i : i + _MANY] = _outside(finely)[:, 0].min(axis=1)
    return value, which


def _along(x: Array, u: Array, t: Array) -> Array:
    """Return the positions (N, k, T, 2) of N states under k inputs at their times t (N, T)."""
    u, t = (u[None] if u.ndim == 2 else u)[:, :, None], t[:, None, :, None]
    return x[:, None, None, :2] + t * x[:, None, None, 2:] + 0.5 * t * t * u


ASIDE = 0.7
"""Where the disc of rank 2 is, beside that of rank 1 at the origin [m]: they overlap."""


def pair_values(x: Array) -> tuple[Array, Array]:
    """Return at states (N, 4) the greatest least h₁, and that of min(h₁, h₂).

    One and two constant inputs are searched.
    """
    first, both = np.full((2, len(x)), -np.inf)
    for i in range(0, len(x), _MANY // 8):
        part, here = x[i : i + _MANY // 8], slice(i, i + _MANY // 8)
        end = np.maximum(2.5 * np.hypot(part[:, 2], part[:, 3]) / REACH, 0.2)
        t = (end[:, None] * np.linspace(0.0, 1.0, 41))[:, None, :, None]
        for turn in (np.inf, 0.05, 0.1, 0.2, 0.4):
            early = np.minimum(t, turn)
            late = t - early
            for u in BORDER[::2]:
                second = BORDER[: 1 if turn == np.inf else None : 4][None, :, None]
                v = part[:, None, None, 2:] + early * u
                p = part[:, None, None, :2] + 0.5 * early * (part[:, None, None, 2:] + v)
                p = p + late * (v + 0.5 * late * second)
                h1 = _outside(p).min(axis=2)
                h12 = np.minimum(h1, _outside(p, (ASIDE, 0.0)).min(axis=2))
                first[here] = np.maximum(first[here], h1.max(axis=1))
                both[here] = np.maximum(both[here], h12.max(axis=1))
    return first, both


def pair() -> tuple[list[Barrier], list[Height]]:
    """Return the two discs, rank 1 first, and their h."""
    centers = ((0.0, 0.0), (ASIDE, 0.0))
    discs = [Disc(f"rank {k + 1}", k + 1, c, RADIUS) for k, c in enumerate(centers)]
    return list(discs), [lambda p, c=c: _outside(p, c) for c in centers]


def sample_pair(n: int, speed: float, rng: np.random.Generator) -> Array:
    """Return n states near both discs and outside of rank 1."""
    p = rng.uniform((-1.5, -1.5), (2.2, 1.5), (30 * n, 2))
    near = (_outside(p) > 0.0) & (_outside(p) < 1.0) & (_outside(p, (ASIDE, 0.0)) < 1.0)
    p = p[near][:n]
    return np.c_[p, of_speed(len(p), speed, rng)]
