"""Robots that follow late, commanded by the environments' adapter, which turns them as they go."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import Estimate, Plant, models
from hcbf_gym.barriers import HalfPlane, SpeedLimit, braking
from hcbf_gym.models import Box
from hcbf_gym.wrappers import SafetyFilter
from hcbf_robots import Command
from hcbf_robots.walkers.walker_adapter import Adapter
from hcbf_robots.walkers.walker_margins import braked, speed_row, stops, uncertainty
from hcbf_robots.walkers.walker_parts import HEADINGS
from tests.online.followers import Lagged
from tests.online.test_measured import EXACT

PERIOD = 0.02
WALLS = [
    HalfPlane("above", 1, normal=(0.0, -1.0), offset=-1.2),
    HalfPlane("ahead", 1, normal=(-1.0, 0.0), offset=-1.5),
]


class Late(gym.Env):
    """A robot that the adapter commands, as an environment of walkers does."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (4,))
    action_space = gym.spaces.Box(-5.0, 5.0, (2,), dtype=np.float64)

    def __init__(self, command, response, input_set):
        able = braking.weakest(input_set)
        self._adapter = Adapter(command, response, able, PERIOD, "velocity")
        self._response = response

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        yaw, response = self.np_random.uniform(-3.0, 3.0), self._response
        self._driven = Lagged(
            (0.0, 0.0, yaw), response.time_constant, response.delay, response.braking
        )
        self._velocity = np.zeros(2)
        self._adapter.reset(yaw)
        return np.zeros(4, np.float32), {}

    def step(self, action):
        self._velocity = self._velocity + PERIOD * np.asarray(action)
        yaw = self._driven.pose[2]
        reported = self._adapter.command(*self._velocity, yaw, self._driven.velocity[2])
        self.nearest = min(
            min(1.5 - x, 1.2 - y) for x, y in self._driven.drive(np.array(reported), PERIOD)
        )
        return np.zeros(4, np.float32), 0.0, False, False, {}

    def seen(self, observation, info):
        x, y, yaw = self._driven.pose
        ahead, aside, _ = self._driven.velocity
        cos, sin = math.cos(yaw), math.sin(yaw)
        body = np.array([cos * ahead - sin * aside, sin * ahead + cos * aside])
        state = np.array([x, y, *self._velocity])
        return Estimate(state, None, None, state, np.array([0.0, 0.0, *(body - self._velocity)]))


@pytest.mark.parametrize(
    ("speed", "lag", "delay", "stopping", "turn", "seed"),
    [
        (1.0, 0.3, 0.02, 2.0, 4.0, 0),
        (1.0, 0.3, 0.1, 2.0, 4.0, 1),
        (1.5, 0.3, 0.1, 4.0, 4.0, 2),
        (0.8, 0.3, 0.1, 4.0, 4.0, 3),
    ],
)
def test_who_follows_late_stays_out_of_a_corner(speed, lag, delay, stopping, turn, seed):
    command = Command(speed, turn, sideways=speed)
    response = replace(EXACT, time_constant=lag, delay=delay, braking=stopping)
    input_set, reserved = braked(Box.symmetric(5.0), response), uncertainty(response, PERIOD)
    env = Late(command, response, input_set)
    plant = Plant(
        models.DoubleIntegrator(),
        [*WALLS, SpeedLimit("cap", 1, speed_row(speed, reserved.speed, True))],
        lambda env, observation, info: env.seen(observation, info),
        input_set,
        period=PERIOD,
        uncertainty=reserved,
        braking=stops(response, speed, input_set),
    )
    safe, rng = SafetyFilter(env, plant=plant), np.random.default_rng(seed)
    for episode in range(6):
        safe.reset(seed=6 * seed + episode)
        wanted = np.zeros(2)
        for _ in range(800):
            if rng.random() < 0.03:
                wanted = rng.choice([-5.0, 5.0], 2)
            if rng.random() < 0.02:
                wanted = 5.0 * rng.uniform(-0.3, 1.0, 2)
            safe.step(wanted)
            assert env.nearest > 0.0, episode


@pytest.mark.parametrize("heading", HEADINGS)
def test_a_turn_is_no_faster_than_velocity_follows(heading):
    response = replace(EXACT, time_constant=0.3, delay=0.1)
    command = Command(1.5, 4.0, sideways=1.0)
    adapter, rng = Adapter(command, response, 2.0, 0.1, heading), np.random.default_rng(0)
    most, last = min(0.25 / 1.5 / 0.5, 0.5 * 2.0 / 1.5), 0.0
    fastest = 0.0
    for _ in range(200):
        adapter.turn = rng.uniform(-9.0, 9.0)
        _, _, rate = adapter.command(*rng.uniform(-1.5, 1.5, 2), rng.uniform(-3.0, 3.0), last)
        assert abs(rate) <= most + 1e-12
        assert abs(rate - last) <= 0.25 / 1.5 / 0.5 * 0.1 / 0.5 + 1e-12
        last, fastest = rate, max(fastest, abs(rate))
    assert fastest > 0.5 * most
