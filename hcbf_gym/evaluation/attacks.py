"""Hostile policies, which try to push the robot into a strict region with the full input.

An attack of your own is an `Attack`, or any function s → u*. Its name is ``module:name`` or
``file.py:name``, so that every process finds it.

>>> class Spiral(Attack):
...     def act(self, s: Surroundings) -> Array:
...         circle = np.array([np.cos(3.0 * s.time), np.sin(3.0 * s.time)])
...         return full(0.5 * circle - s.normal[0])
>>> normal = np.array([[1.0, 0.0]])
>>> s = Surroundings(np.zeros(2), np.zeros(2), np.array([0.3]), normal, 0.0)
>>> Spiral(np.random.default_rng(0)).act(s)
array([-5.,  0.])
"""

import inspect
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from hcbf_gym import loading
from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, choose, finite_array
from hcbf_gym.locomotion.gait import GAITS

FULL = 5.0  # the limit of each input [m/s²]; the filter projects inputs that its U does not hold
BEYOND = 1.0  # pieces of a map are observed if no more than this farther than the nearest [m]
STREAM = 42  # makes an attack's random numbers differ from those of a scene of the same seed
GAIT_PERIOD = GAITS["trot"].period
"""The period of the default trot [s], with which `GaitPhase` reverses."""


class View(Protocol):
    """What an attack observes of a plant of any model: the true state."""

    @property
    def time(self) -> float:
        """Time since the reset [s]."""
        ...

    @property
    def corners(self) -> Array:
        """(k, n_u) the corners of U, the set of inputs."""
        ...

    def corner(self, rng: np.random.Generator) -> Array:
        """Return a random corner of U (n_u,)."""
        ...

    def push(
        self, nearest: float, second: float = 0.0, sideways: float = 0.0, speed: float = 0.0
    ) -> Array:
        """Return the input (n_u,) that lowers ``nearest·h₁ + second·h₂`` the most.

        Args:
            nearest: weight of the least strict h, h₁; a negative one moves away.
            second: weight of the second least, h₂.
            sideways: weight of a motion along the region's edge, if the plant moves in a plane.
            speed: the speed of that motion, positive to the left of the outward normal [m/s].
        """
        ...


@dataclass
class Surroundings:
    """What an attack observes of a robot that moves in the plane like a double integrator."""

    position: Array  # (2,) of the trunk [m]
    velocity: Array  # (2,) of the trunk [m/s]
    h: Array  # (k,) of the strict barriers on the position, nearest first [m]; k ≥ 1
    normal: Array  # (k, 2) the unit gradients of h, which point away from the regions
    time: float  # since the reset [s]

    @property
    def second(self) -> Array:
        """(2,) the unit gradient of the second nearest barrier; zero if there is only one."""
        return self.normal[1] if len(self.normal) > 1 else np.zeros(2)

    @property
    def corners(self) -> Array:
        """(4, 2) the corners of the box |u_i| ≤ `FULL` [m/s²]."""
        return FULL * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])

    def corner(self, rng: np.random.Generator) -> Array:
        """Return a random corner (2,) [m/s²]."""
        return rng.choice([-FULL, FULL], 2)

    def push(
        self, nearest: float, second: float = 0.0, sideways: float = 0.0, speed: float = 0.0
    ) -> Array:
        """Return the full input (2,) into the regions [m/s²]; see `View.push`."""
        inwards = -(nearest * self.normal[0] + second * self.second)
        along = _left(self.normal[0])
        acceleration = np.clip(4.0 * (speed - self.velocity @ along) / FULL, -1.0, 1.0)
        return full(inwards + 3.0 * sideways * acceleration * along)


def observe(env: Any) -> Surroundings:
    """Return what an attack observes of an environment of this package.

    Raises:
        InvalidInputError: if no strict barrier of its scene reads the position.
    """
    inner = env.unwrapped
    x, t = inner.truth[None], np.array([inner.time])
    h, sensed = inner.barrier_set.sense(x, t)
    strict = np.flatnonzero(inner.barrier_set.keeps_margin[0] > 0.0)
    maps = inner.barrier_set.atlas.held
    shapes = [k for k in strict if (0, k) not in maps]
    observed = [(h[0, shapes], sensed[0, shapes, 1:3])]
    observed += [maps[0, k].near(x[0], BEYOND) for k in strict if (0, k) in maps]
    distances, normals = zip(*observed, strict=True)
    distance, normal = np.concatenate(distances), np.concatenate(normals)
    if not distance.size:
        raise InvalidInputError(
            f"attack: scene {inner.scenario.name!r} has no strict barrier on the position, "
            "expected at least one"
        )
    order = np.argsort(distance, kind="stable")
    return Surroundings(x[0, :2], x[0, 2:], distance[order], normal[order], float(inner.time))


def full(direction: Array) -> Array:
    """Return the greatest input (2,) of the box |u_i| ≤ `FULL` along a direction (2,) [m/s²]."""
    size = np.abs(direction).max()
    return direction * (FULL / size) if size > 1e-9 else np.zeros(2)


def _left(normal: Array) -> Array:
    """Return the unit vector (2,) along a region's edge, to the left of its normal (2,)."""
    return np.array([-normal[1], normal[0]])


@dataclass
class Attack:
    """A hostile policy s → u*."""

    rng: np.random.Generator  # the source of its random choices
    until: float = field(default=-1.0, init=False)  # the time at which the choice ends [s]
    choice: Any = field(default=None, init=False)  # the present random choice

    def act(self, s: Any) -> Array:
        """Return u* (n_u,) for a `View`, or (2,) [m/s²] for the `Surroundings` in a plane."""
        raise NotImplementedError

    def draw(self, s: View, low: float, high: float, pick: Callable[[], Any]) -> Any:
        """Return the newest choice of `pick`; each is held for a random time, low to high [s]."""
        if s.time >= self.until:
            self.until, self.choice = s.time + self.rng.uniform(low, high), pick()
        return self.choice


class Nearest(Attack):
    """Drives straight at the nearest strict region."""

    def act(self, s: View) -> Array:
        return s.push(1.0)


class BangBang(Attack):
    """Takes random corners of U, and holds each for 0.1 to 0.5 s."""

    def act(self, s: View) -> Array:
        return self.draw(s, 0.1, 0.5, lambda: s.corner(self.rng))


class Wandering(Attack):
    """Takes random mixtures of the corners of U, and holds each for 0.2 to 1 s; not hostile."""

    def act(self, s: View) -> Array:
        uniform = np.ones(len(s.corners))
        return self.draw(s, 0.2, 1.0, lambda: self.rng.dirichlet(uniform) @ s.corners)


class Rotating(Attack):
    """Turns the full input, once in two seconds."""

    def act(self, s: Surroundings) -> Array:
        angle = np.pi * s.time
        return full(np.array([np.cos(angle), np.sin(angle)]))


class Corner(Attack):
    """Drives into the corner of the two nearest strict regions: it lowers h₁ + 0.9 h₂."""

    def act(self, s: View) -> Array:
        return s.push(1.0, 0.9)


class Edge(Attack):
    """Drives along a strict edge at 1.6 m/s, with random reversals, and presses against it."""

    def act(self, s: Surroundings) -> Array:
        side = self.draw(s, 0.3, 1.5, lambda: self.rng.choice([-1.0, 1.0]))
        along = _left(s.normal[0])
        acceleration = 10.0 * (1.6 * side - s.velocity @ along)
        return np.clip(acceleration * along - FULL * s.normal[0], -FULL, FULL)


class GaitPhase(Attack):
    """Presses against the nearest region, and reverses sideways with half periods of the gait."""

    def act(self, s: Surroundings) -> Array:
        side = 2.0 * (np.floor(2.0 * s.time / GAIT_PERIOD) % 2.0) - 1.0  # −1 or 1
        return full(-s.normal[0] + side * _left(s.normal[0]))


class Slam(Attack):
    """Backs off from the nearest region and then drives into it, each for a random time."""

    def act(self, s: View) -> Array:
        away = self.draw(s, 0.4, 1.2, lambda: -1.0 if self.choice == 1.0 else 1.0)
        return s.push(-away)


PARAMETERS = ("second", "sideways", "period", "jitter", "speed", "back")
"""The names of the parameters of `Searched`, each in [0, 1]."""


@dataclass
class Searched(Attack):
    """An attack with six numbers in [0, 1], which a search sets.

    Args:
        parameters: (6,) weight of the second region, weight of the motion along the edge, period of
            reversals, their jitter, speed along the edge, share of time in which it backs off.
    """

    parameters: tuple[float, ...] = (0.5,) * 6

    def act(self, s: View) -> Array:
        second, sideways, period, jitter, speed, back = self.parameters
        mean_time = 0.1 + 1.9 * period  # between reversals [s]
        low, high = mean_time * (1.0 - 0.9 * jitter), mean_time * (1.0 + 0.9 * jitter)
        flipped = 1.0 if self.choice is None else -self.choice[0]
        side, backs_off = self.draw(s, low, high, lambda: (flipped, self.rng.random() < 0.6 * back))
        press = -1.0 if backs_off else 1.0
        return s.push(press, press * second, sideways, 2.0 * speed * side)


TRAINED = Path(__file__).with_name("trained_attack.json")
"""The file of the default parameters of `Trained`, with the command that made them."""
N_TRAINED = 20  # the number of parameters of `Trained`


@cache
def _trained() -> tuple[float, ...]:
    return tuple(json.loads(TRAINED.read_text(encoding="utf-8"))["parameters"])


@dataclass
class Trained(Attack):
    """A linear policy of nine features, whose twenty numbers CMA-ES has trained.

    In the axes of the nearest strict region, n towards it and l along its edge, u* is the full
    input along ``W φ`` with

    φ = (1, tanh(h₁ / 0.3 m), tanh((h₂ − h₁) / 0.3 m), v·n, v·l, n₂·n, n₂·l, cos(2πt / T), ±1),

    where n₂ points towards the second nearest region and the last sign changes at random.

    Args:
        parameters: (20,) W row by row, log₂ of the period T [s] and of the mean time between
            changes of the sign [s]; by default those in `TRAINED`.
    """

    parameters: tuple[float, ...] = field(default_factory=_trained)

    def act(self, s: Surroundings) -> Array:
        weights = np.reshape(self.parameters[:18], (2, 9))
        period, hold = np.exp2(np.clip(self.parameters[18:], -3.0, 3.0))
        sign = self.draw(s, 0.5 * hold, 1.5 * hold, lambda: self.rng.choice([-1.0, 1.0]))
        axes = np.array([-s.normal[0], _left(s.normal[0])])
        farther = s.h[1] - s.h[0] if len(s.h) > 1 else np.inf  # the second nearest region
        features = np.array([
            1.0, np.tanh(s.h[0] / 0.3), np.tanh(farther / 0.3), *(axes @ s.velocity),
            *(axes @ -s.second), np.cos(2.0 * np.pi * s.time / period), sign,
        ])  # fmt: skip
        return full(weights @ features @ axes)


class Called(Attack):
    """An attack that calls a function s → u* (2,) [m/s²]."""

    def __init__(self, function: Callable[[Surroundings], Any]):
        super().__init__(np.random.default_rng(0))
        self._function = function

    def act(self, s: Surroundings) -> Array:
        return finite_array("attack", self._function(s), (2,))


ATTACKS: dict[str, type[Attack]] = {
    "nearest": Nearest,
    "bang-bang": BangBang,
    "rotating": Rotating,
    "corner": Corner,
    "edge": Edge,
    "gait": GaitPhase,
    "slam": Slam,
    "trained": Trained,
}
"""The hostile policies in the plane, by their names."""
ON_ANY_MODEL: dict[str, type[Attack]] = {
    "nearest": Nearest,
    "corner": Corner,
    "slam": Slam,
    "bang-bang": BangBang,
    "wandering": Wandering,
}
"""The policies that need no more than a `View`, by their names."""


def make(name: str, seed: int, parameters: tuple[float, ...] | None = None) -> Attack:
    """Return an attack.

    Args:
        name: one of `ATTACKS` or `ON_ANY_MODEL`; "searched" with parameters; or ``module:name`` or
            ``file.py:name`` of an `Attack`, or of a function s → u*.
        seed: seeds its random choices.
        parameters: those of `Searched`, or other ones than the default of `Trained`.

    Raises:
        InvalidInputError: if there is no such attack.
    """
    rng = np.random.default_rng([STREAM, seed])
    if parameters is not None:
        return {"searched": Searched, "trained": Trained}[name](rng, parameters)
    if loading.is_function(name):
        loaded = loading.function("attack", name)
        if isinstance(loaded, type) and issubclass(loaded, Attack):
            return loaded(rng)
        return Called(loaded)
    return choose("attack", name, ATTACKS | ON_ANY_MODEL)(rng)


def is_attack(name: str) -> bool:
    """Return whether a name is that of an attack rather than of a policy.

    A function s → u* of one argument is an attack; one of two arguments is a policy.

    Raises:
        InvalidInputError: if the name is that of a function that does not exist.
    """
    if not loading.is_function(name):
        return name in ATTACKS or name in ON_ANY_MODEL
    loaded = loading.function("policy", name)
    if inspect.isclass(loaded):
        return issubclass(loaded, Attack)
    return len(inspect.signature(loaded).parameters) == 1
