"""A robot's own loop behind `VelocityFilter`, as a node runs it: robots, planners, links.

A walker in MuJoCo drives in it; odometry comes as often and as late as its `Link` lets it.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from hcbf_gym._core import FIRST_ALARM
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, ConvexPolygon, HalfPlane
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.programs import FilterStatus
from hcbf_robots import Command, VelocityFilter
from hcbf_robots.identification.identify import Runner
from hcbf_robots.walkers import Walker

PERIOD = 0.05  # Of the commands [s]
START = 100.0  # On the robot's clock [s]
LONGEST = math.ceil(PERIOD / CONTROL_DT) * CONTROL_DT
"""From one command to the next, as robots look for one at every control step [s]."""
Planner = Callable[[Array], Array]  # Pose (3,) → command (k,)


class Moving:
    """A simulated walker."""

    def __init__(self, walker: Walker, start: Array, seed: int = 0):
        self._runner, self.fallen = Runner(walker, seed), False
        rng = np.random.default_rng(seed)
        self._runner.drive.reset(start[:2], float(start[2]), BarrierSet([()]), rng)
        self._look()

    def go(self, command: Array) -> None:
        """Follow a command for one control step."""
        self.fallen |= self._runner.hold(command, CONTROL_DT).falls > 0
        self._look()

    def _look(self) -> None:
        """Take pose and twist, as the filter gets them."""
        simulation = self._runner.drive.simulation
        data, yaw = simulation.data, simulation.yaw
        cos, sin = math.cos(yaw), math.sin(yaw)
        vx, vy = data.qvel[:2]
        self.pose = np.array([*data.qpos[:2], yaw])
        self.twist = np.array([cos * vx + sin * vy, cos * vy - sin * vx, data.qvel[5]])


class Link(NamedTuple):
    """The connection of a robot's odometry and the filter."""

    rate: float = 50.0  # of odometry [Hz]
    late: float = 0.0  # how old it is when it comes [s]
    jitter: float = 0.0  # share by which that varies
    lost: float = 0.0  # share that never comes
    burst: int = 1  # how many are lost together


class Rig(NamedTuple):
    """What is around a robot, and between it and the filter."""

    reach: float  # radius of the circle that must stay outside [m]
    link: Link = Link()
    walls: Sequence[Barrier] | None = None  # what is there; None for what the filter knows
    # called at every control step with the time [s], before the filter
    sees: Callable[[float, "Moving"], None] = lambda now, robot: None


class Driven(NamedTuple):
    """What a loop showed."""

    path: Array  # (k, 3) poses at every control step
    least: float  # the least distance of the robot's circle from a strict region [m]
    statuses: Array  # (6,) how often each was reported
    alarms: set[int]  # reasons from the first alarm on
    fell: bool  # whether the robot fell, where the loop ends


def loop(
    safe: VelocityFilter,
    robot: Moving,
    planner: Planner,
    seconds: float,
    seed: int,
    rig: Rig,
    until: Callable[[Array], bool] = lambda pose: False,
) -> Driven:
    """Run a robot's own loop, as a node runs it: regular commands, odometry as it comes.

    The seed decides what is lost and late; `until` returns whether a pose has arrived.
    """
    rng, link = np.random.default_rng(seed), rig.link
    regions = BarrierSet([safe.barriers if rig.walls is None else rig.walls])
    strict = (regions.priority[0] == 1) & (regions.kind[0] != 100)
    waiting: list[tuple[float, float, Array, Array]] = []
    newest: tuple[float, Array, Array] | None = None
    path, alarms = [], set[int]()
    statuses, least, dropped = np.zeros(len(FilterStatus), dtype=int), np.inf, 0
    sent = commanded = -np.inf
    for k in range(round(seconds / CONTROL_DT)):
        now = START + CONTROL_DT * k
        rig.sees(now, robot)
        if now - sent >= 1.0 / link.rate - 1e-9:
            sent = now
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
            _, report = safe.step(planner(newest[1]), newest[1], newest[2], newest[0], now)
            statuses[int(report["status"])] += 1
            if report["reason"] >= FIRST_ALARM:
                alarms.add(int(report["reason"]))
        robot.go(safe.command_at(now))
        path.append(robot.pose)
        x = np.array([[*robot.pose[:2], 0.0, 0.0]])
        h = regions.values(x, np.array([CONTROL_DT * (k + 1)]))[0]
        least = min(least, float(h[strict].min(initial=np.inf)) - rig.reach)
        if robot.fallen or until(robot.pose):
            break
    return Driven(np.array(path), least, statuses, alarms, robot.fallen)


def hostile(
    barriers: Sequence[Barrier], command: Command, rng: np.random.Generator, *, wanders: bool = True
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
