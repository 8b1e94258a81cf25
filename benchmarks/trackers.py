"""Trackers: regions that are returned anew at every step, with velocities and without.

``python -m benchmarks.trackers`` prints the parts: episodes with moving regions, how soon a motion
is reported that no velocity declares, and reports of regions at rest. Entries are judged by the
true places.
"""

import itertools
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import tyro

from hcbf_gym import BatchFilter
from hcbf_gym._core import Reason
from hcbf_gym.barriers import Disc, Shapes
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.programs import FilterStatus

NOISE = 0.02  # By how much a position is wrong at most [m]; of normal errors, three deviations
PERIODS = 0.02, 0.05
U = Box.symmetric(5.0)
FASTEST = 1.5  # To which speed the robots' nominal inputs lead [m/s]


def _uniform(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    turn, far = rng.uniform(0.0, 2.0 * np.pi, shape), np.sqrt(rng.uniform(0.0, 1.0, shape))
    return NOISE * far[..., None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)


def _normal(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return NOISE / 3.0 * rng.standard_normal((*shape, 2))


Errors = Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]
ERRORS: dict[str, Errors] = {"uniform": _uniform, "normal": _normal}
"""How positions are wrong: (rng, shape) → (…, 2) [m]."""


class World:
    """N robots, each among m discs, and a tracker of these."""

    def __init__(self, count: int, discs: int, period: float, seed: int, named: bool = False):
        self.rng, self.period, self.named = np.random.default_rng(seed), period, named
        rng, shape = self.rng, (count, discs)
        self.x = np.zeros((count, 4))
        turn, far = rng.uniform(0.0, 2.0 * np.pi, shape), rng.uniform(1.5, 4.0, shape)
        self.place = far[..., None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        self.velocity = np.zeros((*shape, 2))
        self.radius = rng.uniform(0.2, 0.6, shape)
        self.filter = BatchFilter(U, period, count, uncertainty=Uncertainty(distance=NOISE))

    def track(self, errors: Errors, declares: bool) -> None:
        """Let the filter have what the tracker sees now."""
        seen = self.place + errors(self.rng, self.place.shape[:2])
        velocity = self.velocity if declares else np.zeros_like(self.velocity)
        if not self.named:
            numbers = np.concatenate([seen, self.radius[..., None]], axis=2)
            self.filter.set_scene([Shapes("people", 1, "disc", numbers, velocity)])
            return
        rows = zip(seen.tolist(), self.radius.tolist(), velocity.tolist(), strict=True)
        self.filter.set_scene([
            [
                Disc(f"person {k}", 1, (c[0], c[1]), r, (v[0], v[1]))
                for k, (c, r, v) in enumerate(zip(*row, strict=True))
            ]
            for row in rows
        ])  # fmt: skip

    def heights(self) -> np.ndarray:
        """Return (N, m) the true h [m]."""
        return np.linalg.norm(self.x[:, None, :2] - self.place, axis=2) - self.radius

    def advance(self, u: np.ndarray) -> None:
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
    """What episodes showed."""

    entered: int = 0  # of them with an entry
    calm: int = 0  # of these, under a calm status
    unreported: int = 0  # of these, without MOVES before
    reported: int = 0  # with MOVES at any step
    violated: float = 0.0  # share of steps with a status above RELAXED


def drive(world: World, errors: Errors, declares: bool, seconds: float, turns: bool) -> Entered:
    """Drive robots at regions that drive at them."""
    count, discs = world.radius.shape
    rng = world.rng
    speed = rng.uniform(0.1, 0.8, (count, discs, 1))
    aim = world.x[:, None, :2] + rng.normal(0.0, 0.3, world.place.shape) - world.place
    world.velocity = speed * aim / np.linalg.norm(aim, axis=2, keepdims=True)
    goal = rng.uniform(-4.0, 4.0, (count, 2))
    hunts = rng.random(count) < 0.5
    world.track(errors, declares)
    report = world.filter.reset(x=world.x)
    moved = report["reason"] == Reason.MOVES
    first, inside, calm = np.zeros((3, count), dtype=bool)
    found = Entered()
    steps = round(seconds / world.period)
    for _ in range(steps):
        if turns:
            to = world.x[:, None, :2] - world.place
            far = np.maximum(np.linalg.norm(to, axis=2, keepdims=True), 1e-9)
            world.velocity = speed * to / far
        nearest = world.heights().argmin(axis=1)
        prey = world.place[np.arange(count), nearest]
        world.track(errors, declares)
        u, report = world.filter(world.towards(np.where(hunts[:, None], prey, goal)), world.x)
        moved |= report["reason"] == Reason.MOVES
        now = (report["status"] < FilterStatus.VIOLATED) & (report["reason"] == 0)
        found.calm += int((inside & now & ~calm).sum())  # of the sample at which it is inside
        found.violated += float((report["status"] >= FilterStatus.VIOLATED).mean()) / steps
        world.advance(u)
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
    world.filter.reset(x=world.x)
    goal = world.rng.uniform(-0.5, 0.5, (count, 2))
    found = np.full(count, np.inf)
    speed = world.rng.uniform(0.3, 1.0, (count, 1))
    world.place *= 2.0
    world.track(errors, False)
    world.filter.reset(x=world.x)
    still = round(1.0 / period)
    for step in range(still + round(1.0 / period)):
        if step >= still:
            to = world.x[:, :2] - world.place[:, 0]
            world.velocity[:, 0] = speed * to / np.linalg.norm(to, axis=1, keepdims=True)
        world.track(errors, False)
        u, report = world.filter(world.towards(goal), world.x)
        late = (report["reason"] == Reason.MOVES) & np.isinf(found)
        found[late] = (step - still) * period
        world.advance(u)
    return found


def rest(count: int, period: float, errors: Errors, named: bool, seconds: float, seed: int) -> int:
    """Return how many steps of robots among regions at rest had the reason MOVES."""
    world = World(count, 4, period, seed, named)
    world.track(errors, False)
    world.filter.reset(x=world.x)
    goal, reports = np.zeros((count, 2)), 0
    for step in range(round(seconds / period)):
        if step % round(2.0 / period) == 0:
            goal = world.rng.uniform(-4.0, 4.0, (count, 2))
        world.track(errors, False)
        u, report = world.filter(world.towards(goal), world.x)
        reports += int((report["reason"] == Reason.MOVES).sum())
        world.advance(u)
    return reports


def episodes(count: int) -> Iterator[str]:
    """Yield what episodes with moving regions showed."""
    for declares, turns, (named, period), (name, errors) in itertools.product(
        (True, False), (False, True), ((False, 0.02), (True, 0.05)), ERRORS.items()
    ):
        one = drive(World(count, 3, period, 1, named), errors, declares, 8.0, turns)
        yield (
            f"{'velocities' if declares else 'positions alone'}, {'turn' if turns else 'straight'}"
            f", {'lists' if named else 'arrays'}, {name}: {one.entered} of {count} entered, "
            f"{one.calm} under a calm status, {one.unreported} without MOVES before; MOVES in "
            f"{one.reported}, {100.0 * one.violated:.1f} % of steps above RELAXED"
        )


def motions(count: int) -> Iterator[str]:
    """Yield how soon a motion is reported that no velocity declares."""
    for period, (name, errors), named in itertools.product(PERIODS, ERRORS.items(), (False, True)):
        after = delays(count, period, errors, named, 2)
        yield (
            f"motion at 0.3 to 1 m/s, T = {period}, {name}, {'lists' if named else 'arrays'}: "
            f"reported within 0.5 s in {100.0 * float((after <= 0.5).mean()):.1f} %, median "
            f"{float(np.median(after)):.2f} s"
        )


def rests(count: int) -> Iterator[str]:
    """Yield how often a region at rest is reported."""
    runs = max(10, count // 10)
    for period, (name, errors) in itertools.product(PERIODS, ERRORS.items()):
        found = rest(runs, period, errors, False, 60.0, 3)
        yield f"at rest, T = {period}, {name}: {found} reports in {runs} runs of 60 s"


def main(count: int = 1000) -> None:
    """Print all parts, of so many episodes and runs."""
    warnings.simplefilter("ignore")
    for line in itertools.chain(episodes(count), motions(count), rests(count)):
        print(line, flush=True)


if __name__ == "__main__":
    tyro.cli(main)
