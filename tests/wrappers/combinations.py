"""Random combinations of model, input, program, shape and fault, judged between samples.

``python -m tests.wrappers.combinations 1000`` counts the statuses; it fails
where a strict condition is entered under NOMINAL, SAFE or RELAXED.
"""

import sys
import warnings
from collections import Counter
from dataclasses import replace

import numpy as np

sys.path.insert(0, __file__.rpartition("/")[0])
from barrier_inputs import CALM, FAR, INPUTS, Scene, T, World, quietly
from test_barrier_inputs import CORES, filter_of, why_not

from hcbf_gym import models, programs
from hcbf_gym.barriers import Capsule, ConvexPolygon, Disc, Ellipse, HalfPlane
from hcbf_gym.errors import HcbfError
from hcbf_gym.programs import FilterStatus

STEPS = 120
FAULTS = ("none", "nan", "late", "clock", "push", "news", "far", "news while blind", "raises")


class Shaped(Scene):
    """A scene of any conditions, which only lists hold.

    Args:
        conditions: of any shapes.
    """

    def __init__(self, conditions):
        super().__init__()
        self.conditions = conditions

    def listed(self):
        return [*self.conditions]

    def distance(self, x, t):
        return min((one.h(x, t) for one in self.conditions if one.priority == 1), default=np.inf)


def shape(rng, name, rank, away, moves):
    """A shape that keeps `away` from the origin, by any name."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    ahead = np.array([np.cos(angle), np.sin(angle)])
    velocity = tuple(rng.uniform(-0.3, 0.3, 2)) if moves else (0.0, 0.0)
    size, turn = rng.uniform(0.2, 0.8, 2), rng.uniform(0.0, np.pi)
    center = tuple((away + size.max()) * ahead)
    match rng.integers(5):
        case 0:
            return Disc(name, rank, center, size[0], velocity)
        case 1:
            return HalfPlane(name, rank, tuple(-ahead), -away)
        case 2:
            return Ellipse(name, rank, center, tuple(size), turn, velocity)
        case 3:
            along = 0.5 * size[0] * np.array([np.cos(turn), np.sin(turn)])
            ends = tuple(np.add(center, along)), tuple(np.subtract(center, along))
            return Capsule(name, rank, *ends, 0.3 * size.min(), velocity)
        case _:
            corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * 0.5 * size
            c, s = np.cos(turn), np.sin(turn)
            corners = corners @ np.array([[c, s], [-s, c]]) + center
            return ConvexPolygon(name, rank, tuple(map(tuple, corners)), velocity)


def drawn(rng, around, name, count):
    """A scene around a place: of any shapes, or where an input can place but one, a wall."""
    if name not in ("list", "reader"):
        return Scene(wall=round(20.0 * (around[0] + rng.uniform(0.4, 3.0))) / 20.0)
    found = []
    for k in range(count):
        one = shape(rng, f"{k}", 1 if k == 0 else int(rng.integers(1, 4)), rng.uniform(0.3, 2.0),
                    rng.random() < 0.4)  # fmt: skip
        found.append(one)
    ranks = sorted({one.priority for one in found})
    shift = np.array(around)
    moved = [translated(one, shift) for one in found]
    assert ranks[0] == 1
    return Shaped(moved)


def translated(one, shift):
    match one:
        case HalfPlane():
            return replace(one, offset=one.offset + float(np.dot(one.normal, shift)))
        case Capsule():
            return replace(one, start=tuple(one.start + shift), end=tuple(one.end + shift))
        case ConvexPolygon():
            return replace(one, vertices=tuple(tuple(v + shift) for v in np.array(one.vertices)))
        case _:
            return replace(one, center=tuple(one.center + shift))


def towards(world):
    """The direction of the nearest strict condition, a moment ahead."""
    t = T * world.steps
    x = world.x[:2] + 0.2 * world.x[2:]
    near = [world.scene.distance(np.array([*(x + 1e-3 * np.eye(2)[k]), 0, 0]), t) for k in (0, 1)]
    return world.scene.distance(np.array([*x, 0, 0]), t) - np.array(near)


def combination(seed, reported):
    """Run one combination; return what was entered under a calm status, "" for nothing."""
    rng = np.random.default_rng([77, seed])
    while True:
        core, name = rng.choice(CORES), rng.choice(INPUTS)
        fault, program = rng.choice(FAULTS), rng.choice(programs.names())
        cell = "raises" if fault == "raises" else "nan"
        if not why_not(name, core, cell) and (name != "change_scene" or fault != "push"):
            break
    count = int(rng.integers(1, 4))
    world = World(models.DoubleIntegrator(drag=0.1 * (core == "drag")))
    world.scene = drawn(rng, (0.0, 0.0), name, count)
    guidance = "geodesic" if rng.random() < 0.3 and core != "drag" else None
    goal = (FAR - 1.0, 0.0)
    try:
        filtered = filter_of(name, core, world, guidance=guidance, goal=goal, program=str(program))
        quietly(filtered.reset)
    except HcbfError:
        reported["refused"] += 1
        return ""
    at, hostile = int(rng.integers(5, STEPS // 2)), rng.random() < 0.6
    lasts = int(rng.integers(1, 15))
    u, entered = np.zeros(2), ""
    for k in range(STEPS):
        if k % int(rng.integers(1, 20)) == 0:
            u = 5.0 * np.sign(towards(world) if hostile else rng.normal(size=2))
        world.lie, world.raises = None, False
        if at <= k < at + lasts:
            match fault:
                case "nan" | "news while blind":
                    world.lie = lambda e: e._replace(x=np.full(4, np.nan))
                case "late":
                    world.lie = lambda e: e._replace(age=0.3)
                case "clock":
                    world.lie = lambda e: e._replace(time=0.0)
                case "far":
                    world.lie = lambda e: e._replace(x=1e6 * np.ones(4))
                case "raises":
                    world.raises = True
        if k == at and fault == "push":
            world.x[2:] += rng.normal(size=2)
        if k == at + lasts // 2 and fault.startswith("news"):
            world.scene = drawn(rng, world.x[:2], name, count)
        before = world.scene.distance(world.x, T * world.steps)
        report = quietly(filtered.step, u)
        reported[FilterStatus(report["status"]).name] += 1
        reported["entered"] += world.entered or before < 0.0
        calm = report["status"] < CALM
        if calm and (world.entered or before < -1e-6):
            deep = world.scene.distance(world.x, T * world.steps)
            entered = (
                f"{seed}: {core}, {name}, {program}, {fault}, guidance {guidance}: step {k} was "
                f"{FilterStatus(report['status']).name}, {before:.4f} → {deep:.4f}"
            )
            break
    return entered


def main(count, first=0):
    """Run so many combinations; fail where one is entered under a calm status."""
    warnings.simplefilter("ignore")
    reported, found = Counter(), []
    for seed in range(first, first + count):
        entered = combination(seed, reported)
        if entered:
            found.append(entered)
            print(entered, flush=True)
    print(dict(reported))
    if found:
        raise SystemExit(f"{len(found)} of {count} combinations were entered under a calm status")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
