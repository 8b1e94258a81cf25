"""Trackers: regions that are returned anew at every step, with velocities and without.

``python -m benchmarks.trackers`` prints the parts: episodes with moving regions, how soon a motion
is reported that no velocity declares, reports of regions at rest, and what lists cost that are made
anew at every step. ``--part cost --beside CHECKOUT`` takes the costs in another checkout, too, in
turn. Entries are judged by the true places.
"""

import os
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro

from hcbf_gym import BatchFilter
from hcbf_gym.barriers import Disc, Shapes
from hcbf_gym.models import Estimate, Plant
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.models.reduced_order import DoubleIntegrator

MOVES = 13
"""`Reason.MOVES`; by its number, so that the costs are taken in older checkouts, too."""
CALM = 3
"""VIOLATED, below which a status is calm."""
NOISE = 0.02
"""By how much a position is wrong at most [m]; of normal errors, three deviations."""
PERIODS = 0.02, 0.05
U = Box.symmetric(5.0)
FASTEST = 1.5
"""To which speed the robots' nominal inputs lead [m/s]."""


class Errors(NamedTuple):
    """How positions are wrong: (rng, shape) → (…, 2) [m]."""

    name: str
    draw: Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]


def _uniform(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    turn, far = rng.uniform(0.0, 2.0 * np.pi, shape), np.sqrt(rng.uniform(0.0, 1.0, shape))
    return NOISE * far[..., None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)


def _normal(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return NOISE / 3.0 * rng.standard_normal((*shape, 2))


ERRORS = Errors("uniform", _uniform), Errors("normal", _normal)


class World:
    """N robots, each among m discs, and a tracker of these.

    Args:
        count: N.
        discs: m.
        period: T [s].
        seed: of all that is random.
        named: whether the tracker returns lists of objects instead of arrays.

    Attributes:
        x: (N, 4) states of the robots.
        place: (N, m, 2) true centres [m].
        velocity: (N, m, 2) their velocities [m/s].
        radius: (N, m) [m].
    """

    def __init__(self, count: int, discs: int, period: float, seed: int, named: bool = False):
        self.rng, self.period, self.named = np.random.default_rng(seed), period, named
        rng, shape = self.rng, (count, discs)
        self.x = np.zeros((count, 4))
        turn, far = rng.uniform(0.0, 2.0 * np.pi, shape), rng.uniform(1.5, 4.0, shape)
        self.place = far[..., None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        self.velocity = np.zeros((*shape, 2))
        self.radius = rng.uniform(0.2, 0.6, shape)
        self.door = BatchFilter(U, period, count, uncertainty=Uncertainty(distance=NOISE))

    def track(self, errors: Errors, declares: bool) -> None:
        """Let the filter have what the tracker sees now."""
        seen = self.place + errors.draw(self.rng, self.place.shape[:2])
        velocity = self.velocity if declares else np.zeros_like(self.velocity)
        if not self.named:
            numbers = np.concatenate([seen, self.radius[..., None]], axis=2)
            self.door.set_scene([Shapes("people", 1, "disc", numbers, velocity)])
            return
        rows = zip(seen.tolist(), self.radius.tolist(), velocity.tolist(), strict=True)
        self.door.set_scene([
            [
                Disc(f"person {k}", 1, (c[0], c[1]), r, (v[0], v[1]))
                for k, (c, r, v) in enumerate(zip(*row, strict=True))
            ]
            for row in rows
        ])  # fmt: skip

    def heights(self) -> np.ndarray:
        """Return (N, m) the true h [m]."""
        return np.linalg.norm(self.x[:, None, :2] - self.place, axis=2) - self.radius

    def go_on(self, u: np.ndarray) -> None:
        """Let one period pass."""
        t = self.period
        self.x[:, :2] += t * self.x[:, 2:] + 0.5 * t * t * u
        self.x[:, 2:] += t * u
        self.place += t * self.velocity

    def towards(self, goal: np.ndarray) -> np.ndarray:
        """Return (N, 2) the input that leads the robots to goals (N, 2)."""
        wanted = goal - self.x[:, :2]
        far = np.linalg.norm(wanted, axis=1, keepdims=True)
        wanted *= np.minimum(1.0, FASTEST / np.maximum(far, 1e-9))
        return np.clip(4.0 * (wanted - self.x[:, 2:]), -5.0, 5.0)


@dataclass
class Entered:
    """What episodes showed.

    Attributes:
        episodes: of them.
        entered: with an entry.
        calm: of these, under a calm status.
        unreported: of these, without MOVES before.
        reported: with MOVES at any step.
        violated: share of steps with a status above RELAXED.
    """

    episodes: int = 0
    entered: int = 0
    calm: int = 0
    unreported: int = 0
    reported: int = 0
    violated: float = 0.0

    def says(self) -> str:
        """Return one line."""
        return (
            f"{self.episodes} episodes, {self.entered} entered, {self.calm} under a calm status, "
            f"{self.unreported} without MOVES before; MOVES in {self.reported}, "
            f"{100.0 * self.violated:.1f} % of steps above RELAXED"
        )


def drive(world: World, errors: Errors, declares: bool, seconds: float, turns: bool) -> Entered:
    """Drive robots at regions that drive at them.

    Args:
        world: as it begins.
        errors: of the positions.
        declares: whether the tracker returns velocities.
        seconds: that episodes last.
        turns: whether regions turn towards the robot at every step.
    """
    count, discs = world.radius.shape
    rng = world.rng
    speed = rng.uniform(0.1, 0.8, (count, discs, 1))
    aim = world.x[:, None, :2] + rng.normal(0.0, 0.3, world.place.shape) - world.place
    world.velocity = speed * aim / np.linalg.norm(aim, axis=2, keepdims=True)
    goal = rng.uniform(-4.0, 4.0, (count, 2))
    hunts = rng.random(count) < 0.5
    world.track(errors, declares)
    report = world.door.reset(x=world.x)
    moved = report["reason"] == MOVES
    first, inside, calm = np.zeros((3, count), dtype=bool)
    found = Entered(count)
    steps = round(seconds / world.period)
    for _ in range(steps):
        if turns:
            to = world.x[:, None, :2] - world.place
            far = np.maximum(np.linalg.norm(to, axis=2, keepdims=True), 1e-9)
            world.velocity = speed * to / far
        nearest = world.heights().argmin(axis=1)
        prey = world.place[np.arange(count), nearest]
        world.track(errors, declares)
        u, report = world.door(world.towards(np.where(hunts[:, None], prey, goal)), world.x)
        moved |= report["reason"] == MOVES
        now = (report["status"] < CALM) & (report["reason"] == 0)
        found.calm += int((inside & now & ~calm).sum())  # of the sample at which it is inside
        found.violated += float((report["status"] >= CALM).mean()) / steps
        world.go_on(u)
        inside = (world.heights() < 0.0).any(axis=1) & ~first
        first |= inside
        found.entered += int(inside.sum())
        found.calm += int((inside & now).sum())
        found.unreported += int((inside & ~moved).sum())
        calm = now
    found.reported = int(moved.sum())
    return found


def delays(count: int, period: float, errors: Errors, named: bool, seed: int) -> np.ndarray:
    """Return (count,) after which time a motion that begins is reported [s]; infinite for never.

    The regions come nearer at 0.3 to 1 m/s, in the direction of the robot.
    """
    world = World(count, 1, period, seed, named)
    world.track(errors, False)
    world.door.reset(x=world.x)
    goal = world.rng.uniform(-0.5, 0.5, (count, 2))
    found = np.full(count, np.inf)
    speed = world.rng.uniform(0.3, 1.0, (count, 1))
    world.place *= 2.0
    world.track(errors, False)
    world.door.reset(x=world.x)
    still = round(1.0 / period)
    for step in range(still + round(1.0 / period)):
        if step >= still:
            to = world.x[:, :2] - world.place[:, 0]
            world.velocity[:, 0] = speed * to / np.linalg.norm(to, axis=1, keepdims=True)
        world.track(errors, False)
        u, report = world.door(world.towards(goal), world.x)
        late = (report["reason"] == MOVES) & np.isinf(found)
        found[late] = (step - still) * period
        world.go_on(u)
    return found


def rest(count: int, period: float, errors: Errors, named: bool, seconds: float, seed: int) -> int:
    """Return how many steps of robots that wander among regions at rest had the reason MOVES."""
    world = World(count, 4, period, seed, named)
    world.track(errors, False)
    world.door.reset(x=world.x)
    goal, reports = np.zeros((count, 2)), 0
    for step in range(round(seconds / period)):
        if step % round(2.0 / period) == 0:
            goal = world.rng.uniform(-4.0, 4.0, (count, 2))
        world.track(errors, False)
        u, report = world.door(world.towards(goal), world.x)
        reports += int((report["reason"] == MOVES).sum())
        world.go_on(u)
    return reports


def cost(count: int, how: str, steps: int = 20) -> float:
    """Return the CPU time of a step with discs that were made anew, their making included [ms].

    Args:
        count: of moving discs.
        how: "list", "shapes" or "drag".
        steps: of which the median counts.
    """
    rng, period = np.random.default_rng(0), 0.02
    place, velocity = rng.uniform(-20.0, 20.0, (count, 2)), rng.uniform(-0.5, 0.5, (count, 2))
    place[np.linalg.norm(place, axis=1) < 3.0] += 5.0
    radius = np.full(count, 0.3)
    x, still = np.zeros(4), np.zeros(2)
    door = BatchFilter(U, period)
    names = [f"person {k}" for k in range(count)]

    def listed(step: int) -> list[Disc]:
        seen = (place + step * period * velocity).tolist()
        return [
            Disc(name, 1, (c[0], c[1]), 0.3, (v[0], v[1]))
            for name, c, v in zip(names, seen, velocity.tolist(), strict=True)
        ]

    def step_of(step: int) -> Any:
        seen = np.column_stack([place + step * period * velocity, radius])
        if how == "list":
            door.set_scene(listed(step))
        else:
            door.set_scene([Shapes("people", 1, "disc", seen, velocity)])
        return door(still, x) if step else door.reset(x=x)

    run = step_of
    if how == "drag":
        run = _other_model(listed, period)
    run(0)
    taken = []
    for step in range(1, steps + 1):
        begun = time.process_time()
        run(step)
        taken.append(time.process_time() - begun)
    return 1e3 * float(np.median(taken))


def _other_model(listed: Callable[[int], list[Disc]], period: float) -> Callable[[int], Any]:
    """Return a step of the filter of a double integrator with drag."""
    from hcbf_gym.filter.core import FilterCore
    from hcbf_gym.filter.settings import FilterSettings

    def nothing(*_: object) -> tuple[()]:
        return ()

    plant = Plant(DoubleIntegrator(drag=0.5), nothing, nothing, U, period=period)
    settings = FilterSettings("lex-cbf-qp", "usual", None, None, None, "warn", False, {})
    core = FilterCore(plant, U, settings)
    core.restart(np.ones(1, dtype=np.bool_))

    def run(step: int) -> Any:
        if step == 0:
            return core.begin(listed(0), Estimate(np.zeros(4)), None, None)
        return core.step(np.zeros(2), listed(step), Estimate(np.zeros(4)))

    return run


def costs() -> str:
    """Return what made anew costs, a line for each way."""
    ways = "list", "shapes", "drag"
    return "\n".join(
        f"{how:7} 100: {cost(100, how):6.2f} ms, 500: {cost(500, how):6.2f} ms" for how in ways
    )


def _costs_of(checkout: Path) -> str:
    """Return the costs in a checkout, taken in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", str(Path(__file__).resolve()), "--part", "cost"],
        env=os.environ | {"PYTHONPATH": str(checkout)},
        cwd=checkout,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


@dataclass(frozen=True)
class Args:
    """Trackers.

    Attributes:
        part: "episodes", "delays", "rest" or "cost"; all of them without it.
        count: of episodes and runs.
        seconds: that a run at rest lasts.
        quick: a tenth of all.
        beside: a checkout whose costs are taken, too.
    """

    part: str = ""
    count: int = 1000
    seconds: float = 60.0
    quick: bool = False
    beside: Path | None = None


def main(args: Args) -> None:
    """Print the parts."""
    warnings.simplefilter("ignore")
    count = args.count // 10 if args.quick else args.count
    if args.part in ("", "episodes"):
        for declares in (True, False):
            for turns in (False, True):
                for named, period in ((False, 0.02), (True, 0.05)):
                    for errors in ERRORS:
                        world = World(count, 3, period, 1, named)
                        found = drive(world, errors, declares, 8.0, turns)
                        what = "velocities" if declares else "positions alone"
                        how = "turn" if turns else "straight"
                        by = "lists" if named else "arrays"
                        print(f"{what}, {how}, {by}, {errors.name}: {found.says()}")
    if args.part in ("", "delays"):
        for period in PERIODS:
            for errors in ERRORS:
                for named in (False, True):
                    after = delays(count, period, errors, named, 2)
                    print(
                        f"motion at 0.3 to 1 m/s, T = {period}, {errors.name}, "
                        f"{'lists' if named else 'arrays'}: reported within 0.5 s in "
                        f"{100.0 * float((after <= 0.5).mean()):.1f} %, median "
                        f"{float(np.median(after)):.2f} s"
                    )
    if args.part in ("", "rest"):
        for period in PERIODS:
            for errors in ERRORS:
                found = rest(max(10, count // 10), period, errors, False, args.seconds, 3)
                print(
                    f"at rest, T = {period}, {errors.name}: {found} reports in "
                    f"{max(10, count // 10)} runs of {args.seconds:g} s"
                )
    if args.part in ("", "cost") and args.beside is None:
        print(costs())
    elif args.part in ("", "cost") and args.beside is not None:
        for _ in range(3):
            for checkout in (args.beside, Path(__file__).parents[1]):
                print(f"{checkout.name}:\n{_costs_of(checkout)}")


if __name__ == "__main__":
    main(tyro.cli(Args))
