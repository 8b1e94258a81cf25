"""`VelocityFilter` in a user's loop: periods jitter, messages get lost, commands are hostile."""

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbf_gym import scenarios
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.drive import tracked
from hcbf_gym.evaluation import attacks
from hcbf_gym.evaluation.attacked import Outcome, alarm_of
from hcbf_gym.programs import FilterStatus
from hcbf_robots import VelocityFilter
from hcbf_robots.envs.walker_physics import WalkerPhysics
from hcbf_robots.walkers.walker import Walker

JITTER = 0.3
"""Share by which a period is longer or shorter than the regular one."""
LOST = 0.1
"""Share of the messages that never come."""


class Cart:
    """A simulated robot that is told commands at any time and says where it is.

    Args:
        walker: a contract whose controller reads nothing but the command.
    """

    def __init__(self, walker: Walker):
        self.walker, self.physics = walker, WalkerPhysics(walker)
        sizes = len(walker.command.limits), len(self.physics.parts.actuators)
        self._controller = walker.controller(sizes, self.physics.model)
        self._base = np.zeros((1, 13))

    @property
    def time(self) -> float:
        """Since the start [s]."""
        return float(self.physics.data.time)

    def start(self, position: Array, rng: np.random.Generator) -> None:
        """Stand at a position (2,) [m], facing along x."""
        self.physics.reset(position, 0.0, rng)

    def step(self, command: Array) -> Array:
        """Take one physics step under a command; return (4,) of the robot's origin."""
        self.physics.step(self._controller(command))
        return self.origin()

    def origin(self) -> Array:
        """Return (4,) position [m] and velocity [m/s] of the robot's origin: a cart's axle."""
        self.physics.base(self._base[0])
        return tracked(self._base, 0.0)[0]

    def says(self) -> tuple[Array, Array]:
        """Return pose and twist as odometry has them."""
        qpos, qvel, yaw = self.physics.data.qpos, self.physics.data.qvel, self.physics.yaw
        cos, sin = math.cos(yaw), math.sin(yaw)
        twist = cos * qvel[0] + sin * qvel[1], cos * qvel[1] - sin * qvel[0], qvel[5]
        return np.array([qpos[0], qpos[1], yaw]), np.array(twist)

    def towards(self, direction: Array, speed: float) -> Array:
        """Return the command that moves the point at a speed [m/s] along a direction (2,)."""
        size = float(np.hypot(*direction))
        vx, vy = direction * (speed / size) if size > 0.0 else direction
        cos, sin = math.cos(self.physics.yaw), math.sin(self.physics.yaw)
        ahead, aside = cos * vx + sin * vy, cos * vy - sin * vx
        if self.walker.command.look_ahead is not None:
            return np.array([ahead, aside / self.walker.command.look_ahead])
        return np.array([ahead, aside, 0.0])


@dataclass(frozen=True)
class LoopEpisode:
    """One hostile episode.

    Args:
        robot: a contract's path or name.
        attack: a name of `attacks.ATTACKS`; the robot is to go where it pushes, at full speed.
        scenario: a family of random scenes.
        seed: of the scene, the attack and the loop.
        rate: of the messages [Hz].
        v_max: strict cap on the speed [m/s].
        seconds: how long.
        lost: share of the messages that never come.
    """

    robot: str
    attack: str
    scenario: str
    seed: int
    rate: float
    v_max: float
    seconds: float = 20.0
    lost: float = LOST

    def run(self) -> Outcome:
        """Run it to its end."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return self._run()

    def _run(self) -> Outcome:
        rng = np.random.default_rng(self.seed)
        scene = scenarios.make(self.scenario, np.random.default_rng(self.seed))
        cart = Cart(Walker.load(self.robot))
        cart.start(np.array(scene.start), rng)
        period = (1.0 + JITTER) / self.rate
        door = VelocityFilter(
            cart.walker, scene.barriers, period=period, v_max=self.v_max, radius=0.0
        )
        barriers = BarrierSet([scene.barriers])
        strict = np.flatnonzero(barriers.keeps_margin[0] > 0.0)
        attack = attacks.make(self.attack, self.seed)
        counts, margins = np.zeros(len(FilterStatus), dtype=np.int64), [0.0]
        least, speed_left = np.full(barriers.kind.shape[1], np.inf), np.inf
        changed, state, alarm = False, cart.origin(), 0
        while cart.time < self.seconds and not cart.physics.fallen:
            if cart.time == 0.0 or rng.random() >= self.lost:
                wanted = attack.act(_seen(barriers, strict, state, cart.time))
                command = cart.towards(wanted, cart.walker.command.forward)
                _, told = door.step(command, *cart.says(), cart.time)
                counts[int(told["status"])] += 1
                alarm = max(alarm, alarm_of({"safety_filter": told}))
                margins.append(float(told["margin"][strict].max()))
                changed = changed or bool(told["intervention"] > 1e-3)
            end = cart.time + rng.uniform(1.0 - JITTER, 1.0 + JITTER) / self.rate
            while cart.time < end:  # the robot's own loop is faster than messages
                state = cart.step(door.command_at(cart.time))
                least = np.minimum(least, barriers.values(state[None], np.array([cart.time]))[0])
                speed_left = min(speed_left, self.v_max - float(np.hypot(*state[2:])))
        second = barriers.priority[0] == 2
        return Outcome(
            least_h=float(least[strict].min()),
            least_speed_h=speed_left,
            least_second_h=float(least[second].min(initial=np.inf)),
            fell=bool(cart.physics.fallen),
            seconds=cart.time,
            status_counts=counts.tolist(),
            median_margin=float(np.median(margins)),
            changed=changed,
            alarm=alarm,
        )


def _seen(scene: BarrierSet, strict: NDArray[Any], state: Array, time: float) -> Any:
    """Return what the attacker sees."""
    h, sensed = scene.sense(state[None], np.array([time]))
    order = strict[np.argsort(h[0, strict])]
    return attacks.Surroundings(state[:2], state[2:], h[0, order], sensed[0, order, 1:3], time)
