"""Plants and, of each, plants that differ in one number, one function or one option."""

import functools
import json
import sys
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import Enum
from typing import NamedTuple

import gymnasium as gym
import numpy as np

from hcbf_gym import Estimate, HcbfError, Plant, certificates, models
from hcbf_gym.barriers import (
    BarrierSet,
    Capsule,
    ConvexPolygon,
    Disc,
    Ellipse,
    HalfPlane,
    Shapes,
    SpeedLimit,
)
from hcbf_gym.models import Axle, Uncertainty
from hcbf_gym.models.grid import Grid
from hcbf_robots import Command, Response, Robot
from hcbf_robots.maps import MapClass, RankedMap, Scan


class Mass(gym.Env):
    """A point mass of somebody else's."""

    action_space = gym.spaces.Box(-3.0, 3.0, (2,), dtype=np.float64)
    observation_space = gym.spaces.Box(-np.inf, np.inf, (4,), dtype=np.float64)

    def __init__(self, lag=0.05, room=None):
        self.lag, self.room = lag, room

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = np.zeros(4)
        return self.x.copy(), {}

    def step(self, action):
        self.x[2:] += 0.02 * np.asarray(action)
        self.x[:2] += 0.02 * self.x[2:]
        return self.x.copy(), 0.0, False, False, {}


def state(env, observation, info):
    return Estimate(np.array(observation))


def mass(limit=3.0, **fields):
    """Return the plant of a point at rest."""
    return Plant(
        models.DoubleIntegrator(), [Disc("disc", 1, (3.0, 0.0), 0.5)],
        lambda env, observation, info: Estimate(np.zeros(4)), models.Box.symmetric(limit),
        period=0.02, **fields,
    )  # fmt: skip


BASE = Plant(
    models.DoubleIntegrator(),
    [Disc("disc", 1, (3.0, 0.0), 0.5)],
    state,
    models.Ball(3.0),
    period=0.02,
    goal=np.array([5.0, 1.0]),
    extent=((-9.0, -8.0), (7.0, 6.0)),
    uncertainty=Uncertainty(0.1, 0.2, 0.3, 0.4, 3.5, 0.15, 0.05, 0.25),
    brake=np.array([0.5, -0.5]),
    max_age=0.5,
    braking=2.0,
    fastest=1.5,
)

CHOICES = {"warn": "brake", "velocity": "body", "keepout": "unknown"}


def variants(thing):
    """Yield (where, a copy of a record, array or value that differs there alone)."""
    if is_dataclass(thing):
        names = [field.name for field in fields(thing) if field.init]
        for name in names:
            for where, value in variants(getattr(thing, name)):
                try:
                    yield f"{name} {where}", replace(thing, **{name: value})
                except HcbfError:
                    continue  # a record that refuses it
    elif isinstance(thing, tuple) and hasattr(thing, "_fields"):
        for name in thing._fields:
            for where, value in variants(getattr(thing, name)):
                yield f"{name} {where}", thing._replace(**{name: value})
    elif isinstance(thing, list | tuple):
        for k in range(len(thing)):
            for where, value in variants(thing[k]):
                yield f"{k} {where}", type(thing)([*thing[:k], value, *thing[k + 1 :]])
    elif isinstance(thing, np.ndarray):
        for k in {0, thing.size // 2, thing.size - 1}:
            other = thing.copy()
            other.ravel()[k] = ~other.ravel()[k] if other.dtype == bool else other.ravel()[k] + 0.01
            yield f"entry {k}", other
    elif isinstance(thing, bool):
        yield "flipped", not thing
    elif isinstance(thing, int):
        yield "+ 1", thing + 1
    elif isinstance(thing, float):
        yield "+ 1e-9", thing + 1e-9 * max(1.0, abs(thing))
    elif thing in CHOICES:
        yield "chosen", CHOICES[thing]
    elif isinstance(thing, str):
        yield "renamed", f"{thing}x"


def room(rows=60, columns=40):
    cells = np.zeros((rows, columns), dtype=bool)
    cells[0] = cells[:, 0] = True
    cells[10, 5:15] = True
    slow = np.zeros_like(cells)
    slow[20:30, 20:30] = True
    return RankedMap(
        Grid(0.1, (0.5, -1.0, 0.2), cells.shape),
        (
            MapClass("walls", 1, "keepout", cells, margin=0.1),
            MapClass("slow", 2, "speed", slow, limit=0.4),
        ),
    )


def scan(count=400):
    angles = np.linspace(-2.0, 2.0, count)
    points = 3.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    return Scan("laser", points, (0.1, 0.2, 0.3), 0.1, 0.2, 1, 0.05, 0.01, 0.06, 5.0)


DISCS = [Disc(f"disc {k}", 1, (float(k), 2.0), 0.3, (0.1, 0.0)) for k in range(60)]
ENTRIES = {
    "disc": Disc("one", 1, (3.0, 0.0), 0.5, (0.1, 0.2)),
    "ellipse": Ellipse("one", 2, (3.0, 0.0), (1.0, 0.5), 0.3, (0.1, 0.2)),
    "polygon": ConvexPolygon("one", 3, ((3.0, 0.0), (4.0, 0.0), (3.5, 1.0)), (0.1, 0.2)),
    "capsule": Capsule("one", 1, (3.0, 0.0), (4.0, 1.0), 0.4, (0.1, 0.2)),
    "wall": HalfPlane("one", 1, (0.6, 0.8), -3.0),
    "speed": SpeedLimit("one", 1, 1.2, 0.1),
    "map": room(),
    "scan": scan(),
}
MODELS = {
    "single": models.SingleIntegrator(),
    "double": models.DoubleIntegrator(drag=0.5),
    "unicycle": models.Unicycle(),
    "bicycle": models.KinematicBicycle(rear=1.2),
}
INPUTS = {"ball": models.Ball(3.0, 12), "box": models.Box(np.array([-1.0, -2.0]), np.ones(2))}


def records():
    """Yield (name, a plant, plants that differ from it in one field of one record each)."""
    changed = [one for one in variants(BASE) if not one[0].startswith("covered ")]
    yield "plant", BASE, changed
    for name, entry in ENTRIES.items():
        plant = replace(BASE, barriers=[entry])
        changed = ((w, replace(BASE, barriers=[v])) for w, v in variants(entry))
        yield name, plant, changed
    moved = ([*DISCS[:k], replace(DISCS[k], radius=0.31), *DISCS[k + 1 :]] for k in (0, 30, 59))
    yield (
        "60 discs",
        replace(BASE, barriers=DISCS),
        ((f"disc {k}", replace(BASE, barriers=v)) for k, v in enumerate(moved)),
    )
    for name, model in MODELS.items():
        plant = replace(BASE, model=model, brake=None)
        yield name, plant, ((w, replace(plant, model=v)) for w, v in variants(model))
    for name, limits in INPUTS.items():
        plant = replace(BASE, input_set=limits)
        yield name, plant, ((w, replace(plant, input_set=v)) for w, v in variants(limits))
    drives = replace(BASE, axle=Axle(0.2, 1.0, 1.5, 2.0))
    axles = variants(drives.axle)
    yield "axle", drives, ((w, replace(drives, axle=v)) for w, v in axles)
    values = np.array([[3.0, 0.0, 0.5], [4.0, 1.0, 0.6]])

    def shapes(values, velocity=(0.0, 0.0), priority=1):
        return replace(BASE, barriers=[Shapes("many", priority, "disc", values, velocity)])

    yield (
        "shapes",
        shapes(values),
        [
            *((w, shapes(v)) for w, v in variants(values)),
            ("velocity", shapes(values, (0.1, 0.0))),
            ("rank", shapes(values, priority=2)),
        ],
    )
    one = ENTRIES["disc"]
    sets = ((w, replace(BASE, barriers=BarrierSet([[v]]))) for w, v in variants(one))
    yield "barrier set", replace(BASE, barriers=BarrierSet([[one]])), sets
    robot = Robot(
        Command(0.8, 1.5, look_ahead=0.2),
        Response((0.9, 0.8), 0.3, 0.1, (0.003, 0.01, 0.04), lasting=0.01),
        0.3,
        known_as="cart",
    )
    yield "robot", of_robot(robot), ((w, of_robot(v)) for w, v in variants(robot))


def of_robot(robot):
    """Return a plant whose reader knows a robot."""
    return replace(BASE, state=functools.partial(seen_by, robot))


def seen_by(robot, env, observation, info):
    return Estimate(np.array(observation) * robot.reach)


GAIN, TABLE = 0.5, {"gain": 0.5, "names": {"a", "b"}}
FAR = np.linspace(0.0, 1.0, 2000)
PAIRS = np.zeros(1500, dtype=[("a", "f8"), ("b", "i4")])


def helper(x):
    return GAIN * x


class Mode(Enum):
    SLOW = 0.5
    FAST = 1.0


class Gains(NamedTuple):
    p: float
    d: float


@dataclass
class Filter:
    gains: Gains
    mode: Mode = Mode.SLOW

    def __call__(self, env, observation, info):
        return Estimate(np.array(observation) * self.gains.p * self.mode.value)


class Reader:
    def __init__(self, gain, far=FAR):
        self.gain, self.far = gain, far

    def read(self, env, observation, info):
        return Estimate(np.array(observation) * self.gain)

    def __call__(self, env, observation, info):
        return self.read(env, observation, info)


class Slotted:
    __slots__ = ("gain",)

    def __init__(self, gain):
        self.gain = gain

    def __call__(self, env, observation, info):
        return Estimate(np.array(observation) * self.gain)


def closed(gain):
    def read(env, observation, info):
        return Estimate(np.array(observation) * gain)

    return read


def nested(gain):
    def outer(env, observation, info):
        return Estimate(sum((lambda: np.array(observation) * gain)() for _ in range(1)))

    return outer


def defaults(gain):
    def read(env, observation, info, gain=gain, *, offset=0.0):
        return Estimate(np.array(observation) * gain + offset)

    return read


def keywords(gain):
    def read(env, observation, info, *, gain=gain):
        return Estimate(np.array(observation) * gain)

    return read


def attribute(gain):
    def read(env, observation, info):
        return Estimate(np.array(observation) * read.gain)

    read.gain = gain
    return read


def scaled(gain, env, observation, info):
    return Estimate(np.array(observation) * gain)


def of_text(text):
    """Return the reader `read` that a text defines, in a new module."""
    names = {"np": np, "Estimate": Estimate, "__name__": "mine"}
    exec(text, names)
    return names["read"]


TEXT = """
GAIN, MODE = 0.5, "slow"
TABLE = {"slow": 1.0, "fast": 2.0}

class Base:
    factor = 1.0
    def scale(self, x):
        return self.factor * x

class Own(Base):
    @property
    def offset(self):
        return 0.25
    @staticmethod
    def shift(x):
        return x + 0.125
    @classmethod
    def power(cls, x):
        return x ** 2

def inner(x):
    return x * GAIN

def helper(x):
    return inner(x) + TABLE[MODE]

def read(env, observation, info):
    one = Own()
    x = one.shift(one.power(one.scale(helper(np.array(observation))))) + one.offset
    return Estimate(np.where(x > 7.0, np.sin(x), x))
"""
EDITS = (
    ("GAIN, MODE = 0.5", "GAIN, MODE = 0.501"), ('"slow"\nTABLE', '"fast"\nTABLE'),
    ('"slow": 1.0', '"slow": 1.5'), ("factor = 1.0", "factor = 1"), ("0.25", "0.26"),
    ("0.125", "0.126"), ("x ** 2", "x ** 3"), ("x * GAIN", "x / GAIN"),
    ("inner(x) +", "inner(x) -"),
    ("np.sin", "np.cos"), ("7.0", "7.5"), ("class Own(Base)", "class Own(Base, dict)"),
    ("x > 7.0", "x >= 7.0"), ("one.shift(one.power(", "one.power(one.shift("),
    ("self.factor * x", "self.factor + x"), ("    return x * GAIN", "    return -x * GAIN"),
)  # fmt: skip


def functions():
    """Yield (name, a reader, readers that differ from it in one value or in their text)."""
    rng = np.random.default_rng
    makers = {
        "closure": closed, "nested": nested, "default": defaults, "keyword": keywords,
        "attribute": attribute, "object": Reader, "slots": Slotted,
        "method": lambda gain: Reader(gain).read,
        "partial": lambda gain: functools.partial(scaled, gain),
        "keyword partial": lambda gain: functools.partial(scaled, gain, info=gain),
        "list": lambda gain: closed([1.0, [gain]]), "dict": lambda gain: closed({"a": {"b": gain}}),
        "set": lambda gain: closed({"a", "b", gain}),
        "frozen set": lambda gain: closed(frozenset({"a", "b", gain})),
        "record": lambda gain: Filter(Gains(gain, 0.5)),
        "named tuple": lambda gain: closed(Gains(0.5, gain)),
        "object array": lambda gain: closed(np.array([gain, "a"], dtype=object)),
    }  # fmt: skip
    gains = (0.5, 0.5 + 1e-12, -0.5, np.float64(0.5), np.float32(0.5), 0, False, None, "0.5")
    for name, make in makers.items():
        yield name, make(gains[0]), [(f"{g!r}", make(g)) for g in gains[1:]]
    yield "enum", Filter(Gains(0.5, 0.5)), [("fast", Filter(Gains(0.5, 0.5), Mode.FAST))]
    for name, whole in {"floats": FAR, "bits": FAR > 0.3}.items():
        yield name, closed(whole), [(where, closed(one)) for where, one in variants(whole)]
    changed = PAIRS.copy()
    changed["b"][700] = 1
    yield "records", Reader(0.5, PAIRS), [("entry", Reader(0.5, changed))]
    random = [(f"seed {seed}", closed(rng(seed))) for seed in (1, 2)]
    yield "generator", closed(rng(0)), random
    others = [
        (f"{dtype} {shape}", closed(np.zeros(shape, dtype)))
        for dtype in (np.float64, np.float32, np.int64)
        for shape in ((2, 3), (3, 2), (6,), (6, 1))
    ]
    yield "array", others[0][1], others[1:]
    texts = [(new, of_text(TEXT.replace(old, new))) for old, new in EDITS]
    yield "text", of_text(TEXT), texts


def plants():
    """Yield (name, a plant, plants that differ from it in one thing each)."""
    yield from records()
    for name, reader, others in functions():
        changed = ((f"{where}", replace(BASE, state=one)) for where, one in others)
        yield f"state: {name}", replace(BASE, state=reader), changed
    for field in ("barriers", "goal", "extent", "brake"):
        changed = [("another", replace(BASE, **{field: closed(0.6)}))]
        yield f"{field}: reader", replace(BASE, **{field: closed(0.5)}), changed
    acting = replace(BASE, to_action=closed(0.5), from_action=closed(2.0))
    yield (
        "action",
        acting,
        [
            ("to_action", replace(acting, to_action=closed(0.6))),
            ("from_action", replace(acting, from_action=closed(2.1))),
            ("none", BASE),
        ],
    )
    affine = [drifting(a) for a in (0.1, 0.2, 0.3)]
    changed = [(f"{k}", replace(BASE, model=one, brake=None)) for k, one in enumerate(affine[1:])]
    yield "affine", replace(BASE, model=affine[0], brake=None), changed


def drifting(a):
    return models.ControlAffine(lambda x: a * x, lambda x: np.eye(4)[:, 2:], 4, 2, 2)


def identities():
    """Return name → what identifies the plant, of every plant."""
    env, found = Mass(), {}
    for name, plant, others in plants():
        for where, one in [("", plant), *others]:
            found[f"{name}: {where}"] = certificates.declared(one, env, None, {})
    return found


if __name__ == "__main__":
    json.dump(identities(), sys.stdout)
