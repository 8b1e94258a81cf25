"""A vector environment of one's own under `VectorSafetyFilter`: its plants are single ones."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv

import hcbf_gym
from hcbf_gym import models
from hcbf_gym.barriers import Disc, SpeedLimit
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models import Box
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter

PERIOD, N, LENGTH = 0.02, 6, 7
U = Box.symmetric(5.0)


def scene(i):
    return [
        Disc("strict", 1, center=(1.0 + 0.1 * i, 0.2), radius=0.4),
        Disc("soft", 2, center=(0.5, -0.1 * i), radius=0.3),
        SpeedLimit("cap", 1, 1.5),
    ]


def moved(x, u):
    after = x.copy()
    after[..., :2] += PERIOD * x[..., 2:] + 0.5 * PERIOD**2 * u
    after[..., 2:] += PERIOD * u
    return after


class Batch(VectorEnv):
    """N double integrators that begin anew after so many steps each, in their own scenes."""

    def __init__(self, mode=AutoresetMode.NEXT_STEP):
        self.num_envs = N
        self.metadata = {"autoreset_mode": mode}
        self.single_action_space = gym.spaces.Box(-5.0, 5.0, (2,), np.float64)
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, N)
        self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, (4,), np.float64)
        self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, N)
        self.scenes = [scene(i) for i in range(N)]
        self.hidden = np.zeros(N, dtype=bool)

    def start(self, mask):
        self.x[mask] = np.column_stack(
            [np.zeros((N, 2)), np.linspace(-0.5, 0.5, 2 * N).reshape(N, 2)]
        )[mask]
        self.steps[mask] = 0

    def reset(self, *, seed=None, options=None):
        self.x, self.steps = np.zeros((N, 4)), np.zeros(N, dtype=int)
        self.over = np.zeros(N, dtype=bool)
        self.start(np.ones(N, dtype=bool))
        return self.x.copy(), {}

    def step(self, actions):
        again = (
            self.over if self.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP else ~self.over
        )
        going = ~again if self.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP else again
        self.x[going] = moved(self.x, actions)[going]
        self.steps[going] += 1
        over = (self.steps >= LENGTH + np.arange(N)) & going
        info = {}
        if self.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP:
            self.start(self.over)
            self.over = over
        else:
            if over.any():
                info = {"final_obs": self.x.copy(), "final_info": {}, "_final_info": over}
            self.start(over)
        return self.x.copy(), np.zeros(N), over, np.zeros(N, dtype=bool), info


def seen(env, *_):
    return np.where(env.hidden[:, None], np.nan, env.x)


def plant(barriers=lambda env, *_: env.scenes, state=seen, **fields):
    return hcbf_gym.Plant(models.DoubleIntegrator(), barriers, state, U, period=PERIOD, **fields)


class One(gym.Env):
    """Plant i of the batch, alone."""

    def __init__(self, i):
        self.i, self.whole = i, Batch()
        self.action_space = self.whole.single_action_space
        self.observation_space = self.whole.single_observation_space
        self.plant = plant(scene(i), lambda env, *_: env.x.copy())

    def reset(self, *, seed=None, options=None):
        self.whole.reset()
        self.x = self.whole.x[self.i].copy()
        return self.x.copy(), {}

    def step(self, action):
        self.x = moved(self.x, action)
        return self.x.copy(), 0.0, False, False, {}


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("threads", [1, 2])
def test_each_plant_is_filtered_as_alone_and_begins_anew(mode, threads):
    envs = VectorSafetyFilter(Batch(mode), plant=plant(), threads=threads)
    envs.reset()
    singles = [SafetyFilter(One(i)) for i in range(N)]
    for one in singles:
        one.reset()
    rng, begun = np.random.default_rng(0), 0
    for _ in range(40):
        actions = rng.uniform(-5.0, 5.0, (N, 2))
        skipped = envs.unwrapped.over.copy()  # NEXT_STEP begins these anew, whatever the action is
        observation, _, ended, _, info = envs.step(actions)
        reported = info["safety_filter"]
        for i, one in enumerate(singles):
            if not skipped[i]:
                own, *_, answers = one.step(actions[i])
                answers = answers["safety_filter"]
                if ended[i] and mode is AutoresetMode.SAME_STEP:
                    final = info["final_info"]["safety_filter"]
                    np.testing.assert_array_equal(final["u_safe"][i], answers["u_safe"])
                    _, answers = one.reset()
                    answers, begun = answers["safety_filter"], begun + 1
                    own = one.unwrapped.x
                np.testing.assert_array_equal(observation[i], own)
            else:
                _, answers = one.reset()
                answers, begun = answers["safety_filter"], begun + 1
            for key, value in answers.items():
                np.testing.assert_array_equal(reported[key][i], value, err_msg=key)
    assert begun >= 15


@pytest.mark.parametrize(
    "barriers", [scene(0), [scene(i) for i in range(N)], lambda *_: [scene(i) for i in range(N)]]
)
def test_barriers_may_be_a_list_for_all_a_list_each_or_a_reader(barriers):
    envs = VectorSafetyFilter(Batch(), plant=plant(barriers))
    envs.reset()
    *_, info = envs.step(np.ones((N, 2)))
    assert info["safety_filter"]["h"].shape == (N, 3)
    assert (info["safety_filter"]["reason"] == 0).all()
    assert [one.name for one in envs.conditions] == ["strict", "soft", "cap"]


def test_actions_are_translated_both_ways():
    half = plant(to_action=lambda u: 0.5 * u, from_action=lambda a: 2.0 * np.asarray(a))
    envs, plain = (
        VectorSafetyFilter(Batch(), plant=half),
        VectorSafetyFilter(Batch(), plant=plant()),
    )
    for each in (envs, plain):
        each.reset()
    *_, info = envs.step(np.full((N, 2), 0.5))
    *_, other = plain.step(np.full((N, 2), 1.0))
    np.testing.assert_array_equal(info["safety_filter"]["u_safe"], other["safety_filter"]["u_safe"])


def test_another_batch_is_refused_in_words():
    with pytest.raises(InvalidInputError, match="brings no plant"):
        VectorSafetyFilter(Batch())
    silent = Batch()
    silent.metadata = {}
    with pytest.raises(InvalidInputError, match="autoreset_mode"):
        VectorSafetyFilter(silent, plant=plant())
    unicycle = hcbf_gym.Plant(models.Unicycle(), scene(0), seen, U, period=PERIOD)
    with pytest.raises(InvalidInputError, match="Unicycle"):
        VectorSafetyFilter(Batch(), plant=unicycle)
