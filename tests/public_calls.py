"""Calls of the public functions: a good one of each, and the values that replace its arguments."""

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import scipy.sparse
from gymnasium import spaces

import hcbf_gym
import hcbf_robots
from hcbf_gym import (
    barriers,
    certificates,
    estimation,
    guidance,
    models,
    policies,
    programs,
    scenarios,
    wrappers,
)
from hcbf_gym.models import input_sets
from hcbf_gym.scenarios.references import PointReference
from hcbf_robots import Walker, maps
from tests.worlds import World

try:
    import torch
except ImportError:  # the extra rl
    torch = None

ROOMS = (
    hcbf_gym, barriers, certificates, estimation, guidance, maps, models, policies, programs,
    scenarios, wrappers,
)  # fmt: skip
"""Whose `__all__` is public."""


INTERNAL = ("kinks",)  # what a filter passes to general rows


class Call(NamedTuple):
    """A good call.

    Attributes:
        of: what is called, by keywords alone.
        given: its arguments without a default, and others that it needs.
    """

    of: Callable[..., Any]
    given: Mapping[str, Any]

    def places(self) -> list[str]:
        """Return the names of its arguments: the given ones, and those with a default."""
        if self.of.__name__ == "<lambda>":
            return list(self.given)
        found = inspect.signature(self.of).parameters.values()
        defaults = [one.name for one in found if one.default is not inspect.Parameter.empty]
        return list(
            dict.fromkeys([*self.given, *(name for name in defaults if name not in INTERNAL)])
        )


def given(**arguments: Any) -> dict[str, Any]:
    """Return arguments by their names."""
    return arguments


def hostile() -> dict[str, Any]:
    """Return what may stand in the place of any argument, by name."""
    deep: list[Any] = []
    for _ in range(5000):
        deep = [deep]
    itself: list[Any] = []
    itself.append(itself)
    values: dict[str, Any] = {
        "None": None, "True": True, "text": "nothing", "empty text": "", "bytes": b"10",
        "complex": 1.0 + 1.0j, "object": object(), "class": int, "function": lambda *_: 1.0,
        "empty list": [], "list of None": [None], "list of texts": ["1", "2"], "dict": {"a": 1.0},
        "set": {1.0}, "nan": np.nan, "infinite": -np.inf, "below": -1, "zero": 0, "half": 0.5,
        "huge": 10**400, "ragged": [[1.0], [1.0, 2.0]], "deep": deep, "itself": itself,
        "range": range(3), "generator": (x for x in (1.0, 2.0)), "path": Path("nowhere.json"),
        "error": ValueError("no"),
    }  # fmt: skip
    for kind in ("float16", "longdouble", "int64", "uint8", "bool", "complex128", "U3", "object"):
        for shape in ((2,), (3, 2), ()):
            values[f"{kind} {shape}"] = np.ones(shape).astype(kind)
    values["objects that are none"] = np.array([object(), None], dtype=object)
    values |= {
        "wrong shape": np.ones((2, 1, 3, 1)), "no entries": np.zeros((0, 2)),
        "nan array": np.full(2, np.nan), "structured": np.zeros(2, dtype=[("x", float)]),
        "dates": np.array(["2026-01-01"], dtype="M8[D]"), "sparse": scipy.sparse.eye(2).tocsr(),
        "masked": np.ma.masked_array(np.ones(2), [True, False]),
    }  # fmt: skip
    if torch is not None:
        ones = torch.ones(3, 2)
        values |= {
            f"torch {kind}": ones.to(getattr(torch, kind))
            for kind in ("float16", "bfloat16", "int64", "bool", "complex64")
        } | {
            "torch sparse": ones.to_sparse(), "torch meta": ones.to("meta"),
            "torch gradient": torch.ones(3, 2, requires_grad=True),
        }  # fmt: skip
    return values


def loose(space: spaces.Space | None = None) -> World:
    """Return a double integrator of a user's own."""
    env = World(period=0.02)
    env.action_space = env.action_space if space is None else space
    return env


def state(env, observation, info):
    return env.x.copy()


def drift(x):
    return np.zeros(2)


def inputs(x):
    return np.eye(2)


BOX = models.Box.symmetric(5.0)
DISC = barriers.Disc("disc", 1, (2.0, 0.0), 0.5)
PLANT = hcbf_gym.Plant(models.DoubleIntegrator(), [DISC], state, period=0.02)
ROWS = barriers.CbfRows(
    np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, 0.5]), np.zeros(2), np.array([1, 2])
)
CELLS = np.zeros((6, 8), dtype=np.bool_)
CELLS[2, 3] = True
GRID = maps.Grid(0.1, (0.0, 0.0, 0.0), (6, 8))
MAP = maps.RankedMap(GRID, (maps.MapClass("walls", 1, "keepout", CELLS),))
CART = hcbf_robots.Command(1.0, 2.0, look_ahead=0.2)
ROBOT = hcbf_robots.Robot(CART, reach=0.2)
X = np.zeros(4)


def scene() -> scenarios.Scenario:
    return scenarios.Scenario("scene", (DISC,), PointReference((4.0, 0.0)))


def batch(**options) -> hcbf_gym.BatchFilter:
    filt = hcbf_gym.BatchFilter(BOX, 0.02, 3, **options)
    filt.set_scene([DISC])
    filt.reset(x=np.zeros((3, 4)))
    return filt


def filtered(**options) -> gym.Env:
    env = wrappers.SafetyFilter(loose(), plant=PLANT, **options)
    env.reset(seed=0)
    return env


def native(**options) -> gym.vector.VectorEnv:
    return gym.make_vec("HCBF-Regions-v0", num_envs=2, scenario="random", **options)


def regions(**options) -> gym.Env:
    return gym.make("HCBF-Regions-v0", scenario="random", disable_env_checker=True, **options)


def velocity() -> hcbf_robots.VelocityFilter:
    return hcbf_robots.VelocityFilter(ROBOT, [DISC])


def assign(thing, name):
    """Return what assigns an attribute, as a call."""
    return lambda value: setattr(thing, name, value)


def stepped(env):
    """Return what steps an environment anew, as a call."""

    def step(action):
        env.reset(seed=0)
        return env.step(action)[4]["safety_filter"]["u_safe"]

    return step


def of_space(space):
    return wrappers.SafetyFilter(loose(space), plant=PLANT)


def calls() -> dict[str, Call]:
    """Return name → a good call of every public function."""
    u, x = np.ones((3, 2)), np.zeros((3, 4))
    one, cart, filt, net = BOX, velocity(), batch(), policies.load("ppo", regions())
    guide = {"kind": "geodesic", "through": 2}
    found: dict[str, Call] = {
        "BatchFilter": Call(hcbf_gym.BatchFilter, given(
            input_set=BOX, period=0.02, rows="held", alpha1=1.0, alpha2=2.0, lambda_u=1.0,
            weights=[None, 1.0], delta_gamma=0.0,
        )),
        "BatchFilter guided": Call(hcbf_gym.BatchFilter, given(
            input_set=BOX, period=0.02, num_envs=3, guidance=guide, program="h-cbf-qp",
            gamma0=[1.0], delta_gamma=1.0,
        )),
        "BatchFilter.set_scene": Call(filt.set_scene, given(barriers=[DISC])),
        "BatchFilter.reset": Call(batch().reset, given(
            mask=np.ones(3, bool), x=x, goal=(1.0, 0.0),
        )),
        "BatchFilter()": Call(batch().__call__, given(u_nominal=u, x=x)),
        "BatchFilter.conditions": Call(batch().conditions, given(i=0)),
        "Plant": Call(hcbf_gym.Plant, given(
            model=models.DoubleIntegrator(), barriers=[DISC], state=state,
        )),
        "SafetyFilter": Call(wrappers.SafetyFilter, given(
            env=loose(), program="lex-cbf-qp", plant=PLANT, rows="held", guidance=None, margin=0.0,
            solver=None, on_alarm="warn", allow_late_inputs=False, certificate=None, alpha1=1.0,
            alpha2=2.0, lambda_u=1.0, weights=[None, 1.0], delta_gamma=0.0,
        )),
        "SafetyFilter.step": Call(stepped(filtered()), given(action=np.ones(2))),
        "SafetyFilter.step, by a solver": Call(stepped(filtered(solver="daqp")), given(
            action=np.ones(2),
        )),
        "SafetyFilter of a space": Call(of_space, given(space=spaces.Box(-5.0, 5.0, (2,)))),
        "VectorSafetyFilter": Call(wrappers.VectorSafetyFilter, given(env=native())),
        "VectorSafetyFilter.step": Call(stepped(wrappers.VectorSafetyFilter(native())), given(
            action=np.ones((2, 2)),
        )),
        "reset of Regions": Call(regions().reset, given(seed=0, options={"start": (0.0, 0.0)})),
        "make Regions": Call(
            lambda **o: gym.make("HCBF-Regions-v0", disable_env_checker=True, **o),
            given(scenario="random"),
        ),
        "HoldAction": Call(wrappers.HoldAction, given(env=loose(), steps=2)),
        "VectorHoldAction": Call(wrappers.VectorHoldAction, given(
            env=native(autoreset_mode="Disabled"), steps=2,
        )),
        "InterventionPenalty": Call(wrappers.InterventionPenalty, given(env=filtered())),
        "VectorInterventionPenalty": Call(wrappers.VectorInterventionPenalty, given(
            env=wrappers.VectorSafetyFilter(native()),
        )),
        "RankedObservation": Call(wrappers.RankedObservation, given(env=regions())),
        "VectorRankedObservation": Call(wrappers.VectorRankedObservation, given(env=native())),
        "FilterLog": Call(wrappers.FilterLog, given(conditions=filtered().conditions)),
        "Command": Call(hcbf_robots.Command, given(
            forward=1.0, turn=2.0, sideways=None, look_ahead=0.2, heading="velocity",
        )),
        "Response": Call(hcbf_robots.Response, given(
            gain=(1.0, 1.0), time_constant=0.3, delay=0.1, residual=(0.1, 0.2, 0.3), deviation=0.05,
            overshoot=0.2, rise=0.7, stopping=0.5, braking=1.5, falls=0, seconds=1.0, lasting=None,
        )),
        "Response.load": Call(hcbf_robots.Response.load, given(path=Path("nowhere.json"))),
        "Robot": Call(hcbf_robots.Robot, given(command=CART)),
        "VelocityFilter": Call(hcbf_robots.VelocityFilter, given(
            robot=ROBOT, barriers=[DISC], alpha2=2.0,
        )),
        "VelocityFilter.step": Call(velocity().step, given(
            command=(0.5, 0.0), pose=(0.0, 0.0, 0.0), twist=(0.0, 0.0, 0.0), time=1.0,
        )),
        "VelocityFilter.set_barriers": Call(velocity().set_barriers, given(barriers=[DISC])),
        "VelocityFilter.check": Call(cart.check, given(barriers=[DISC])),
        "VelocityFilter.command_at": Call(cart.command_at, given(now=0.0)),
        "VelocityFilter.goal": Call(assign(cart, "goal"), given(value=(1.0, 0.0))),
        "VelocityFilter.v_max": Call(assign(cart, "v_max"), given(value=0.9)),
        "VelocityFilter.program": Call(assign(cart, "program"), given(value="lex-cbf-qp")),
        "VelocityFilter.barriers": Call(assign(cart, "barriers"), given(value=[DISC])),
        "VelocityFilter.go_on_from": Call(velocity().go_on_from, given(other=velocity())),
        "Estimate": Call(lambda x: batch().reset(x=models.Estimate(x)), given(x=np.zeros((3, 4)))),
        "Uncertainty": Call(
            lambda distance: hcbf_gym.Plant(
                **PLANT_OF | {"uncertainty": models.Uncertainty(distance)}
            ),
            given(distance=0.0),
        ),
        "Axle": Call(
            lambda **given: hcbf_gym.Plant(**PLANT_OF | {"axle": models.Axle(**given)}),
            given(look_ahead=0.2, forward=1.0, turn=2.0, braking=1.0),
        ),
        "Ball": Call(models.Ball, given(radius=1.0)),
        "Box": Call(models.Box, given(low=(-1.0, -1.0), high=(1.0, 1.0))),
        "Box.symmetric": Call(models.Box.symmetric, given(limit=1.0)),
        "Box.contains": Call(one.contains, given(u=(1.0, 1.0))),
        "Box.project": Call(one.project, given(u=(9.0, 1.0))),
        "Box.support": Call(one.support, given(a=np.ones(2))),
        "Box.scaled": Call(one.scaled, given(factor=0.5)),
        "Ball.contains": Call(models.Ball(1.0).contains, given(u=(1.0, 1.0))),
        "Ball.project": Call(models.Ball(1.0).project, given(u=(9.0, 1.0))),
        "Ball.support": Call(models.Ball(1.0).support, given(a=np.ones(2))),
        "input_sets.from_dict": Call(input_sets.from_dict, given(fields=BOX.to_dict())),
        "ControlAffine": Call(models.ControlAffine, given(f=drift, g=inputs, n=2, n_u=2)),
        "DoubleIntegrator": Call(models.DoubleIntegrator, given(n_u=2, drag=0.1)),
        "SingleIntegrator": Call(models.SingleIntegrator, given(n_u=2)),
        "Unicycle": Call(models.Unicycle, {}),
        "KinematicBicycle": Call(models.KinematicBicycle, given(rear=1.5)),
        **{
            cls.__name__: Call(cls, given(name="a", priority=1))
            for cls in (*barriers.shapes.SHAPES, barriers.SpeedLimit)
        },
        "Function": Call(barriers.Function, given(
            name="a", priority=1, function=lambda x, t, p: x[0] - p[0],
        )),
        "Shapes": Call(barriers.Shapes, given(
            name="a", priority=1, shape="disc", values=[[0.0, 0.0, 1.0]],
        )),
        "Shapes polygons": Call(barriers.Shapes, given(
            name="a", priority=1, shape="convex-polygon", values=[[[0.0, 0.0], [1.0, 0.0], [0.0,
            1.0]]],
        )),
        "BarrierSet": Call(barriers.BarrierSet, given(scenes=[[DISC], [DISC]])),
        "BarrierSet.set_scene": Call(barriers.BarrierSet([[DISC]]).set_scene, given(
            i=0, scene=[DISC],
        )),
        "RowSettings": Call(barriers.RowSettings, given(
            alpha1=barriers.LogClassK(), alpha2=barriers.LinearClassK(2.0), period=0.02, u_max=5.0,
            limits=((-5.0, -5.0), (5.0, 5.0)), alpha_speed=barriers.LinearClassK(2.0),
        )),
        "GeneralRows": Call(barriers.GeneralRows, given(
            model=models.Unicycle(), alpha1=barriers.LogClassK(), alpha2=barriers.LinearClassK(2.0),
            alpha_speed=barriers.LinearClassK(2.0),
        )),
        "GeneralRows()": Call(
            barriers.GeneralRows(
                models.DoubleIntegrator(), barriers.LogClassK(), barriers.LinearClassK(2.0)
            ).__call__,
            given(barriers=[DISC], x=X, t=0.0, margin=0.0, margin_rate=0.0),
        ),
        "LinearClassK": Call(barriers.LinearClassK, given(gain=1.0)),
        "BrakeClassK": Call(barriers.BrakeClassK, given(deceleration=4.5, offset=0.1)),
        "LogClassK": Call(barriers.LogClassK, given(phi1=1.0, phi2=1.0, phi3=1.0)),
        "barriers.from_dict": Call(barriers.from_dict, given(data=barriers.to_dict(DISC))),
        "barriers.to_dict": Call(barriers.to_dict, given(barrier=DISC)),
        "barriers.register": Call(barriers.register, given(kind="disc", barrier=barriers.Disc)),
        "programs.make": Call(programs.make, given(
            program="lex-cbf-qp", lambda_u=1.0, weights=[None, 1.0], delta_gamma=0.0,
        )),
        "programs.make r": Call(programs.make, given(
            program="r-cbf-qp", gamma0=5.0, delta_gamma=1.3, lambda_u=1.0, epsilon="zero",
        )),
        "programs.make_batch": Call(programs.make_batch, given(program="h-cbf-qp")),
        "program()": Call(programs.make("lex-cbf-qp").__call__, given(
            u_nominal=np.ones(2), rows=ROWS,
        )),
        "program(), by a solver": Call(programs.make("h-cbf-qp", solver="daqp").__call__, given(
            u_nominal=np.ones(2), rows=ROWS,
        )),
        "program() of many": Call(programs.make_batch("lex-cbf-qp").__call__, given(
            u_nominal=np.ones((1, 2)), rows=programs.CbfRows(*(part[None] for part in ROWS[:4])),
        )),
        **{
            f"program() {part}": Call(
                lambda value, part=part: programs.make("lex-cbf-qp")(
                    np.ones(2), ROWS._replace(**{part: value})
                ),
                given(value=getattr(ROWS, part)),
            )
            for part in ROWS._fields
        },
        "programs.names": Call(programs.names, {}),
        "programs.options": Call(programs.options, given(program="lex-cbf-qp")),
        "programs.plain": Call(programs.plain, given(program="lex-cbf-qp")),
        "programs.plan_of": Call(programs.plan_of, given(program="lex-cbf-qp")),
        "programs.register": Call(programs.register, given(
            name="cbf-qp", plan=programs.plan_of("cbf-qp"),
        )),
        "Plan": Call(programs.Plan, given(strict="all")),
        "conflict_report": Call(programs.conflict_report, given(
            rows=ROWS, result=programs.make("lex-cbf-qp")(np.zeros(2), ROWS), input_set=BOX,
        )),
        "equivalent_offset": Call(programs.equivalent_offset, given(
            alpha2=barriers.LinearClassK(2.0), psi=0.1, delta=0.2,
        )),
        "Grid": Call(maps.Grid, given(resolution=0.1, origin=(0.0, 0.0, 0.0), shape=(6, 8))),
        "Grid.to_cells": Call(GRID.to_cells, given(points=[[0.0, 0.0]])),
        "Grid.to_world": Call(GRID.to_world, given(cells=[[0.0, 0.0]])),
        "MapClass": Call(maps.MapClass, given(name="walls", rank=1, kind="keepout", cells=CELLS)),
        "RankedMap": Call(maps.RankedMap, given(grid=GRID, classes=MAP.classes)),
        "RankedMap.load": Call(maps.RankedMap.load, given(file="nowhere.yaml")),
        "RankedMap.from_dict": Call(maps.RankedMap.from_dict, given(data=MAP.to_dict())),
        "RankedMap.distance": Call(MAP.distance, given(points=[[0.0, 0.0]])),
        "RankedMap.update": Call(MAP.update, given(corner=(0, 0), cells={"walls": CELLS[:2, :2]})),
        "RankedMap.polygons": Call(MAP.polygons, given(name="walls")),
        "paying": Call(lambda **given: list(maps.paying(**given)), given(
            ranked=MAP, x=X, slack=[0.1],
        )),
        "Scan": Call(maps.Scan, given(
            name="scan", points=[[1.0, 0.0], [1.0, 0.1]], pose=(0.0, 0.0, 0.0),
        )),
        "points_of": Call(maps.points_of, given(ranges=[1.0, 2.0], angles=[0.0, 0.1])),
        "Scenario": Call(scenarios.Scenario, given(
            name="scene", barriers=(DISC,), reference=PointReference((4.0, 0.0)),
        )),
        "BoxObstacle": Call(scenarios.BoxObstacle, given(
            name="box", center=(0.0, 0.0), size=(1.0, 1.0, 1.0),
        )),
        "scenarios.make": Call(scenarios.make, given(scenario="random")),
        "scenarios.from_dict": Call(scenarios.from_dict, given(data=scene().to_dict())),
        "scenarios.load": Call(scenarios.load, given(path="nowhere.json")),
        "scenarios.register": Call(scenarios.register, given(
            name="called", draw=lambda generator, scene: None, shapes=1,
        )),
        "scenarios.families": Call(scenarios.families, {}),
        "scenarios.family_of": Call(scenarios.family_of, given(scenario="random")),
        "scenarios.is_random": Call(scenarios.is_random, given(scenario="random")),
        "scenarios.names": Call(scenarios.names, {}),
        "scenarios.on_map": Call(scenarios.on_map, given(
            file=None, masks={}, slow={}, otherwise="random",
        )),
        "policies.load": Call(policies.load, given(name="ppo", env=regions())),
        "policies.make": Call(policies.make, given(name="pd", env=regions())),
        "policies.register": Call(policies.register, given(
            name="pd.again", make=policies.PDTracker.for_env,
        )),
        "policies.names": Call(policies.names, {}),
        "policies.check": Call(policies.check, given(name="pd")),
        "policies.files": Call(policies.files, given(name="pd")),
        "policies.is_own": Call(policies.is_own, given(name="pd")),
        "policies.try_out": Call(policies.try_out, given(name="pd", env=regions())),
        "PDTracker": Call(policies.PDTracker, given(low=np.full(2, -5.0), high=np.full(2, 5.0))),
        "PDTracker()": Call(
            policies.PDTracker(np.full(2, -5.0), np.full(2, 5.0)).__call__,
            given(observation=np.zeros(8), info={}),
        ),
        "LearnedPolicy()": Call(net.__call__, given(observation=np.zeros(net.mean.shape), info={})),
        "Geodesic": Call(guidance.Geodesic, given(count=1, through=0, cell=0.1)),
        "Geodesic.reset": Call(lambda **o: guidance.Geodesic().reset(**o), given(
            barriers=[DISC], goal=(4.0, 0.0), extent=None, clearance=0.0, start=(0.0, 0.0),
        )),
        "Local": Call(guidance.Local, given(count=1)),
        "Walker.load": Call(Walker.load, given(path="cart")),
        "input_sets.read": Call(input_sets.read, given(
            name="U", value=spaces.Box(-5.0, 5.0, (2,)),
        )),
        "conflict_report of a space": Call(programs.conflict_report, given(
            rows=ROWS, result=programs.make("lex-cbf-qp")(np.zeros(2), ROWS),
            input_set=spaces.Box(-5.0, 5.0, (2,)),
        )),
        "Sensors": Call(estimation.Sensors, given(rate=20.0, noise=0.02)),
        "certificates.load": Call(certificates.load, given(source="regions")),
    }  # fmt: skip
    return found


PLANT_OF: dict[str, Any] = given(
    model=models.DoubleIntegrator(), barriers=[DISC], state=state, period=0.02
)
