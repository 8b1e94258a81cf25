"""What the filter adds to a step for other models and solvers, and how fast batches are filtered.

Single plants: blocks of steps of the filtered and of the bare environment take turns on one core.
Batches: N double integrators with a scene each, by `BatchFilter` on one core and on two and by
`VectorSafetyFilter` with a plant's readers; and N unicycles, beside a loop of single filters. What
they answer is compared.
"""

import time
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

import hcbf_gym
from benchmarks.common import in_turn, one_core, table
from benchmarks.suites.filter import BLOCK
from hcbf_gym import models
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import Disc, HalfPlane, Shapes, SpeedLimit
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.reduced_order import ReducedOrderModel
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter

PERIOD, U = 0.02, Box.symmetric(5.0)
SHARED = (
    Disc("strict", 1, center=(1.5, 0.3), radius=0.5),
    Disc("soft", 2, center=(0.5, -0.8), radius=0.4),
    HalfPlane("wall", 3, normal=(0.0, 1.0), offset=-2.0),
)
PLANTS: dict[str, ReducedOrderModel] = {
    "double integrator": models.DoubleIntegrator(),
    "boat (drag)": models.DoubleIntegrator(drag=0.5),
    "unicycle": models.Unicycle(),
    "bicycle": models.KinematicBicycle(),
    "single integrator": models.SingleIntegrator(),
}
PLACES = {"idle": (-20.0, 0.0), "conflict": (0.85, -0.3)}
WANTED, REPETITIONS = np.array([0.5, 0.5]), 5
DRAWN_FOR = 25  # steps that u* is held


class One(gym.Env[Any, Any]):
    """A plant that is its model, and begins at a place."""

    def __init__(self, model: ReducedOrderModel, start: Array):
        self.model, self.start, self.x = model, start, start.copy()
        self.action_space = gym.spaces.Box(-5.0, 5.0, (model.n_u,), np.float64)
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (model.n,), np.float64)
        self.plant = hcbf_gym.Plant(model, SHARED, lambda env, *_: env.x, U, period=PERIOD)

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        """Stand where it begins."""
        self.x = self.start.copy()
        return self.x, {}

    def step(self, action: Any) -> Any:
        """Hold an input for one period."""
        self.x = self.model.step(self.x, action, PERIOD)
        return self.x, 0.0, False, False, {}


class Many(VectorEnv):
    """N such plants, without episodes' ends."""

    def __init__(self, model: ReducedOrderModel, start: Array, scenes: Any):
        self.num_envs, self.model, self.start, self.x = len(start), model, start, start.copy()
        self.metadata = {"autoreset_mode": AutoresetMode.DISABLED}
        self.single_action_space = gym.spaces.Box(-5.0, 5.0, (model.n_u,), np.float64)
        self.action_space = batch_space(self.single_action_space, len(start))
        self.never: Mask = np.zeros(len(start), dtype=np.bool_)
        self.plant = hcbf_gym.Plant(
            model, lambda *_: scenes, lambda env, *_: env.x, U, period=PERIOD
        )

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Array, dict[str, Any]]:
        """Stand where they begin."""
        self.x = self.start.copy()
        return self.x, {}

    def step(self, actions: Array) -> tuple[Array, Array, Mask, Mask, dict[str, Any]]:
        """Hold inputs for one period."""
        self.x = self.model.steps_of(self.x, actions, PERIOD)
        return self.x, np.zeros(len(self.x)), self.never, self.never, {}


def run(quick: bool) -> dict[str, Any]:
    """Measure single plants and batches."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with one_core():
            added = [row for name in PLANTS for row in _single(name, 2 if quick else 40)]
        steps = 25 if quick else 200
        batches = [*_integrators(512 if quick else 4096, steps), *_unicycles(256, steps)]
    return {"added": added, "batches": batches}


def _single(name: str, blocks: int) -> list[dict[str, Any]]:
    """Return what the filter adds for one model, idle and in conflict, with and without DAQP."""
    model, rows = PLANTS[name], []
    for place, position in PLACES.items():
        start = np.zeros(model.n)
        start[:2] = position
        envs: list[gym.Env[Any, Any]] = [One(model, start)]
        envs += [
            SafetyFilter(One(model, start), solver=solver, allow_late_inputs=True)
            for solver in (None, "daqp")
        ]
        calls = [(env.reset, lambda env=env: env.step(WANTED)) for env in envs]
        times = np.array([in_turn(calls, blocks, *BLOCK) for _ in range(REPETITIONS)])
        compiled, daqp = np.median(times[:, 1:] - times[:, :1], axis=0).tolist()
        rows.append({"model": name, "place": place, "added": compiled, "daqp": daqp})
    return rows


def _integrators(count: int, steps: int) -> list[dict[str, Any]]:
    """Return states/s of N double integrators with a scene each."""
    rng = np.random.default_rng(0)
    x = np.zeros((count, 4))
    x[:, :2], x[:, 2:] = rng.uniform(-5, 5, (count, 2)), rng.uniform(-1, 1, (count, 2))
    numbers = np.full((count, 4, 3), 0.5)
    numbers[..., :2] = rng.uniform(-5, 5, (count, 4, 2))
    discs = [Shapes("disc", k + 1, "disc", numbers[:, k : k + 1]) for k in range(4)]
    scenes = [*discs, SpeedLimit("limit", 1, 2.0)]
    filters = [hcbf_gym.BatchFilter(U, PERIOD, count, threads=threads) for threads in (1, 2)]
    for one in filters:
        one.set_scene(scenes)
        one.reset(x=x)
    model = models.DoubleIntegrator()
    envs = VectorSafetyFilter(Many(model, x, scenes))
    envs.reset()
    state = {"x": x}

    def of(one: Any) -> Callable[[Array], Array]:
        return lambda u: one(u, state["x"])[0]

    def stepped(u: Array) -> Array:
        answer = envs.step(u)[4]["safety_filter"]["u_safe"]
        state["x"] = envs.unwrapped.x  # pyright: ignore[reportAttributeAccessIssue]
        return answer

    names = "BatchFilter, one core", "BatchFilter, two cores", "VectorSafetyFilter, with its steps"
    calls = [of(filters[0]), of(filters[1]), stepped]
    return _rates(f"{count} double integrators", names, calls, (count, 2), steps)


def _unicycles(count: int, steps: int) -> list[dict[str, Any]]:
    """Return states/s of N unicycles in one scene."""
    model, start = models.Unicycle(), np.random.default_rng(0).uniform(-0.8, -0.2, (count, 3))
    many = VectorSafetyFilter(Many(model, start, SHARED), allow_late_inputs=True)
    ones = [SafetyFilter(One(model, x), allow_late_inputs=True) for x in start]
    many.reset()
    for one in ones:
        one.reset()

    def loop(u: Array) -> Array:
        each = [one.step(u[i])[4]["safety_filter"]["u_safe"] for i, one in enumerate(ones)]
        return np.array(each)

    calls = [loop, lambda u: many.step(u)[4]["safety_filter"]["u_safe"]]
    names = "a loop of SafetyFilter, with its steps", "VectorSafetyFilter, with its steps"
    return _rates(f"{count} unicycles", names, calls, (count, 2), steps)


def _rates(
    plants: str,
    names: tuple[str, ...],
    calls: list[Callable[[Array], Array]],
    shape: tuple[int, int],
    steps: int,
) -> list[dict[str, Any]]:
    """Return 10⁶ states/s of each call; they take turns, and how far answers are apart."""
    rng, u = np.random.default_rng(1), np.zeros(shape)
    times, apart = np.zeros((2 * steps, len(calls))), 0.0
    for k in range(2 * steps):  # the first half warms up
        if k % DRAWN_FOR == 0:
            u = rng.uniform(-5.0, 5.0, shape)
        answers = []
        for j, call in enumerate(calls):
            begin = time.perf_counter()
            answers.append(call(u))
            times[k, j] = time.perf_counter() - begin
        apart = max(apart, *(float(np.abs(one - answers[0]).max()) for one in answers))
    rates = 1e-6 * shape[0] / np.median(times[steps:], axis=0)
    return [
        {"plants": plants, "way": name, "rate": float(rate), "ratio": float(rate / rates[0])}
        | {"apart": apart}
        for name, rate in zip(names, rates, strict=True)
    ]


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the tables of single plants and of batches."""
    added = {"model": "{model}", "where": "{place}", "adds [µs]": "{added:.1f}",
             "with DAQP [µs]": "{daqp:.1f}"}  # fmt: skip
    batches = {"plants": "{plants}", "way": "{way}", "10⁶ states/s": "{rate:.3g}",
               "of the first way": "{ratio:.3g}", "answers apart": "{apart:.3g}"}  # fmt: skip
    title = "what SafetyFilter adds to a step of other models, and with a solver by name"
    return {
        "added": table(title, figures["added"], added),
        "batches": table("how fast batches are filtered, in turn", figures["batches"], batches),
    }
