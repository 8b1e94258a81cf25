"""Faults between command and motion that a test puts into a drive, and an episode of one."""

import itertools
import math
from collections import deque
from functools import partial

import gymnasium as gym
import numpy as np

from hcbf_gym import wrappers
from hcbf_gym.evaluation.attacked import alarm_of, policy_of
from hcbf_gym.evaluation.episode import samples

LENGTH = 1000
"""Steps of an episode with a fault, 20 s; undisturbed ones take what time slow robots have."""


def late(seconds, first, period=0.02):
    """Return a function of values that returns the value of some time ago [s]."""
    waiting = deque([first] * round(seconds / period))

    def past(value):
        waiting.append(value)
        return waiting.popleft()

    return past


def following(drive, change):
    """Let the controller of a walker get a change of the command."""
    act = drive.act

    def changed():
        commanded = drive.command.copy()
        drive.command[:] = change(commanded)
        act()
        drive.command[:] = commanded

    drive.act = changed


def follows(share):
    return partial(following, change=lambda u: share * u)


def follows_late(drive, seconds):
    period = drive.simulation.walker.period
    following(drive, late(seconds, np.zeros(len(drive.command)), period))


def floor(drive, friction):
    model = drive.simulation.model
    model.geom_friction[model.geom("floor").id, 0] = friction


def compass(drive, off):
    plain = type(drive.simulation)

    class Turned(plain):
        @property
        def yaw(self):
            return plain.yaw.fget(self) + off

    drive.simulation.__class__ = Turned


def scaled_odometry(drive, share):
    """Let odometry count a share of the path and of the velocity; 0 is dead."""
    plain, start = drive.odometry, drive.truth.copy()
    start[2:] = 0.0

    def scaled():
        body, yaw = plain()
        return start + share * (body - start), yaw

    drive.odometry = scaled


def late_odometry(drive, seconds):
    """Let odometry be late, with fresh stamps."""
    plain = drive.odometry
    past = late(seconds, plain())

    def delayed():
        body, yaw = plain()
        return past((body.copy(), yaw))

    drive.odometry = delayed


def acting(drive, change):
    """Change the k-th action, as a wrapper inside does that keeps the space."""
    hold, count = drive.hold, itertools.count()
    drive.hold = lambda u, *rest: hold(change(next(count), u), *rest)


def late_actions(drive, seconds):
    past = late(seconds, np.zeros(2))
    acting(drive, lambda k, u: past(u))


def known_as(walker, change):
    """Let the A1 know another position, by its start and the true one."""
    plain, start = walker.estimate, walker.truth[:2].copy()

    def wrong(time):
        estimate = plain(time)
        x, lag = estimate.x.copy(), estimate.lag.copy()
        x[:2] = change(start, x[:2])
        lag[:2] += x[:2] - estimate.x[:2]
        return estimate._replace(x=x, lag=lag)

    walker.estimate = wrong


def late_position(walker, seconds):
    past = late(seconds, walker.truth[:2].copy())
    known_as(walker, lambda start, now: past(now.copy()))


def slippery(walker, friction):
    """Let the A1's feet find less friction than is declared."""
    simulation = walker.simulation
    simulation.model.geom_friction[simulation._feet, 0] = friction


def late_torques(walker, seconds):
    waiting = walker.simulation._delayed
    for _ in range(round(seconds / walker.simulation.model.opt.timestep) - len(waiting)):
        waiting.appendleft(waiting[0].copy())


def turned(k, u, by=1.2):
    cos, sin = math.cos(by), math.sin(by)
    return np.array([cos * u[0] - sin * u[1], sin * u[0] + cos * u[1]])


ACTING = {
    "every third action reversed": partial(acting, change=lambda k, u: -u if k % 3 == 0 else u),
    "actions times .5": partial(acting, change=lambda k, u: 0.5 * u),
}
FAULTS = {
    "cart": {
        "dead odometry": partial(scaled_odometry, share=0.0),
        "half odometry": partial(scaled_odometry, share=0.5),
        "odometry 500 ms late": partial(late_odometry, seconds=0.5),
        "does not move": follows(0.0),
        "follows by half": follows(0.5),
        "follows 1.5 times": follows(1.5),
        "reverses": follows(-1.0),
        "follows 500 ms late": partial(follows_late, seconds=0.5),
        "floor .03": partial(floor, friction=0.03),
        "floor .1": partial(floor, friction=0.1),
        "compass off by 1.2": partial(compass, off=1.2),
        **ACTING,
    },
    "a1": {
        "dead position": partial(known_as, change=lambda start, now: start),
        "half the position": partial(known_as, change=lambda start, now: 0.5 * (start + now)),
        "position 500 ms late": partial(late_position, seconds=0.5),
        "torques 16 ms late": partial(late_torques, seconds=0.016),
        "floor .1": partial(slippery, friction=0.1),
        "floor .3": partial(slippery, friction=0.3),
        "compass off by 1.2": partial(acting, change=turned),
        "actions 200 ms late": partial(late_actions, seconds=0.2),
        **ACTING,
    },
}


def drive(robot, fault, attack, seed):
    """Return after which steps an episode enters and alarms (∞: never), and the alarm's reason."""
    ids = ("HCBF-A1Regions-v0", {}), ("hcbf_robots:HCBF-WalkerRegions-v0", {"robot": robot})
    env_id, options = ids[robot != "a1"]
    env = gym.make(env_id, scenario="random", disable_env_checker=True, **options)
    env = wrappers.SafetyFilter(env, on_alarm="warn")
    walk = samples(env, policy_of(attack, env, seed), seed)
    inner, info = env.unwrapped, next(walk).info
    strict = [j for j, b in enumerate(inner.barriers) if b.priority == 1 and b.reads_position]
    assert info["min_h"][strict].min() >= 0.0
    if fault is not None:
        FAULTS[robot][fault](inner.drive)
    entered = alarmed = math.inf
    reason = 0
    steps = itertools.islice(walk, None if fault is None else LENGTH)
    for step, (_, info, *_) in enumerate(steps, 1):
        if alarm_of(info) and alarmed == math.inf:
            alarmed, reason = step, alarm_of(info)
        if info["min_h"][strict].min() < 0.0:
            entered = min(entered, step)
    env.close()
    return entered, alarmed, reason
