"""Barriers as a sequence or from a reader, in front of every core: for `test_barrier_inputs`.

A wall is across the path of a point. Each input places it in its own terms; each core filters the
same point.
"""

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import hcbf_gym
from hcbf_gym import Estimate, models, scenarios, wrappers
from hcbf_gym.barriers import ConvexPolygon, Disc, Shapes
from hcbf_gym.envs.regions import RegionsEnv
from hcbf_gym.envs.regions_vector import RegionsVectorEnv
from hcbf_gym.programs import FilterStatus
from hcbf_gym.scenarios.references import PointReference
from hcbf_robots import Command, Response, Robot, VelocityFilter, maps
from tests.worlds import World

T = 0.02
LIMIT = 5.0
FAR = 20.0
AHEAD = np.array([LIMIT, 0.0])
CALM = FilterStatus.VIOLATED  # what is below it promises something
HALF, THICK = 3.0, 1.0
AFAR = 5.0
GRID = maps.Grid(0.05, (-5.0, -HALF, 0.0), (120, 600))


@dataclass
class Scene:
    """What stands around.

    Args:
        wall: where the near side of the wall is [m].
        others: further conditions.
    """

    wall: float = FAR
    others: tuple[Any, ...] = ()

    def corners(self):
        near, far = self.wall, self.wall + THICK
        return [(near, -HALF), (far, -HALF), (far, HALF), (near, HALF)]

    def listed(self):
        return [ConvexPolygon("wall", 1, self.corners()), *self.others]

    def shapes(self):
        return [Shapes("wall", 1, "convex-polygon", [self.corners()]), *self.others]

    def mapped(self):
        cells = np.zeros(GRID.shape, dtype=np.bool_)
        at = round((self.wall - GRID.origin[0]) / GRID.resolution)
        cells[:, at : at + round(THICK / GRID.resolution)] = True
        return [maps.RankedMap(GRID, (maps.MapClass("wall", 1, "keepout", cells),)), *self.others]

    def scanned(self):
        """The near side, as a sensor sees it from afar, and all that is behind it."""
        y = np.arange(-HALF, HALF + 0.02, 0.04)
        points = np.column_stack([np.full(y.size, AFAR), y])
        pose = (self.wall - AFAR, 0.0, 0.0)
        return [maps.Scan("wall", points, pose, depth=THICK), *self.others]

    def distance(self, x, t):
        """How far a point is from what is strict [m]."""
        out = max(self.wall - x[0], x[0] - self.wall - THICK, abs(x[1]) - HALF)
        return min([out, *(disc.h(x, t) for disc in self.others if isinstance(disc, Disc))])


INPUTS = "list", "reader", "shapes", "map", "scan", "change_scene"


class Input:
    """Scene → what a reader returns: one list for all that is edited in place, or new lists."""

    def __init__(self, name, count=1):
        self.name, self.count = name, count
        self.latest, self.given = None, None

    def __call__(self, scene):
        if self.latest is scene:
            return self.given
        parts = {"shapes": scene.shapes, "map": scene.mapped, "scan": scene.scanned}
        listed = parts.get(self.name, scene.listed)()
        if self.name == "list" and self.given is not None:
            self.given[:] = listed
        else:
            nested = self.name == "reader" and self.count > 1
            self.given = [list(listed) for _ in range(self.count)] if nested else listed
        self.latest = scene
        return self.given


class Truth(World):
    """The point, the samples of it, and whether the wall was entered in a period.

    `lie` makes what the sensors report of an estimate; where it `raises`, the reader does.
    """

    def __init__(self, model=None, scene=None, lie=None):
        super().__init__(model, T, LIMIT)
        self.scene, self.lie, self.raises = scene or Scene(), lie, False
        self.steps, self.entered = 0, False

    def estimate(self):
        if self.raises:
            raise RuntimeError("the sensor is not plugged in")
        truth = Estimate(self.x.copy(), time=T * self.steps)
        return truth if self.lie is None else self.lie(truth)

    def advance(self, u):
        self.entered = False
        for k in range(20):
            self.x = self.model.step(self.x, u, T / 20)
            now = T * (self.steps + (k + 1) / 20)
            self.entered |= bool(self.scene.distance(self.x, now) < -1e-6)
        self.steps += 1
        return self.x


class Single:
    """`SafetyFilter` around the point."""

    def __init__(self, name, world, guidance=None, goal=None, period=T, **options):
        self.world = world
        read = Input(name)
        read(world.scene)
        given = read.given if name == "list" else lambda *_: read(world.scene)
        self.input = read
        plant = hcbf_gym.Plant(
            world.model, given, lambda *_: world.estimate(), period=period, goal=goal, max_age=0.1
        )  # fmt: skip
        self.env = wrappers.SafetyFilter(world, plant=plant, guidance=guidance, **options)

    def reset(self):
        return self.env.reset(seed=0)[1]["safety_filter"]

    def step(self, u=AHEAD):
        self.input(self.world.scene)
        return self.env.step(u)[4]["safety_filter"]


class Changed(Single):
    """The package's environment, whose scene is changed in an episode."""

    def __init__(self, name, world, guidance=None, goal=None, period=T, **options):
        self.world = world
        self.latest = world.scene
        inner = RegionsEnv(scenario=self.scenario())

        def state(env, *_):
            world.x[:] = inner.rom_state
            return world.estimate()

        plant = replace(inner.plant, state=state, max_age=0.1, goal=goal)
        self.env = wrappers.SafetyFilter(inner, plant=plant, guidance=guidance, **options)

    def scenario(self):
        return scenarios.Scenario(
            "wall", tuple(self.world.scene.listed()),
            PointReference((FAR - 1.0, 0.0)),
        )  # fmt: skip

    def reset(self):
        return self.env.reset(seed=0)[1]["safety_filter"]

    def step(self, u=AHEAD):
        world, inner = self.world, self.env.unwrapped
        if world.scene is not self.latest:
            self.latest = world.scene
            inner.change_scene(self.scenario())
        pushed = inner.rom_state if world.lie or world.raises else world.x.copy()
        inner._batch.x[0] = pushed
        world.x = inner.rom_state.copy()
        report = self.env.step(u.astype(np.float32))[4]["safety_filter"]
        world.advance(report["u_safe"])
        world.x = inner.rom_state.copy()
        return report


class Batched:
    """`VectorSafetyFilter`: the second of three points is lied to, the others are not."""

    def __init__(self, name, world, guidance=None, goal=None, period=T, **options):
        self.world = world
        read, count = Input(name, 3), 3
        calm = np.array([[-3.0, 0.0, 0.0, 0.0]] * count)

        def state(*_):
            reported = world.estimate()
            each = [Estimate(x, time=time_of(world)) for x in calm]
            each[1] = reported
            return stacked(each)

        plant = hcbf_gym.Plant(
            models.DoubleIntegrator(), lambda *_: read(world.scene), state, period=period,
            input_set=models.Box.symmetric(LIMIT), goal=goal, max_age=0.1,
        )  # fmt: skip

        class Envs(RegionsVectorEnv):
            @property
            def plant(self):
                return plant

        self.env = wrappers.VectorSafetyFilter(
            Envs(count, scenario="paper-simulation"), guidance=guidance, **options
        )

    def reset(self):
        return self.of_one(self.env.reset(seed=0)[1]["safety_filter"])

    def step(self, u=AHEAD):
        report = self.env.step(np.array([0.0 * u, u, 0.0 * u]))[4]["safety_filter"]
        if not self.world.raises:
            assert report["status"][[0, 2]].max() < FilterStatus.BACKUP or is_scene(report)
        one = self.of_one(report)
        self.world.advance(one["u_safe"])
        return one

    @staticmethod
    def of_one(report):
        return {name: value[1] for name, value in report.items() if len(value) == 3}


def is_scene(report):
    """Whether it is the barriers, which the three share, that are not accepted."""
    return report["reason"][0] == hcbf_gym.models.Reason.BARRIERS


def time_of(world):
    return T * world.steps


def stacked(each):
    """N estimates as one; what one of them does not have is zero."""
    made = {}
    for name in Estimate._fields:
        parts = [getattr(one, name) for one in each]
        if all(part is None for part in parts):
            made[name] = None
            continue
        known = next(part for part in parts if part is not None)
        blank = np.zeros(np.shape(known)) if name != "model" else None
        made[name] = np.array([blank if part is None else part for part in parts], dtype=float)
    return Estimate(**made)


class Driven:
    """`VelocityFilter` in a loop: an ideal robot that takes velocities."""

    def __init__(self, name, world, guidance=None, goal=None, period=T, **options):
        self.world = world
        self.input = Input(name)
        exact = Response(
            gain=(1.0, 1.0, 1.0), time_constant=0.02, delay=0.0, residual=(0.0, 0.0, 0.0),
            deviation=1.0, overshoot=0.0, rise=0.7, stopping=0.1, braking=LIMIT, falls=0,
            seconds=60.0,
        )  # fmt: skip
        robot = Robot(Command(forward=3.0, sideways=3.0, turn=1.0), exact)
        self.filter = VelocityFilter(
            robot, self.input(world.scene), period=T, guidance=guidance, goal=goal, **options
        )

    def reset(self):
        self.filter.reset()

    def step(self, u=AHEAD):
        world = self.world
        reported = world.estimate()
        self.filter.barriers = self.input(world.scene)
        pose = None if reported.x is None else (reported.x[0], reported.x[1], 0.0)
        twist = None if reported.x is None else (reported.x[2], reported.x[3], 0.0)
        wanted = (3.0 * np.sign(u[0]), 0.0, 0.0)
        now = None if reported.age is None else reported.time + reported.age
        command, report = self.filter.step(wanted, pose, twist, reported.time, now)
        world.advance(np.clip((command[:2] - world.x[2:]) / T, -LIMIT, LIMIT))
        return report


def quietly(call, *arguments):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return call(*arguments)
