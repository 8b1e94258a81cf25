"""Robots in loops of their own behind `VelocityFilter`.

What they are commanded and where they pass, what late and lost odometry costs, what a log shows,
which faults of unmeasured robots are reported (`unmeasured`), and what is refused.
``python -m benchmarks.wheels --part doors`` prints one part; ``--quick`` a little of each.
"""

import math
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from benchmarks import unmeasured
from benchmarks.bent_files import bent
from benchmarks.own_loop import (
    LONGEST,
    PERIOD,
    Body,
    Driven,
    Link,
    Moving,
    boxes_of,
    gap,
    hostile,
    loop,
    pursuit,
)
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import ConvexPolygon, HalfPlane
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import InvalidInputError
from hcbf_robots import Command, Response, Robot, VelocityFilter
from hcbf_robots.identification.identify import identify
from hcbf_robots.identification.log import identify_log
from hcbf_robots.maps import Grid, MapClass, RankedMap
from hcbf_robots.walkers import Walker
from tests.studies import drives


def _passes(body: Body | Walker, known: Any, width: float, speed: float, start: Array) -> Driven:
    """Return a drive through a gap, which ends behind it."""
    walls, robot = gap(width), _known(known)
    door = VelocityFilter(known, walls, period=PERIOD)
    goals = [(1.0, 0.0), (4.0, 0.0)]
    planner = pursuit(goals, robot.command, speed)
    seconds = 20.0 + 8.0 / speed
    return loop(
        door, Moving(body, start), planner, robot.reach, seconds, until=lambda p: p[0] > 2.9
    )


def _known(known: Any) -> Any:
    """Return what has the command and the reach of a robot."""
    return Walker.load(known) if isinstance(known, str | Path) else known


ROBOTS = {
    "TurtleBot 3": Body(Robot(Command(0.22, 2.84, look_ahead=0.08), reach=0.11), 0.08),
    "TurtleBot 4": Body(Robot(Command(0.46, 1.9, look_ahead=0.12), reach=0.19), 0.1),
    "Nav2's stock robot": Body(Robot(Command(0.5, 1.0, look_ahead=0.15), reach=0.22), 0.1),
    "AMR": Body(Robot(Command(1.5, 1.5, look_ahead=0.4), reach=0.5), 0.15),
    "Go2": Body(Robot(Command(1.0, 1.5, sideways=0.5), reach=0.46), 0.15),
    "cart": Body(Robot(Command(1.2, 2.5, look_ahead=0.25), reach=0.34), 0.08),
}
TYPED = Response(time_constant=0.15, delay=0.05, residual=(0.0, 0.05, 0.1), deviation=0.02,
                 overshoot=0.05, braking=1.5)  # fmt: skip


def _logged(body: Body, seed: int) -> Response:
    """Return the response that the log of a drive shows."""
    command, limits = body.robot.command, body.robot.command.limits
    robot, rng, rows = Moving(body, np.zeros(3)), np.random.default_rng(seed), []
    plan = []
    for k in range(len(limits)):
        for sign in (1.0, -1.0):
            plan += [(3.0, sign * limits * np.eye(len(limits))[k]), (2.0, 0.0 * limits)]
    plan += [(1.0, 0.8 * limits * rng.uniform(-1.0, 1.0, len(limits))) for _ in range(25)]
    for held, told in plan:
        for _ in range(round(held / CONTROL_DT)):
            three = told if len(told) == 3 else (told[0], 0.0, told[1])
            rows.append([CONTROL_DT * len(rows), *three, *robot.pose, *robot.twist])
            robot.go(told)
    lines = drives.recorded(np.array(rows), seed)
    with tempfile.TemporaryDirectory() as folder:
        file = drives.write(Path(folder) / "drive.csv", lines, command.sideways is None)
        return identify_log(file, command)[0].response


def robots(quick: bool) -> Iterator[str]:
    """Yield what each robot is commanded, passes and stops before."""
    widths = np.arange(0.04, 1.2, 0.02)  # beside the body
    for name in ("TurtleBot 3", "cart") if quick else ROBOTS:
        body = ROBOTS[name]
        known = {"unknown": None, "typed": TYPED, "log": _logged(body, 0)}
        for how, response in known.items():
            robot = Robot(body.robot.command, response, body.robot.reach)
            command, far = robot.command, [HalfPlane("far", 1, (-1.0, 0.0), -900.0)]
            asked = command.forward * np.eye(len(command.limits))[0]
            ahead = loop(
                VelocityFilter(robot, far, period=PERIOD), Moving(body, np.zeros(3)),
                lambda _, a=asked: a, 0.0, 8.0,
            )  # fmt: skip
            wall = [HalfPlane("wall", 1, (-1.0, 0.0), -3.0)]
            stands = loop(
                VelocityFilter(robot, wall, period=PERIOD), Moving(body, np.zeros(3)),
                lambda _, a=asked: a, robot.reach, 6.0 + 4.0 / command.forward,
            )  # fmt: skip
            narrowest = math.nan
            for width in widths[:: 4 if quick else 1]:
                across = 2.0 * robot.reach + float(width)
                if (
                    _passes(body, robot, across, 0.5 * command.forward, np.zeros(3)).path[-1, 0]
                    > 2.9
                ):
                    narrowest = across
                    break
            share = ahead.told[-50:, 0].mean() / command.forward
            yield (
                f"{name}, {how}: commanded {share:.3f} of {command.forward:g} m/s, passes "
                f"{narrowest:.2f} m (body {2.0 * robot.reach:.2f}), stands {stands.least:.3f} m off"
            )


def doors(quick: bool) -> Iterator[str]:
    """Yield where carts pass, and whether they turn and arrive from rest."""
    count, cart = 4 if quick else 20, Walker.load("cart")
    ideal = Body(Robot(cart.command, cart.response, 0.34), 0.0)
    for what, body in (("ideal", ideal), ("MuJoCo", cart)):
        for speed in (0.5,) if quick else (0.3, 0.5):
            for width in (0.8,) if quick else (0.78, 0.8, 0.82, 0.85):
                runs = [_passes(body, cart, width, speed, start) for start in _starts(count)]
                yield _said(f"{what}, {speed} m/s, {width} m", runs, lambda r: r.path[-1, 0] > 2.9)
    small = Robot(Command(0.5, 1.8, look_ahead=0.12), TYPED, 0.22)
    runs = [_passes(Body(small, 0.1), small, 0.6, 0.25, start) for start in _starts(count)]
    yield _said("radius .22 m, .6 m", runs, lambda r: r.path[-1, 0] > 2.9)
    runs = []
    for start in _starts(count):
        cells = np.zeros((160, 120), dtype=np.bool_)
        cells[:, 80:83] = True
        cells[72:89, 80:83] = False  # 17 free cells
        room = RankedMap(
            Grid(0.05, (-2.0, -4.025, 0.0), cells.shape), (MapClass("walls", 1, "keepout", cells),)
        )
        door = VelocityFilter(cart, [room], period=PERIOD)
        planner = pursuit([(1.0, 0.0), (4.0, 0.0)], cart.command, 0.3)
        runs.append(loop(door, Moving(cart, start), planner, 0.34, 50.0, until=_behind))
    yield _said("a map of 5 cm, 17 free cells", runs, lambda r: _behind(r.path[-1]))
    wall = [HalfPlane("wall", 1, (-1.0, 0.0), -0.41)]  # 2 cm beyond what rows reserve
    corner = [ConvexPolygon("corner", 1, ((0.41, -1.0), (2.0, -1.0), (2.0, 1.0), (0.41, 1.0)))]
    for name, barriers, goal in (
        ("side", wall, (0.0, 2.0)), ("behind", wall, (-2.0, 0.1)), ("corner", corner, (1.2, 2.2)),
    ):  # fmt: skip
        door = VelocityFilter(
            cart, barriers, period=PERIOD, guidance="geodesic", goal=goal
        )  # fmt: skip
        run = loop(
            door, Moving(cart, np.zeros(3)), lambda _: np.zeros(2), 0.34, 40.0,
            until=lambda p, g=goal: bool(np.linalg.norm(p[:2] - g) < 0.35),
        )  # fmt: skip
        yield _said(
            f"from rest before a wall, goal: {name}", [run],
            lambda r, g=goal: np.linalg.norm(r.path[-1, :2] - g) < 0.35,
        )  # fmt: skip
    door = VelocityFilter(cart, wall, period=PERIOD)
    turned = loop(
        door, Moving(cart, np.zeros(3)), lambda _: np.array([0.0, 1.5]), 0.34, 8.0
    )  # fmt: skip
    changed, total = turned.statuses[1:].sum(), turned.statuses.sum()
    yield f"turning in place beside a wall: {changed} of {total} steps changed"


def _behind(pose: Array) -> bool:
    """Return whether a robot is behind the wall of the map."""
    return bool(pose[0] > 2.9)


def _starts(count: int) -> Iterator[Array]:
    """Yield where drives begin: straight, then oblique."""
    yield np.zeros(3)
    for seed in range(1, count + 1):
        rng = np.random.default_rng(seed)
        yield np.array([0.0, rng.uniform(-0.8, 0.8), rng.uniform(-1.0, 1.0)])


def _said(what: str, runs: Sequence[Driven], arrived: Callable[[Driven], Any]) -> str:
    """Return a line of drives."""
    passed, least = sum(bool(arrived(run)) for run in runs), min(run.least for run in runs)
    statuses = sum(run.statuses for run in runs)
    return f"{what}: {passed} of {len(runs)} pass, least {least:+.3f} m, statuses {statuses}"


LINKS = {
    "perfect": Link(),
    "20 Hz": Link(20.0),
    "10 Hz": Link(10.0),
    "5 ms late": Link(50.0, 0.005),
    "60 ms late": Link(50.0, 0.06, 0.2),
    "100 ms late": Link(50.0, 0.1, 0.1),
    "20 Hz, 60 ms late, 10 % lost": Link(20.0, 0.06, 0.3, 0.1),
    "10 Hz, 100 ms late, 10 % lost": Link(10.0, 0.1, 0.2, 0.1),
    "190 ms late": Link(50.0, 0.19, 0.05),
    "30 % lost": Link(50.0, 0.02, 0.5, 0.3),
    "20 Hz, 60 ms late, 30 % lost": Link(20.0, 0.06, 0.3, 0.3),
    "20 Hz, bursts of 4, 30 % lost": Link(20.0, 0.02, 0.3, 0.3, 4),
}
"""The twelve rows, fixed beforehand."""
MAX_AGE = 0.4
"""That the loops believe [s]."""


def loops(quick: bool, count: int, robot: str) -> Iterator[str]:
    """Yield each row of loops, beside perfect data, with a planner that drives at what is near."""
    walker = Walker.load(robot)
    lengths = dict.fromkeys(range(count), 0.0)
    for name, link in list(LINKS.items())[:: 4 if quick else 1]:
        runs = []
        for seed in range(count):
            rng = np.random.default_rng([3, seed])
            boxes, reach = boxes_of(rng), walker.reach
            door = VelocityFilter(walker, boxes, period=LONGEST, max_age=MAX_AGE)
            planner = hostile(boxes, walker.command, rng)
            start = Moving(walker, np.zeros(3), seed)
            runs.append(loop(door, start, planner, reach, 20.0, link, seed))
        shares = [run.length / (lengths[k] or run.length) for k, run in enumerate(runs)]
        if name == "perfect":
            lengths = {k: run.length for k, run in enumerate(runs)}
        alarms = [run.alarms for run in runs if run.alarms]
        least, longest = min(run.least for run in runs), max(run.longest for run in runs)
        statuses = sum(run.statuses for run in runs)
        yield (
            f"{robot}: {name}: {sum(run.least < 0.0 for run in runs)} of {count} entered, least "
            f"{least:+.3f} m, alarms {alarms}, {sum(run.fell for run in runs)} fell, "
            f"path {np.mean(shares):.2f}, 99 % of steps {1e3 * longest:.2f} ms, statuses {statuses}"
        )


def logs(quick: bool, count: int) -> Iterator[str]:
    """Yield how near logs come to what the model shows, and hostile loops behind what they show."""
    near, refused, least = 0, 0, list[float]()
    for k in range(3 if quick else count):
        walker = Walker.load(("cart", "holonomic-cart")[k % 2])
        known, rng = identify(walker, 20.0, 7).response, np.random.default_rng([5, k])
        lines = drives.recorded(
            drives.drive(walker, k), k, rate=rng.choice([10.0, 25.0, 50.0]),
            noise=rng.uniform(0.0, 0.01), lost=rng.uniform(0.0, 0.2), jitter=rng.uniform(0.0, 0.5),
        )  # fmt: skip
        with tempfile.TemporaryDirectory() as folder:
            differential = walker.command.look_ahead is not None
            file = drives.write(Path(folder) / "drive.csv", lines, differential)
            try:
                found = identify_log(file, walker.command)[0].response
            except InvalidInputError as error:
                refused += 1
                yield f"log {k}: refused: {error}"
                continue
        off = np.abs(np.array(found.gain) / np.array(known.gain) - 1.0).max()
        close = off <= 0.1 and abs(found.follows - known.follows) <= 0.1 * max(0.2, known.follows)
        near += close
        refused += bool(found.complaints) and not close
        yield (
            f"log {k}: gains off by {off:.3f}, τ + δ {found.follows:.3f} for "
            f"{known.follows:.3f} s, complaints {found.complaints}"
        )
        robot = Robot(walker.command, found, walker.reach)
        least += [_behind_a_log(walker, robot, k, seed) for seed in range(2 if quick else 50)]
    entered = sum(one < 0.0 for one in least)
    yield (
        f"{entered} of {len(least)} hostile loops of carts filtered by their logs entered, "
        f"least {min(least):+.3f} m"
    )
    yield f"{near} near, {refused} refused or complained of"


def _behind_a_log(walker: Walker, robot: Robot, log: int, seed: int) -> float:
    """Return the least distance from a region of a hostile loop that knows what a log shows [m]."""
    rng = np.random.default_rng([6, log, seed])
    boxes = boxes_of(rng)
    door = VelocityFilter(robot, boxes, period=LONGEST)
    planner = hostile(boxes, walker.command, rng)
    start = Moving(walker, np.zeros(3), seed)
    return loop(door, start, planner, walker.reach, 20.0, seed=seed).least


def main(part: str = "all", quick: bool = False, count: int = 40, robot: str = "cart") -> None:
    """Print what is seen.

    Args:
        part: robots, doors, loops, logs, faults, bent, or all.
        quick: a little of each.
        count: loops a row; logs are half as many, bent files 300 where it is 40.
        robot: of the loops, a contract's path or name.
    """
    few = 2 if quick else count
    parts = {
        "robots": lambda: robots(quick),
        "doors": lambda: doors(quick),
        "loops": lambda: loops(quick, few, robot),
        "logs": lambda: logs(quick, count // 2),
        "faults": lambda: unmeasured.lines(quick, 3 if quick else 5 * count // 2),
        "bent": lambda: bent(quick, 15 * count // 2),
    }
    warnings.simplefilter("ignore")
    for name, lines in parts.items():
        if part in ("all", name):
            for line in lines():
                print(f"{name}: {line}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
