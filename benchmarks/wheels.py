"""Robots in loops of their own behind `VelocityFilter`.

What they are commanded and where they pass, what late and lost odometry costs, what a log shows,
and what is refused. ``python -m benchmarks.wheels --part doors`` prints one part; ``--quick`` a
little of each.
"""

import dataclasses
import json
import math
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro

from hcbf_gym import Command, Response, Robot, VelocityFilter
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, ConvexPolygon, HalfPlane
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import HcbfError, InvalidInputError
from hcbf_gym.maps import Grid, MapClass, RankedMap
from hcbf_gym.models.plant import FIRST_ALARM
from hcbf_gym.programs import FilterStatus
from hcbf_gym.robots import Walker, carts, footprint, walker_parts
from hcbf_gym.studies.identification.identify import identify
from hcbf_gym.studies.identification.log import identify_log
from hcbf_gym.studies.identification.record import Runner
from tests.studies import drives

PERIOD = 0.05
"""Of the commands [s]."""
LONGEST = math.ceil(PERIOD / CONTROL_DT) * CONTROL_DT
"""From one command to the next, as robots look for one at every control step [s]."""
CONTRACTS = Path(__file__).parents[1] / "tests" / "robots" / "contracts"

Planner = Callable[[Array], Array]
"""Pose (3,) → command (k,)."""


class Body(NamedTuple):
    """A robot that follows commands by a lag of first order, on a floor without friction.

    Attributes:
        robot: what the filter knows of it.
        lag: τ [s].
    """

    robot: Robot
    lag: float


class Moving:
    """A simulated robot: one of `Body`, or a walker in MuJoCo.

    Attributes:
        pose: (3,) x, y and θ of its centre or axle [m, rad].
        twist: (3,) in its own axes [m/s, rad/s].
        fallen: whether it has fallen.
    """

    def __init__(self, body: "Body | Walker", start: Array, seed: int = 0):
        self._runner = Runner(body, seed) if isinstance(body, Walker) else None
        self._lag = 0.0 if isinstance(body, Walker) else body.lag
        self.pose, self.twist = np.array(start, dtype=np.float64), np.zeros(3)
        self.fallen = False
        if self._runner is not None:
            rng = np.random.default_rng(seed)
            self._runner.drive.reset(self.pose[:2], float(start[2]), BarrierSet([()]), rng)
            self._look()

    def go(self, command: Array) -> None:
        """Follow a command for one control step."""
        if self._runner is not None:
            self.fallen |= self._runner.tell(command, CONTROL_DT).falls > 0
            self._look()
            return
        three = command if len(command) == 3 else np.array([command[0], 0.0, command[1]])
        share = 1.0 - math.exp(-CONTROL_DT / self._lag) if self._lag > 0.0 else 1.0
        for _ in range(4):
            part = 0.25 * CONTROL_DT
            self.twist = self.twist + 0.25 * share * (three - self.twist)
            cos, sin = math.cos(self.pose[2]), math.sin(self.pose[2])
            ahead, aside, turn = self.twist
            self.pose = self.pose + part * np.array(
                [cos * ahead - sin * aside, sin * ahead + cos * aside, turn]
            )

    def _look(self) -> None:
        assert self._runner is not None
        simulation = self._runner.drive.simulation
        data, yaw = simulation.data, simulation.yaw
        cos, sin = math.cos(yaw), math.sin(yaw)
        vx, vy = data.qvel[:2]
        self.pose = np.array([*data.qpos[:2], yaw])
        self.twist = np.array([cos * vx + sin * vy, cos * vy - sin * vx, data.qvel[5]])


class Link(NamedTuple):
    """What lies between a robot's odometry and the filter.

    Attributes:
        rate: of odometry [Hz].
        late: how old it is when it comes [s].
        jitter: share by which that varies.
        lost: share that never comes.
        burst: how many are lost together.
    """

    rate: float = 50.0
    late: float = 0.0
    jitter: float = 0.0
    lost: float = 0.0
    burst: int = 1


PERFECT = Link()


class Driven(NamedTuple):
    """What a loop showed.

    Attributes:
        path: (k, 3) poses at every control step.
        least: the least distance of the robot's circle from a strict region [m].
        statuses: (6,) how often each was said.
        alarms: reasons from the first alarm on.
        longest: 99th percentile of a step [s].
        fell: whether the robot fell, where the loop ends.
        told: (k, n) commands.
    """

    path: Array
    least: float
    statuses: Array
    alarms: set[int]
    longest: float
    fell: bool
    told: Array

    @property
    def length(self) -> float:
        """Of the path [m]."""
        return float(np.linalg.norm(np.diff(self.path[:, :2], axis=0), axis=1).sum())


def loop(
    door: VelocityFilter,
    robot: Moving,
    planner: Planner,
    reach: float,
    seconds: float,
    link: Link = PERFECT,
    seed: int = 0,
    until: Callable[[Array], bool] = lambda pose: False,
    walls: Sequence[Barrier] | None = None,
    sees: Callable[[float, Moving], None] = lambda now, robot: None,
) -> Driven:
    """Run a robot's own loop, as a node runs it: commands at 20 Hz, odometry as it comes.

    Args:
        door: the filter.
        robot: the robot.
        planner: what it shall do.
        reach: radius of the circle that must stay outside [m].
        seconds: how long at most.
        link: of the odometry.
        seed: of what is lost and late.
        until: pose → whether it has arrived.
        walls: what is there; None for what the filter knows.
        sees: called in every control step, with the time [s], before what the filter is asked.
    """
    rng = np.random.default_rng(seed)
    regions = BarrierSet([door.barriers if walls is None else walls])
    strict = (regions.priority[0] == 1) & (regions.kind[0] != 100)
    waiting: list[tuple[float, float, Array, Array]] = []
    newest: tuple[float, Array, Array] | None = None
    path, told, spent, alarms = [], [], [], set[int]()
    statuses, least, dropped = np.zeros(len(FilterStatus), dtype=int), np.inf, 0
    said, commanded = -np.inf, -np.inf
    for k in range(round(seconds / CONTROL_DT)):
        now = 100.0 + CONTROL_DT * k
        sees(now, robot)
        if now - said >= 1.0 / link.rate - 1e-9:
            said = now
            if dropped == 0 and rng.random() * link.burst < link.lost:
                dropped = link.burst
            if dropped:
                dropped -= 1
            else:
                late = link.late * (1.0 + link.jitter * rng.uniform(-1.0, 1.0))
                waiting.append((now + late, now, robot.pose, robot.twist))
        for one in [one for one in waiting if one[0] <= now + 1e-9]:
            waiting.remove(one)
            newest = one[1:]  # the last to come, whatever its stamp
        if newest is not None and now - commanded >= PERIOD - 1e-9:
            commanded = now if now - commanded > 2.0 * PERIOD else commanded + PERIOD
            began = time.perf_counter()
            _, report = door.step(planner(newest[1]), newest[1], newest[2], newest[0], now)
            spent.append(time.perf_counter() - began)
            statuses[int(report["status"])] += 1
            if report["reason"] >= FIRST_ALARM:
                alarms.add(int(report["reason"]))
        robot.go(door.command_at(now))
        path.append(robot.pose)
        told.append(door.command_at(now))
        x = np.array([[*robot.pose[:2], 0.0, 0.0]])
        h = regions.values(x, np.array([CONTROL_DT * (k + 1)]))[0]
        least = min(least, float(h[strict].min(initial=np.inf)) - reach)
        if robot.fallen or until(robot.pose):
            break
    longest = float(np.quantile(spent[5:] or [0.0], 0.99))
    fell = robot.fallen
    return Driven(np.array(path), least, statuses, alarms, longest, fell, np.array(told))


def pursuit(goals: Sequence[tuple[float, float]], command: Command, speed: float) -> Planner:
    """Return a planner that turns to a goal and drives; the next one counts within .3 m.

    It knows nothing of the filter.
    """
    left = [np.array(goal) for goal in goals]

    def plan(pose: Array) -> Array:
        if len(left) > 1 and np.linalg.norm(left[0] - pose[:2]) < 0.3:
            left.pop(0)
        d = left[0] - pose[:2]
        error = math.remainder(math.atan2(d[1], d[0]) - pose[2], math.tau)
        turn = float(np.clip(2.0 * error, -0.6 * command.turn, 0.6 * command.turn))
        ahead = speed * max(0.0, math.cos(error)) ** 3
        return np.array([ahead, turn] if command.sideways is None else [ahead, 0.0, turn])

    return plan


def gap(width: float, offset: float = 0.0) -> list[Barrier]:
    """Return two walls 2 m ahead with a gap between them."""
    low, high = offset - 0.5 * width, offset + 0.5 * width
    return [
        ConvexPolygon("left", 1, ((2.0, high), (2.15, high), (2.15, 4.0), (2.0, 4.0))),
        ConvexPolygon("right", 1, ((2.0, -4.0), (2.15, -4.0), (2.15, low), (2.0, low))),
    ]


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
TYPED = Response(time_constant=0.15, delay=0.05, residual=(0.0, 0.05, 0.1), sway=0.02,
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


def boxes_of(rng: np.random.Generator) -> list[Barrier]:
    """Return six boxes in a room of 8 m, none at the start."""
    walls: list[Barrier] = [
        HalfPlane(f"wall {k}", 1, normal, -4.0)
        for k, normal in enumerate(((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)))
    ]
    while len(walls) < 10:
        (x, y), (w, h) = rng.uniform(-3.2, 3.2, 2), rng.uniform(0.2, 0.6, 2)
        if math.hypot(x, y) > 1.3:
            corners = ((x - w, y - h), (x + w, y - h), (x + w, y + h), (x - w, y + h))
            walls.append(ConvexPolygon(f"box {len(walls) - 4}", 1, corners))
    return walls


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


def hostile(
    barriers: Sequence[Barrier],
    command: Command,
    rng: np.random.Generator,
    *,
    wanders: bool = True,
) -> Planner:
    """Return a planner that drives at the nearest region, wanders, backs off and spins in turn.

    One that does not wander drives at what is nearest alone.
    """
    state = {"mode": 0, "left": 0 if wanders else -1, "drawn": np.zeros(len(command.limits))}

    def plan(pose: Array) -> Array:
        if state["left"] == 0:
            state.update(mode=int(rng.integers(4)), left=int(rng.integers(10, 50)))
            state["drawn"] = command.limits * rng.uniform(-1.0, 1.0, len(command.limits))
        state["left"] -= 1
        if state["mode"] == 3:
            return state["drawn"]
        x = np.array([*pose[:2], 0.0, 0.0])
        nearest = min(barriers, key=lambda b: b.h(x))
        n = nearest.jet(x).gradient[:2]
        error = math.remainder(math.atan2(-n[1], -n[0]) - pose[2], math.tau)
        if state["mode"] == 2:  # away
            error = math.remainder(error + math.pi, math.tau)
        turn = float(np.clip(3.0 * error, -command.turn, command.turn))
        ahead = command.forward * (math.cos(error) if state["mode"] else max(0.3, math.cos(error)))
        return np.array([ahead, turn] if command.sideways is None else [ahead, 0.0, turn])

    return plan


def logs(quick: bool, count: int) -> Iterator[str]:
    """Yield how near logs come to what the model shows, and hostile loops behind what they show."""
    near = refused = 0
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
        if differential and k < 2:
            robot, least = Robot(walker.command, found, walker.reach), []
            for seed in range(2 if quick else 10):
                draw = np.random.default_rng([6, seed])
                boxes = boxes_of(draw)
                door = VelocityFilter(robot, boxes, period=PERIOD)
                planner = hostile(boxes, walker.command, draw)
                moving = Moving(walker, np.zeros(3), seed)
                least.append(loop(door, moving, planner, walker.reach, 20.0, seed=seed).least)
            yield f"  filtered by it: least {min(least):+.3f} m in {len(least)} hostile loops"
    yield f"{near} near, {refused} refused or complained of"


def bent(quick: bool, count: int) -> Iterator[str]:
    """Yield how many bent contracts, footprints and logs were refused in words."""
    kinds = {"contract": _bent_contract, "footprint": _bent_footprint, "log": _bent_log}
    for name, make in kinds.items():
        refused = taken = 0
        for k in range(8 if quick else count // len(kinds)):
            with tempfile.TemporaryDirectory() as folder:
                try:
                    make(np.random.default_rng([9, k]), Path(folder))
                    taken += 1
                except HcbfError as error:
                    refused += 1
                    text = str(error)
                    if not any(
                        word in text for word in ("expected", "missing", "meet", "drive for")
                    ):
                        raise AssertionError(f"{name} {k}: {text}: what was expected?") from error
        yield f"{name}: {refused} refused in words, {taken} taken"


IN_WORDS = ("expected", "missing", "meet", "drive for")
"""One of them stands in each sentence that refuses."""
WRONG = (math.nan, math.inf, -1.0, 0.0, 1e300, "fast", None, [], {}, True, [1.0, 2.0])


SECTIONS = {
    "command": walker_parts.Command,
    "action": walker_parts.Action,
    "body": walker_parts.Body,
    "fall": walker_parts.Fall,
    "physics": walker_parts.Physics,
}
"""Of a contract."""


def _bent_contract(rng: np.random.Generator, folder: Path) -> None:
    data: Any = json.loads((carts.FOLDER / "cart.json").read_text(encoding="utf-8"))
    data["mjcf"] = str(carts.FOLDER / data["mjcf"])
    place, key, kind = data, str(rng.choice(list(data))), Walker
    if isinstance(data[key], dict) and rng.random() < 0.7:
        place, kind = data[key], SECTIONS[key]
        key = str(rng.choice(list(place)))
    how, wrong = rng.integers(3), WRONG[int(rng.integers(len(WRONG)))]
    spare = place is data and not _needed(SECTIONS.get(key, Walker))  # a section
    if (how == 0 and (spare or key not in _needed(kind))) or (how == 2 and spare and wrong == {}):
        _bent_contract(rng, folder)  # that would be whole
        return
    if how == 0:
        del place[key]
    elif how == 1:
        place[f"{key}_"] = place.pop(key)
    else:
        place[key] = wrong
    file = folder / "robot.json"
    file.write_text(json.dumps(data), encoding="utf-8")
    VelocityFilter(file, [HalfPlane("wall", 1, (-1.0, 0.0), -3.0)])


def _needed(kind: type) -> set[str]:
    """Return the keys that a contract, or a section of it, must have."""
    return {
        one.name
        for one in dataclasses.fields(kind)
        if one.default is dataclasses.MISSING and one.default_factory is dataclasses.MISSING
    }


def _bent_footprint(rng: np.random.Generator, folder: Path) -> None:
    angles = np.sort(rng.uniform(0.0, math.tau, 6))
    corners: Any = (rng.uniform(0.2, 0.5, 6) * np.array([np.cos(angles), np.sin(angles)])).T
    how = int(rng.integers(6))
    if how == 0:
        while not _crosses(corners):  # some other order is an outline, too
            corners = corners[rng.permutation(6)]
    elif how == 1:
        corners = corners + rng.uniform(0.6, 2.0, 2)
    elif how == 2:
        corners = corners * (1.0, 0.0)
    elif how == 3:
        corners[int(rng.integers(6)), int(rng.integers(2))] = rng.choice([np.nan, np.inf, 1e4])
    elif how == 4:
        corners = str(corners.tolist())[: int(rng.integers(1, 60))]
    else:
        corners = corners[: int(rng.integers(0, 3))]
    footprint.reach(corners)


def _crosses(corners: Array) -> bool:
    """Return whether two edges of an outline that are no neighbours cross."""
    edges = list(zip(corners, np.roll(corners, -1, axis=0), strict=True))

    def apart(a: Array, b: Array, c: Array, d: Array) -> bool:
        return bool(np.cross(b - a, c - a) * np.cross(b - a, d - a) < 0.0)

    return any(
        apart(*edges[i], *edges[j]) and apart(*edges[j], *edges[i])
        for i in range(len(edges))
        for j in range(i + 2, len(edges) - (i == 0))
    )


def _bent_log(rng: np.random.Generator, folder: Path) -> None:
    rows = np.array(drives.recorded(_drive(), 0), dtype=np.float64)
    how = int(rng.integers(7))
    if how == 0:  # time goes back
        rows[int(rng.integers(20, len(rows))), 0] -= rng.uniform(1.0, 9.0)
    elif how == 1:
        rows[:, 6] = np.degrees(rows[:, 6])
    elif how == 2:
        rows[:, 7] *= rng.uniform(0.2, 0.6)
    elif how == 3:
        rows[:, 3] = 0.5
    elif how == 4:
        rows = rows[: int(rng.integers(0, 200))]
    elif how == 5:
        named = [k for k, name in enumerate(drives.HEADER) if name != "cmd_vy"]
        rows[int(rng.integers(len(rows))), int(rng.choice(named))] = np.inf
    else:
        shifted = np.isfinite(rows[:, 1])
        rows[shifted, 0] += rng.uniform(20.0, 1e6)
    lines = [[None if np.isnan(one) else one for one in row] for row in rows]
    file = drives.write(folder / "drive.csv", lines, differential=True)
    identify_log(file, ROBOTS["cart"].robot.command)


_ROWS: list[Array] = []


def _drive() -> Array:
    """Return the rows of one drive of the shipped cart, driven once."""
    if not _ROWS:
        _ROWS.append(drives.drive(Walker.load("cart"), 0))
    return _ROWS[0].copy()


def main(part: str = "all", quick: bool = False, count: int = 40, robot: str = "cart") -> None:
    """Print what is seen.

    Args:
        part: robots, doors, loops, logs, bent, or all.
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
        "bent": lambda: bent(quick, 15 * count // 2),
    }
    warnings.simplefilter("ignore")
    for name, lines in parts.items():
        if part in ("all", name):
            for line in lines():
                print(f"{name}: {line}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
