"""A family that only this test knows: environments, evaluation and certificates take it."""

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

from hcbf_gym import cli, policies, scenarios, wrappers
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.evaluation.rollouts import Case, evaluate
from hcbf_gym.scenarios import DISC, HALF_PLANE, random_scenes
from hcbf_lab.certification.families import SceneFamily

ID, LIMIT = "HCBF-Regions-v0", 60
POND = f"{Path(__file__).with_name('tarn.py')}:tarn"
SEEN = f"{POND}-seen"


def assert_same_bits(one, other):
    """Nested infos with the same keys, types and bytes."""
    assert set(one) == set(other)
    for key, value in one.items():
        if isinstance(value, dict):
            assert_same_bits(value, other[key])
        else:
            assert (value.dtype, value.shape) == (other[key].dtype, other[key].shape), key
            assert value.tobytes() == other[key].tobytes(), key


def one_of(infos, i):
    return {
        key: one_of(value, i) if isinstance(value, dict) else value[i]
        for key, value in infos.items()
        if not key.startswith("_")
    }


def drive(rng, n):
    return rng.uniform(-4.0, 4.0, (n, 2)).astype(np.float32)


@pytest.mark.parametrize("scenario", [POND, SEEN])
def test_256_environments_are_the_single_ones_bit_for_bit(scenario):
    n, rng = 256, np.random.default_rng(0)
    batch = gym.make_vec(ID, num_envs=n, scenario=scenario, max_episode_steps=LIMIT)
    alone = [gym.make(ID, scenario=scenario, max_episode_steps=LIMIT) for _ in range(n)]
    observation, infos = batch.reset(seed=5)
    for i, env in enumerate(alone):
        expected, info = env.reset(seed=5 + i)
        assert observation[i].tobytes() == expected.tobytes()
        assert_same_bits(one_of(infos, i), info)
    for _ in range(8):
        u = drive(rng, n)
        observation, reward, terminated, truncated, infos = batch.step(u)
        for i, env in enumerate(alone):
            expected, gained, *ends, info = env.step(u[i])
            assert observation[i].tobytes() == expected.tobytes()
            assert reward[i] == gained
            assert [terminated[i], truncated[i]] == ends
            assert_same_bits(one_of(infos, i), info)
    batch.close()


def test_a_filter_decides_in_the_batch_as_alone_though_ranks_change_between_episodes():
    n, rng = 4, np.random.default_rng(2)
    limits = {"max_episode_steps": 20}
    batch = wrappers.VectorSafetyFilter(gym.make_vec(ID, num_envs=n, scenario=POND, **limits))
    single = SyncVectorEnv(
        [lambda: wrappers.SafetyFilter(gym.make(ID, scenario=POND, **limits))] * n
    )
    batch.reset(seed=3)
    single.reset(seed=3)
    ranks = set()
    for _ in range(90):
        u = drive(rng, n)
        assert batch.step(u)[0].tobytes() == single.step(u)[0].tobytes()
        ranks |= {tuple(row) for row in batch.unwrapped.barrier_set.priority.tolist()}
    assert len(ranks) > 1


def test_seeds_decide_the_scenes_and_hooks_what_is_seen():
    env = gym.make(ID, scenario=SEEN)
    assert env.observation_space.shape == (4,)
    first, again, other = (env.reset(seed=seed)[0] for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    _, reward, *_, info = env.step(np.array([1.0, 0.0], dtype=np.float32))
    assert reward == info["reward_own"]
    assert info["costs"].shape == (2,)
    assert "reward_progress" not in info
    scene = gym.make(ID, scenario=POND).unwrapped.scenario
    assert scene.v_max == 0.8
    assert [barrier.name for barrier in scene.barriers][:3] == ["wall 1", "wall 2", "region 1"]


@pytest.mark.parametrize("env", ["HCBF-A1Regions-v0", "HCBF-WalkerRegions-v0"])
def test_robots_take_it_too_with_its_hooks(env):
    made = gym.make(env, scenario=SEEN)
    observation, info = made.reset(seed=0)
    assert observation.shape == made.observation_space.shape == (4,)
    stepped, reward, *_, later = made.step(np.array([1.0, 0.0], dtype=np.float32))
    assert stepped.shape == (4,)
    assert reward == later["reward_own"]
    assert set(info) == set(later)
    assert info["costs"].shape == later["costs"].shape == (2,)


def test_evaluate_runs_on_it_in_other_processes(tmp_path):
    seeds = range(2)
    case = Case(ID, POND, "pd", "lex-cbf-qp", steps=30)
    least = {seed: episode.summary()["min_h"] for _, seed, episode in evaluate([case], seeds)}
    arguments = ["evaluate", "--env", ID, "--scenario", POND, "--episodes", "2", "--steps", "30"]
    cli.main([*arguments, "--program", "lex-cbf-qp", "--workers", "2", "--output", str(tmp_path)])
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert [one["min_h"] for one in summary["episodes"]] == [least[seed] for seed in seeds]


def test_certify_runs_on_it(tmp_path, capsys):
    budget = ["--bound", "0.9", "--confidence", "0.9", "--calibration", "0", "--steps", "150"]
    given = ["--scenes", POND, "--policies", "nearest", "--output", str(tmp_path)]
    cli.main(["certify", "regions", *given, *budget, "--workers", "1"])
    written = json.loads((tmp_path / "regions.json").read_text())
    (scene,) = written["plant"]["scene"]["any of"]
    assert scene == gym.make(ID, scenario=POND).unwrapped.declared["scene"]
    assert scene.startswith("tarn ")
    assert Path(__file__).with_name("tarn.py") in SceneFamily(ID, scenes=((POND, 1.0),)).files


def test_shipped_families_take_a_cap_and_a_number_of_regions():
    scenarios.register("many", random_scenes.draw, shapes=14, v_max=1.5)
    drawn = [scenarios.make("many", np.random.default_rng(seed)) for seed in range(20)]
    assert {scene.v_max for scene in drawn} == {1.5}
    assert {len(scene.barriers) for scene in drawn} == {14}
    assert {barrier.priority for scene in drawn for barrier in scene.barriers} == {1, 2, 3}


def fill(generator, scene):
    scene.shapes[0, :4] = DISC, 2.0, generator.random(), 0.5
    scene.goal[:] = 4.0, 0.0


def test_a_malformed_family_is_refused():
    def half(generator, scene):
        scene.goal[:] = 4.0, 0.0

    def gap(generator, scene):
        fill(generator, scene)
        scene.ranks[:] = 2

    def other(generators, scenes):
        for i, generator in enumerate(generators):
            fill(generator, scenes.one(i))
            scenes.goal[i] += 1e-12

    def pushed(generator, scene):
        fill(generator, scene)
        scene.shapes[0, :4] = HALF_PLANE, 0.0, 1.0, -2.0
        scene.velocities[0] = 0.0, 0.1

    with pytest.raises(InvalidInputError, match="bit for bit"):
        scenarios.register("uneven", fill, shapes=1, draw_many=other)
    for name, draw, expected in (
        ("half", half, "fill all"), ("gap", gap, "without a gap"), ("pushed", pushed, "no velocity")
    ):  # fmt: skip
        scenarios.register(name, draw, shapes=1)
        with pytest.raises(InvalidInputError, match=expected):
            gym.make(ID, scenario=name)
    scenarios.register("few", random_scenes.draw, shapes=4)
    with pytest.raises(InvalidInputError, match="expected 7 or more"):
        scenarios.make("few")
    for taken in ("random", "trolley"):
        with pytest.raises(InvalidInputError, match="not taken"):
            scenarios.register(taken, fill, shapes=1)
    with pytest.raises(UnknownNameError, match="register"):
        scenarios.make(f"{POND}-frozen")
    with pytest.raises(InvalidInputError, match="imported"):
        scenarios.make("nowhere.py:tarn")
    assert policies.PDTracker.for_env(gym.make(ID, scenario=POND)) is not None
