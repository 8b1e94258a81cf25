"""In mid-episode, copies, other processes and threads continue identically."""

import copy
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import pytest

import hcbf_gym
from hcbf_gym.barriers import Disc, HalfPlane
from hcbf_gym.models import Box
from hcbf_gym.wrappers import SafetyFilter, VectorInterventionPenalty, VectorSafetyFilter
from hcbf_robots import VelocityFilter

PERIOD, STEPS = 0.02, 60
PLANTS = 128  # from which on two threads share a batch
SCENE = (
    Disc("pool", 1, center=(1.2, 0.1), radius=0.5, velocity=(-0.1, 0.0)),
    HalfPlane("lawn", 2, normal=(0.8, 0.6), offset=1.0),
)


class Env(NamedTuple):
    """An environment, stepped by one input."""

    env: gym.Env | gym.vector.VectorEnv
    u: np.ndarray

    def go(self, steps):
        out = []
        for _ in range(steps):
            observation, reward, *_, info = self.env.step(self.u)
            report = info["safety_filter"]
            out += [observation, reward, report["u_safe"], report["h"]]
        return out


class Batch:
    """Plants beside a `BatchFilter`."""

    def __init__(self):
        self.filter = hcbf_gym.BatchFilter(
            Box.symmetric(5.0), PERIOD, PLANTS, guidance="geodesic", threads=2
        )
        self.filter.set_scene(list(SCENE))
        rng = np.random.default_rng(0)
        self.x = np.concatenate([rng.uniform(-1, 0.5, (PLANTS, 2)), np.zeros((PLANTS, 2))], axis=1)
        self.filter.reset(x=self.x, goal=(3.0, 0.0))

    def go(self, steps):
        out = []
        for _ in range(steps):
            u, report = self.filter(np.full((PLANTS, 2), 2.0), self.x)
            position, velocity = self.x[:, :2], self.x[:, 2:]
            moved = position + PERIOD * velocity + 0.5 * PERIOD**2 * u
            self.x = np.concatenate([moved, velocity + PERIOD * u], axis=1)
            out += [u, report["h"], report["status"]]
        return out


class Cart:
    """A cart that does what its `VelocityFilter` commands."""

    def __init__(self):
        self.filter = VelocityFilter("cart", list(SCENE), guidance="geodesic", goal=(3.0, 0.0))
        self.pose, self.twist, self.time = np.array([-1.0, 0.0, 0.0]), np.zeros(3), 0.0

    def go(self, steps):
        out = []
        for _ in range(steps):
            command, report = self.filter.step((0.5, 0.1), self.pose, self.twist, self.time)
            out += [command, report["h"], report["status"]]
            self.time += 0.05
            self.twist = np.array([command[0], 0.0, command[1]])
            heading = np.array([np.cos(self.pose[2]), np.sin(self.pose[2]), 0.0])
            self.pose = self.pose + 0.05 * (command[0] * heading + [0.0, 0.0, command[1]])
        return out


def guided(env_id, **options):
    env = SafetyFilter(gym.make(env_id, scenario="random", **options), guidance="geodesic")
    env.reset(seed=1)
    return Env(env, np.array([1.5, 0.5], np.float32))


def local():
    env = SafetyFilter(gym.make("HCBF-Regions-v0", scenario="random-moving"), guidance="local")
    env.reset(seed=2)
    return Env(env, np.array([1.5, 0.5], np.float32))


def native():
    robots = gym.make_vec(
        "HCBF-Regions-v0", num_envs=3, scenario="random", max_episode_steps=STEPS // 2
    )  # whose next scenes are drawn within the steps of a copy
    env = VectorInterventionPenalty(VectorSafetyFilter(robots))
    env.reset(seed=3)
    return Env(env, np.full((3, 2), 1.5, np.float32))


CASES = {
    "SafetyFilter, a field": lambda: guided("HCBF-Regions-v0"),
    "SafetyFilter, along edges": local,
    "VectorSafetyFilter": native,
    "BatchFilter": Batch,
    "VelocityFilter": Cart,
    "A1": lambda: guided("HCBF-A1Regions-v0"),
}
COPIED = [name for name in CASES if name != "A1"]  # whose physics begins anew in a copy


def begun(name):
    """Return a case in mid-episode."""
    case = CASES[name]()
    case.go(3)
    return case


def went(case):
    """Go on, and return what came out."""
    return case.go(STEPS)


def woken(kept):
    """Go on from a pickle."""
    return went(pickle.loads(kept))


def arrives(name):
    """Return what comes out here, and in a process that this one forks."""
    case = begun(name)
    with ProcessPoolExecutor(1, multiprocessing.get_context("fork"), _take, (case,)) as child:
        theirs = child.submit(_went_there).result()
    return went(case), theirs


def _take(case):
    globals()["TAKEN"] = case


def _went_there():
    return went(globals()["TAKEN"])


def same(mine, theirs):
    assert len(mine) == len(theirs) > 0
    for one, other in zip(mine, theirs, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.fixture(scope="module")
def elsewhere():
    """A process that was spawned, and so has no thread of another test."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        yield pool


@pytest.mark.parametrize("name", COPIED)
def test_copies_go_on_identically(name, elsewhere):
    case = begun(name)
    kept = pickle.dumps(case)
    there = elsewhere.submit(woken, kept)
    twins = copy.deepcopy(case), pickle.loads(kept)
    mine = went(case)
    for twin in twins:
        same(mine, went(twin))
    same(mine, there.result())


@pytest.mark.parametrize("name", CASES)
def test_a_forked_process_continues_identically(name, elsewhere):
    same(*elsewhere.submit(arrives, name).result())


@pytest.mark.parametrize("name", CASES)
def test_threads_side_by_side_go_on_identically(name):
    mine = went(begun(name))
    with ThreadPoolExecutor(3) as pool:
        for theirs in pool.map(went, [begun(name) for _ in range(3)]):
            same(mine, theirs)


def test_the_a1_begins_alike_in_another_process(elsewhere):
    env = SafetyFilter(gym.make("HCBF-A1Regions-v0", scenario="random"))
    kept = pickle.dumps(env)
    theirs = elsewhere.submit(_begins, pickle.loads(kept)).result()
    same(_begins(env), theirs)


def _begins(env):
    env.reset(seed=5)
    return Env(env, np.array([1.5, 0.5], np.float32)).go(3)
