"""What the filter refuses at construction, and what a reset refuses."""

from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

import hcbf_gym
from hcbf_gym import models, wrappers
from hcbf_gym.barriers import Barrier, Jet, LinearClassK, LogClassK
from hcbf_gym.errors import InvalidInputError

ID = "HCBF-Regions-v0"


def single(**options):
    return gym.make(ID, scenario="random", **options)


def native(n=2, **options):
    return gym.make_vec(ID, num_envs=n, scenario="random", **options)


def test_a_held_decision_inside_is_refused_and_the_order_named():
    held = gym.wrappers.RecordEpisodeStatistics(wrappers.HoldAction(single(), 5))
    with pytest.raises(InvalidInputError, match=r"outside: HoldAction\(filtered, 5\)"):
        wrappers.SafetyFilter(held, "lex-cbf-qp")
    joined = wrappers.VectorHoldAction(native(autoreset_mode="Disabled"), 5)
    with pytest.raises(InvalidInputError, match=r"outside: VectorHoldAction\(filtered, 5\)"):
        wrappers.VectorSafetyFilter(joined, "lex-cbf-qp")


@pytest.mark.parametrize(
    "env",
    [
        single(),
        native(),
        wrappers.SafetyFilter(single(), "lex-cbf-qp"),
        wrappers.VectorSafetyFilter(native(), "lex-cbf-qp"),
    ],
    ids=["single", "native", "filtered", "filtered native"],
)
def test_unknown_options_of_a_reset_are_refused_with_the_known_ones(env):
    with pytest.raises(InvalidInputError, match=r"scen.*scenario.*start"):
        env.reset(seed=0, options={"scen": "random"})


@pytest.mark.parametrize("env", ["HCBF-Regions-v0", "HCBF-A1Regions-v0"])
def test_a_wrapper_inside_that_changes_the_actions_is_refused_and_the_order_named(env):
    env = gym.make(env, scenario="random")
    for inside in (
        gym.wrappers.RescaleAction(env, np.float32(-1), np.float32(1)),
        gym.wrappers.RescaleAction(env, np.float32(-2.5), np.float32(2.5)),
        gym.wrappers.TimeAwareObservation(
            gym.wrappers.RescaleAction(env, np.float32(-1), np.float32(1))
        ),
    ):
        with pytest.raises(InvalidInputError, match=r"RescaleAction\(SafetyFilter\(env\), …\)"):
            wrappers.SafetyFilter(inside, "lex-cbf-qp")


def test_a_wrapper_inside_a_native_batch_that_changes_the_actions_is_refused():
    rescaled = gym.wrappers.vector.RescaleAction(native(), np.float32(-1), np.float32(1))
    with pytest.raises(InvalidInputError, match="wrappers change the actions"):
        wrappers.VectorSafetyFilter(rescaled, "lex-cbf-qp")


@pytest.mark.parametrize(
    "options",
    [
        {"program": "lex-cbf-qp", "rows": "usual", "margin": 0.02},
        {"program": "lex-cbf-qp", "guidance": {"kind": "geodesic", "through": 2}},
        {"program": "h-cbf-qp", "solver": "clarabel", "gamma0": 5.0, "delta_gamma": 1.3},
        {"program": "r-cbf-qp", "gamma0": [3.0, 2.0], "epsilon": "known", "lambda_u": 0.5},
        {"program": "lex-cbf-qp", "weights": [None, 10.0], "alpha1": LogClassK(1.0, 0.4, 0.2)},
        {"program": "eh-cbf-qp", "alpha1": 3.0, "alpha2": LinearClassK(4.0)},
    ],
)
def test_every_argument_of_the_filter_goes_through_json(options):
    env = wrappers.SafetyFilter(single(), **options)
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    steps = []
    for each in (env, again):
        each.reset(seed=3)
        steps.append([each.step(np.array([4.0, -2.0], np.float32)) for _ in range(20)][-1])
    np.testing.assert_array_equal(steps[0][0], steps[1][0])
    for key, value in steps[0][4]["safety_filter"].items():
        np.testing.assert_array_equal(value, steps[1][4]["safety_filter"][key])


def test_a_step_before_the_first_reset_is_refused():
    for env in (single().unwrapped, native()):
        with pytest.raises(InvalidInputError, match="reset"):
            env.step(np.zeros(env.action_space.shape))


@dataclass(frozen=True)
class Ahead(Barrier):
    """x ≤ edge; two of them cannot be compared, as NumPy gives no truth to two booleans."""

    edge: np.ndarray

    def jet(self, x, t=0.0):
        gradient = np.array([-1.0, 0.0, 0.0, 0.0])
        return Jet(self.edge[0] - x[0], gradient, np.zeros((4, 4)), 0.0, np.zeros(4), 0.0)


def test_a_reader_may_return_other_barriers_in_every_step():
    env = single()
    plant = hcbf_gym.Plant(
        model=models.DoubleIntegrator(),
        barriers=lambda env, observation, info: [Ahead("ahead", 1, env.rom_state[:2] + 5.0)],
        state=lambda env, observation, info: env.rom_state,
        period=0.02,
    )
    env = wrappers.SafetyFilter(env, "lex-cbf-qp", plant=plant)
    env.reset(seed=0)
    for _ in range(3):
        *_, info = env.step(np.array([1.0, 0.0]))
        assert info["safety_filter"]["status"] == 0


def test_the_native_batch_gives_a_picture_of_each_environment():
    env = native(3, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.full((3, 2), 2.0))
    frames = env.render()
    assert isinstance(frames, tuple)
    assert [frame.dtype for frame in frames] == [np.uint8] * 3
    assert len({frame.shape for frame in frames}) == 1
    assert frames[0].shape[2] == 3
    assert all(frame.std() > 5.0 for frame in frames)
    assert not np.array_equal(frames[0], frames[1])  # another scene
    env.close()


@pytest.mark.parametrize("plants", [0, 1, 2, 4])
def test_a_set_that_becomes_one_of_other_plants_is_refused_in_words(plants):
    env = wrappers.VectorSafetyFilter(
        gym.make_vec("HCBF-Regions-v0", num_envs=3, scenario="random")
    )
    env.reset(seed=0)
    scene = env.unwrapped.barrier_set
    scene.kind = np.repeat(scene.kind[:1], plants, axis=0)
    with pytest.raises(InvalidInputError, match="for 3 plants"):
        env.step(np.zeros((3, 2), dtype=np.float32))


def test_single_environments_that_are_joined_are_refused_with_the_remedy():
    joined = gym.make_vec("HCBF-Regions-v0", num_envs=2, vectorization_mode="sync")
    with pytest.raises(InvalidInputError, match="put a SafetyFilter on each"):
        wrappers.VectorSafetyFilter(joined)


@pytest.mark.parametrize("states", [2, 5])
def test_weights_of_another_number_of_states_are_refused(states):
    envs = gym.make_vec("HCBF-Regions-v0", num_envs=3, scenario="random")
    with pytest.raises(InvalidInputError, match=f"{states} states, expected 3"):
        wrappers.VectorSafetyFilter(envs, "h-cbf-qp", gamma0=np.ones((states, 2)))
