"""Robots in loops of their own behind `VelocityFilter`.

Where they pass, late and lost odometry, logs, faults of unmeasured
robots (`unmeasured`), and malformed files (`fuzz_files`).
``python -m benchmarks.wheels --part gaps`` prints one part; ``--quick`` a little of each.
"""

import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from benchmarks import fuzz_files, unmeasured
from benchmarks.own_loop import (
    PERIOD,
    Body,
    Driven,
    Link,
    boxes_of,
    drive,
    gap,
    hostile,
    pursuit,
)
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import ConvexPolygon, HalfPlane
from hcbf_gym.errors import InvalidInputError
from hcbf_robots import Command, Response, Robot
from hcbf_robots.identification.identify import identify
from hcbf_robots.identification.log import identify_log
from hcbf_robots.maps import Grid, MapClass, RankedMap
from hcbf_robots.walkers import Walker
from tests.studies import drives

AT_20_HZ = {"period": PERIOD}
BEHIND = 2.9  # Where a robot is behind a gap [m]
TYPED = Response(time_constant=0.15, delay=0.05, residual=(0.0, 0.05, 0.1), deviation=0.02,
                 overshoot=0.05, braking=1.5)  # fmt: skip
LINKS = {  # twelve rows, fixed beforehand
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
MAX_AGE = {"max_age": 0.4}  # Of data that the loops use [s]


def _passes(known: Any, body: Any, width: float, speed: float, start: Any = None) -> Driven:
    """Return a drive through a gap, which ends behind it."""
    planner = pursuit([(1.0, 0.0), (4.0, 0.0)], known.command, speed)
    return drive(
        known, gap(width), planner, 20.0 + 8.0 / speed, body, start, options=AT_20_HZ,
        until=lambda p: p[0] > BEHIND,
    )  # fmt: skip


def gaps(quick: bool, count: int, robot: str) -> Iterator[str]:
    """Yield where carts pass, and whether they turn and arrive from rest."""
    cart, starts = Walker.load("cart"), list(_starts(4 if quick else 20))
    ideal = Body(Robot(cart.command, cart.response, 0.34), 0.0)
    for what, body in (("ideal", ideal), ("MuJoCo", cart)):
        for speed in (0.5,) if quick else (0.3, 0.5):
            for width in (0.8,) if quick else (0.78, 0.8, 0.82, 0.85):
                runs = [_passes(cart, body, width, speed, start) for start in starts]
                yield _line(f"{what}, {speed} m/s, {width} m", runs)
    small = Robot(Command(0.5, 1.8, look_ahead=0.12), TYPED, 0.22)
    runs = [_passes(small, Body(small, 0.1), 0.6, 0.25, start) for start in starts]
    yield _line("radius .22 m, .6 m", runs)
    cells = np.zeros((160, 120), dtype=np.bool_)
    cells[:, 80:83] = True
    cells[72:89, 80:83] = False  # 17 free cells
    grid = Grid(0.05, (-2.0, -4.025, 0.0), cells.shape)
    room = RankedMap(grid, (MapClass("walls", 1, "keepout", cells),))
    runs = [
        drive(
            cart, [room], pursuit([(1.0, 0.0), (4.0, 0.0)], cart.command, 0.3), 50.0, start=start,
            options=AT_20_HZ, until=lambda p: p[0] > BEHIND,
        )
        for start in starts
    ]  # fmt: skip
    yield _line("a map of 5 cm, 17 free cells", runs)
    wall = [HalfPlane("wall", 1, (-1.0, 0.0), -0.41)]  # 2 cm beyond what rows reserve
    corner = [ConvexPolygon("corner", 1, ((0.41, -1.0), (2.0, -1.0), (2.0, 1.0), (0.41, 1.0)))]
    for name, barriers, goal in (
        ("side", wall, (0.0, 2.0)), ("behind", wall, (-2.0, 0.1)), ("corner", corner, (1.2, 2.2)),
    ):  # fmt: skip

        def arrived(pose: Array, goal: tuple[float, float] = goal) -> bool:
            return bool(np.linalg.norm(pose[:2] - goal) < 0.35)

        options = AT_20_HZ | {"guidance": "geodesic", "goal": goal}
        run = drive(cart, barriers, lambda _: np.zeros(2), 40.0, options=options, until=arrived)
        yield _line(f"from rest before a wall, goal: {name}", [run], arrived)
    turned = drive(cart, wall, lambda _: np.array([0.0, 1.5]), 8.0, options=AT_20_HZ)
    changed, total = turned.statuses[1:].sum(), turned.statuses.sum()
    yield f"turning in place beside a wall: {changed} of {total} steps changed"


def _starts(count: int) -> Iterator[Array]:
    """Yield where drives begin: straight, then oblique."""
    yield np.zeros(3)
    for seed in range(1, count + 1):
        rng = np.random.default_rng(seed)
        yield np.array([0.0, rng.uniform(-0.8, 0.8), rng.uniform(-1.0, 1.0)])


def _line(
    what: str,
    runs: Sequence[Driven],
    arrived: Callable[[Array], bool] = lambda pose: bool(pose[0] > BEHIND),
) -> str:
    """Return a line of drives."""
    passed, least = sum(arrived(run.path[-1]) for run in runs), min(run.least for run in runs)
    statuses = sum(run.statuses for run in runs)
    return f"{what}: {passed} of {len(runs)} pass, least {least:+.3f} m, statuses {statuses}"


def loops(quick: bool, count: int, robot: str) -> Iterator[str]:
    """Yield each row of loops, beside perfect data, with a planner that drives at what is near."""
    walker = Walker.load(robot)
    lengths: list[float] = []
    for name, link in list(LINKS.items())[:: 4 if quick else 1]:
        runs = []
        for seed in range(count):
            rng = np.random.default_rng([3, seed])
            boxes = boxes_of(rng)
            planner = hostile(boxes, walker.command, rng)
            runs.append(drive(walker, boxes, planner, 20.0, seed=seed, options=MAX_AGE, link=link))
        lengths = lengths or [run.length for run in runs]
        share = np.mean([run.length / most for run, most in zip(runs, lengths, strict=True)])
        alarms = [run.alarms for run in runs if run.alarms]
        least, longest = min(run.least for run in runs), max(run.longest for run in runs)
        statuses = sum(run.statuses for run in runs)
        yield (
            f"{robot}: {name}: {sum(run.least < 0.0 for run in runs)} of {count} entered, least "
            f"{least:+.3f} m, alarms {alarms}, {sum(run.fell for run in runs)} fell, "
            f"path {share:.2f}, 99 % of steps {1e3 * longest:.2f} ms, statuses {statuses}"
        )


def logs(quick: bool, count: int, robot: str) -> Iterator[str]:
    """Yield how near logs come to what the model shows, and hostile loops behind what they show."""
    near, refused, least = 0, 0, list[float]()
    for k in range(3 if quick else count // 2):
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
        behind = Robot(walker.command, found, walker.reach)
        for seed in range(2 if quick else 50):
            rng = np.random.default_rng([6, k, seed])
            boxes = boxes_of(rng)
            planner = hostile(boxes, walker.command, rng)
            least.append(drive(behind, boxes, planner, 20.0, walker, seed=seed).least)
    entered = sum(one < 0.0 for one in least)
    yield (
        f"{entered} of {len(least)} hostile loops of carts filtered by their logs entered, "
        f"least {min(least):+.3f} m"
    )
    yield f"{near} near, {refused} refused or complained of"


PARTS: dict[str, Callable[[bool, int, str], Iterator[str]]] = {
    "gaps": gaps,
    "loops": loops,
    "logs": logs,
    "faults": lambda quick, count, _: unmeasured.lines(quick, 3 if quick else 5 * count // 2),
    "fuzz": lambda quick, count, _: fuzz_files.lines(8 if quick else 5 * count // 2),
}


def main(part: str = "all", quick: bool = False, count: int = 40, robot: str = "cart") -> None:
    """Print what is seen.

    Args:
        part: gaps, loops, logs, faults, fuzz, or all.
        quick: a little of each.
        count: loops a row; logs are half as many, malformed files 300 where it is 40.
        robot: of the loops, a contract's path or name.
    """
    warnings.simplefilter("ignore")
    for name, lines in PARTS.items():
        if part in ("all", name):
            for line in lines(quick, 2 if quick and name == "loops" else count, robot):
                print(f"{name}: {line}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
