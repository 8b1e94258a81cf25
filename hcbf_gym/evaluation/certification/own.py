"""Attacked episodes of a user's own environment, whatever its model is.

The attackers know the model and the strict barriers: they look a moment ahead under each corner of
U, and take the one that suits them.
"""

import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from hcbf_gym import wrappers
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, as_array
from hcbf_gym.evaluation import stakes
from hcbf_gym.evaluation.attacked import alarm_of
from hcbf_gym.evaluation.attacks import STREAM
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Estimate, Plant, Uncertainty, read
from hcbf_gym.models.reduced_order import DoubleIntegrator

CORNERS = 64
"""The most corners of U that an attacker looks at."""
AHEAD = 0.3
"""How far an attacker looks ahead [s]."""
HELD = 0.04
"""How long an attacker keeps to what it has decided [s]: looking ahead takes time."""


class Made(NamedTuple):
    """What a user's function returned.

    Attributes:
        env: the environment.
        plant: what a filter must know of it.
    """

    env: gym.Env
    plant: Plant


class Outcome(NamedTuple):
    """What one episode showed; every h at every step.

    Attributes:
        least_h: of the strict barriers, the speed limit apart [unit of h].
        least_speed_h: of a strict speed limit [m/s]; infinite where there is none.
        least_body_h: infinite: nobody tells the body's.
        first_h: least strict h at the reset.
        alarm: as `attacked.alarm_of` tells it at the end.
        steps: how many it took.
        pressed: whether the filter had to change an input that would have entered.
        fell: False; an environment that ends early has said why by itself.
    """

    least_h: float
    least_speed_h: float
    first_h: float
    alarm: int
    steps: int = 0
    pressed: bool = False
    least_body_h: float = np.inf
    fell: bool = False


@dataclass(frozen=True)
class OwnEpisode:
    """What to run.

    Args:
        source: as `make` takes it.
        attack: one of `POLICIES`, or "searched" with parameters.
        seed: of the environment and the attack.
        steps: the most that it takes.
        program: of the filter.
        parameters: of the searched attacker, as `Mixed` takes them.
        uncertainty: what rows reserve; None is the plant's own.
    """

    source: str
    attack: str
    seed: int
    steps: int
    program: str = "lex-cbf-qp"
    parameters: tuple[float, ...] | None = None
    uncertainty: Uncertainty | None = None

    def run(self) -> Outcome:
        """Run the episode to its end.

        Raises:
            InvalidInputError: if the function returns anything else, or there is no strict barrier.
        """
        env, plant = make(self.source)
        if self.uncertainty is not None:
            own = self.uncertainty._replace(body=plant.uncertainty.body)
            plant = replace(plant, uncertainty=own)
        rng = np.random.default_rng([STREAM, self.seed])
        kind: Any = POLICIES.get(self.attack, Mixed)
        policy = kind(rng) if self.parameters is None else Mixed(rng, self.parameters)
        filtered = wrappers.SafetyFilter(env, self.program, plant=plant)
        try:
            return self._rollout(filtered, policy)
        finally:
            filtered.close()

    def _rollout(self, env: Any, policy: Any) -> Outcome:
        plant, inner = env.plant, env.unwrapped
        observation, info = env.reset(seed=self.seed)
        seen = _look(plant, inner, observation, info, 0.0)
        first = seen.h[~seen.speed].min()
        least = np.where(seen.h < 0.0, seen.h, np.inf)  # a start inside counts, no other one does
        input_set = plant.input_set or env._input_set
        pressed, steps = False, 0
        went, expected = [seen.strict(seen.x[None], seen.time)[0]], []
        for k in range(self.steps):
            u = policy.wants(Situation(plant, input_set, seen))
            action = u if plant.to_action is None else plant.to_action(u)
            before = seen
            observation, _, terminated, truncated, info = env.step(action)
            report = info["safety_filter"]
            pressed = pressed or stakes.pressed(
                plant.model, input_set, before.x, before.time, before.along, report
            )
            seen = _look(plant, inner, observation, info, (k + 1) * (plant.period or 0.0))
            if len(seen.h) != len(least):
                raise InvalidInputError(
                    f"{self.source}: got {len(seen.h)} strict barriers after {len(least)}, "
                    "expected their number to stay"
                )
            least = np.minimum(least, seen.h)
            steps = k + 1
            went.append(seen.strict(seen.x[None], seen.time)[0])
            if plant.period is not None:
                there = plant.model.step(before.x, report["u_safe"], plant.period)
                expected.append(seen.strict(there[None], seen.time)[0])
            if terminated or truncated:
                break
        stakes.check_jumps(self.source, went, expected)
        speed = least[seen.speed]
        return Outcome(
            float(least[~seen.speed].min()), float(speed.min()) if speed.size else np.inf,
            float(first), alarm_of(info), steps, pressed,
        )  # fmt: skip


class Look(NamedTuple):
    """The plant at one sample.

    Attributes:
        x: (n,) its state.
        time: [s].
        strict: (x (j, n), t) → (j, m) the strict h's on the position.
        h: (k,) what they are, at their least since the last sample where that is told: the
            lesser of infos and barriers.
        speed: (k,) which of them read no position.
    """

    x: Array
    time: float
    strict: Callable[[Array, float], Array]
    h: Array
    speed: NDArray[np.bool_]

    def along(self, x: Array, t: Array) -> Array:
        """Return (j, m) the strict h's on the position at states (j, n) and times (j,)."""
        return np.array([
            self.strict(one[None], float(at))[0] for one, at in zip(x, t, strict=True)
        ])  # fmt: skip


def _look(plant: Plant, env: Any, observation: Any, info: dict[str, Any], time: float) -> Look:
    estimate = plant.state(env, observation, info)
    if not isinstance(estimate, Estimate):
        estimate = Estimate(estimate)
    x = np.asarray(estimate.x, dtype=np.float64)
    now = time if estimate.time is None else float(estimate.time)
    barriers = read(plant.barriers, env, observation, info)
    every: Callable[[Array, float], Array]
    if isinstance(plant.model, DoubleIntegrator):
        scene = barriers if isinstance(barriers, BarrierSet) else BarrierSet([barriers])
        first, position = scene.priority[0] == 1, scene.keeps_margin[0] > 0.0
        every = lambda x, t: scene.along(x, np.full(len(x), t))  # noqa: E731
    else:
        first = np.array([b.priority == 1 for b in barriers], dtype=np.bool_)
        position = first & np.array([b.reads_position for b in barriers], dtype=np.bool_)
        every = lambda x, t: np.array([[float(b.h(one, t)) for b in barriers] for one in x])  # noqa: E731
    if not position.any():
        raise InvalidInputError(
            f"certify: got {len(first)} barriers and none of priority 1 on the state, "
            "expected at least one"
        )
    told = info.get("min_h")
    h = every(x[None], now)[0]
    h = (h if told is None else np.minimum(h, _checked(told, len(first))))[first]
    h = np.where(np.isfinite(h), h, -np.inf)
    return Look(x, now, lambda x, t: every(x, t)[:, position], h, ~position[first])


def _checked(told: Any, count: int) -> Array:
    """Return (count,) an environment's own min_h; NaN counts as entered.

    Raises:
        InvalidInputError: if it is not one real number for each barrier.
    """
    given = as_array("min_h", told)
    if given.dtype.kind not in "fiu" or given.shape != (count,):
        raise InvalidInputError(
            f"certify: got min_h {told!r} in the infos, expected {count} numbers, one for each "
            "barrier in its order"
        )
    return given.astype(np.float64)


class Situation(NamedTuple):
    """What an attacker sees.

    Attributes:
        plant: as the filter knows it.
        input_set: U.
        seen: the plant at this sample.
    """

    plant: Plant
    input_set: InputSet
    seen: Look

    @property
    def corners(self) -> Array:
        """(k, n_u) corners of U, evenly taken where there are many."""
        every = self.input_set.vertices()
        return every[:: -(-len(every) // CORNERS)]

    def best(self, value: Callable[[Array], float]) -> Array:
        """Return the corner of U whose h's a moment ahead, least first, are worth most."""
        corners = self.corners
        return corners[int(np.argmax([value(h) for h in self.ahead(corners)]))]

    def ahead(self, inputs: Array) -> Array:
        """Return (k, m) the strict h's on the position, least first, `AHEAD` later.

        Args:
            inputs: (k, n_u), each of which is held.
        """
        model, seen = self.plant.model, self.seen
        x = np.array([model.step(seen.x, u, AHEAD) for u in inputs])
        return np.sort(seen.strict(x, seen.time + AHEAD), axis=1)


@dataclass
class _Held:
    """A policy that holds its choices for a while.

    Args:
        rng: decides what is random about it.
    """

    rng: np.random.Generator
    until: float = -1.0
    choice: Any = None

    def draw(self, time: float, low: float, high: float, pick: Callable[[], Any]) -> Any:
        if time >= self.until:
            self.until, self.choice = time + self.rng.uniform(low, high), pick()
        return self.choice


class Nearest(_Held):
    """Straight at what is nearest."""

    def wants(self, s: Situation) -> Array:
        """Return the corner of U under which the least h gets least."""
        return self.draw(s.seen.time, HELD, HELD, lambda: s.best(lambda h: -h[0]))


class Corner(_Held):
    """Between the two that are nearest."""

    def wants(self, s: Situation) -> Array:
        """Return the corner of U under which the two least h's together get least."""
        return self.draw(s.seen.time, HELD, HELD, lambda: s.best(lambda h: -h[:2].sum()))


class Slam(_Held):
    """Backs off, and slams into what is nearest."""

    away, turns = True, -1.0

    def wants(self, s: Situation) -> Array:
        """Return the best or the worst corner, each side for a random time."""
        if s.seen.time >= self.turns:
            self.away, self.turns = not self.away, s.seen.time + self.rng.uniform(0.3, 1.2)
        sign = 1.0 if self.away else -1.0
        return self.draw(s.seen.time, HELD, HELD, lambda: s.best(lambda h: sign * h[0]))


class BangBang(_Held):
    """Corners of U, each held .1 to .5 s."""

    def wants(self, s: Situation) -> Array:
        """Return the corner chosen last."""
        return self.draw(s.seen.time, 0.1, 0.5, lambda: self.rng.choice(s.corners))


class Wandering(_Held):
    """A friendly one: inputs anywhere in U, each held .2 to 1 s."""

    def wants(self, s: Situation) -> Array:
        """Return a random mixture of the corners."""

        def pick() -> Array:
            return self.rng.dirichlet(np.ones(len(s.corners))) @ s.corners

        return self.draw(s.seen.time, 0.2, 1.0, pick)


class Mixed(_Held):
    """An attacker with six numbers in [0, 1] that a search sets.

    Args:
        rng: decides what is random about it.
        parameters: (6,) share of the second barrier, share of chance, how long a choice is held,
            jitter of it, share of time backed off, and one that is not read: searches have six.
    """

    def __init__(self, rng: np.random.Generator, parameters: tuple[float, ...]):
        super().__init__(rng)
        self.parameters = parameters

    def wants(self, s: Situation) -> Array:
        """Return a corner of U."""
        second, chance, hold, jitter, back, _ = self.parameters
        length = HELD + hold
        low, high = length * (1.0 - 0.9 * jitter), length * (1.0 + 0.9 * jitter)

        def pick() -> Array:
            if self.rng.random() < 0.5 * chance:
                return self.rng.choice(s.corners)
            sign = 1.0 if self.rng.random() < 0.6 * back else -1.0
            return s.best(lambda h: sign * (h[0] + second * h[min(1, len(h) - 1)]))

        return self.draw(s.seen.time, low, high, pick)


POLICIES: dict[str, type] = {
    "nearest": Nearest,
    "corner": Corner,
    "slam": Slam,
    "bang-bang": BangBang,
    "wandering": Wandering,
}
"""name → policy that knows model and barriers alone."""


def make(source: str) -> Made:
    """Return a new environment and its plant.

    Args:
        source: ``module:function`` or ``file.py:function``.

    Raises:
        InvalidInputError: if there is no such function, or it returns anything else.
    """
    made = _function(source)()
    if not (isinstance(made, tuple) and len(made) == 2 and isinstance(made[1], Plant)):
        raise InvalidInputError(
            f"{source}: got {made!r}, expected a function that returns (environment, plant)"
        )
    return Made(*made)


def files(source: str) -> list[Path]:
    """Return the file in which a user's function is written."""
    file = inspect.getsourcefile(_function(source))
    return [] if file is None else [Path(file)]


@cache
def _function(source: str) -> Callable[[], Any]:
    where, _, name = source.rpartition(":")
    try:
        module = _from_file(where) if where.endswith(".py") else importlib.import_module(where)
        found = getattr(module, name)
    except (ImportError, AttributeError, ValueError, OSError) as error:
        raise InvalidInputError(
            f"plant: got {source!r} ({error}), expected module:function or file.py:function"
        ) from error
    if not callable(found):
        raise InvalidInputError(f"plant: got {source!r}, expected a function")
    return found


def _from_file(where: str) -> Any:
    """Return the module that a file holds, under a name of its own."""
    name = f"hcbf_certified_{Path(where).stem}"
    spec = importlib.util.spec_from_file_location(name, where)
    if spec is None or spec.loader is None or not Path(where).is_file():
        raise ImportError(f"no file {where}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
