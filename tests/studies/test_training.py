"""Training, its checkpoints, and the policies that come out of it."""

import json
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from needs import remedy

pytest.importorskip("stable_baselines3", reason=remedy("stable_baselines3"))

from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback, CallbackList
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecNormalize

from hcbf_gym import policies, wrappers
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.policies import learned
from hcbf_gym.training import TrainingConfig, checkpoint, command, train
from hcbf_gym.training.callbacks import LearnFromFiltered
from hcbf_gym.training.config import make_env, make_model, make_vector
from hcbf_gym.training.export import export
from hcbf_gym.wrappers import VectorHoldAction
from hcbf_gym.wrappers.sb3 import Sb3VecEnv

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:stable_baselines3")

TINY = {
    "ppo": TrainingConfig(steps=4 * 64 * 8, num_envs=8, report_every=512, report_episodes=4),
    "sac": TrainingConfig("sac", steps=160, num_envs=8, report_every=56, report_episodes=4),
}


def make_single():
    return wrappers.SafetyFilter(gym.make("HCBF-Regions-v0", scenario="random"), "lex-cbf-qp")


def make_native():
    return Sb3VecEnv(make_vector("random", 2, "lex-cbf-qp"))


@pytest.mark.parametrize(
    ("algorithm", "make"),
    [
        (PPO, lambda: DummyVecEnv([make_single] * 2)),
        (PPO, lambda: SubprocVecEnv([make_single] * 2, start_method="spawn")),
        (PPO, make_native),
        (SAC, make_native),
    ],
    ids=["dummy", "subprocess", "native", "SAC"],
)
def test_sb3_learns_on_it_and_a_reloaded_policy_acts_identically(algorithm, make, tmp_path):
    env = make()
    options = {"n_steps": 16, "batch_size": 16} if algorithm is PPO else {"learning_starts": 8}
    model = algorithm("MlpPolicy", env, seed=0, device="cpu", **options)
    model.learn(32)
    model.save(tmp_path / "model")
    observation = env.reset()
    again = algorithm.load(tmp_path / "model", device="cpu")
    for deterministic in (True, False):
        set_random_seed(1)
        action, _ = model.predict(observation, deterministic=deterministic)
        set_random_seed(1)
        np.testing.assert_array_equal(
            action, again.predict(observation, deterministic=deterministic)[0]
        )
    env.close()


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3"])
def test_an_exported_policy_acts_as_the_model_does(algorithm, tmp_path):
    config = TrainingConfig(algorithm, num_envs=4)
    env = make_env(config)
    model = make_model(config, env, None)
    rng = np.random.default_rng(0)
    env.obs_rms.mean, env.obs_rms.var = rng.normal(size=36), rng.uniform(0.5, 2.0, 36)
    env.training = False
    observation = env.reset()
    export(model, env, {}).save(tmp_path / "policy.npz")
    single = gym.make("HCBF-Regions-v0", scenario="random")
    policy = policies.load(tmp_path / "policy.npz", single)
    expected, _ = model.predict(observation, deterministic=True)
    acted = policy(env.get_original_obs(), {})
    np.testing.assert_allclose(acted / 5.0, expected, atol=1e-5)
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(policy(env.get_original_obs()[0], {}), acted[0])


def test_an_exported_policy_ignores_what_never_varied_in_training():
    config = TrainingConfig(num_envs=4)
    env = make_env(config)
    model = make_model(config, env, None)
    env.reset()
    for _ in range(20):
        env.step(np.full((4, 2), 0.5))
    policy = export(model, env, {})
    observation = env.get_original_obs()
    moving, elsewhere = observation.copy(), observation.copy()
    moving[:, 11::4] += 0.2  # the regions' own motion
    elsewhere[:, 8::4] += 0.2
    np.testing.assert_array_equal(policy(moving, {}), policy(observation, {}))
    assert not np.allclose(policy(elsewhere, {}), policy(observation, {}))


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_killed_run_continues_from_its_checkpoint_as_if_nothing_had_happened(algorithm, tmp_path):
    config = TINY[algorithm]
    whole = train(config, tmp_path / "whole")

    def kill(steps, curve):
        if len(curve) == 2 and steps > curve[-1]["steps"]:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(config, tmp_path / "killed", show=kill)
    train(config, tmp_path / "killed", resume=True)
    models = []
    for name in ("whole", "killed"):
        found = checkpoint.find(tmp_path / name)
        assert found is not None
        model, curve = checkpoint.resume(found, config, None)
        assert model.num_timesteps == curve[-1]["steps"] >= config.total_steps
        models.append((model.get_parameters()["policy"], curve))
    for key, value in models[0][0].items():
        np.testing.assert_array_equal(value.numpy(), models[1][0][key].numpy())
    for one, other in zip(models[0][1], models[1][1], strict=True):
        assert one | {"seconds_spent": 0.0} == other | {"seconds_spent": 0.0}
    assert len(whole.weights) == 3
    curve = json.loads((tmp_path / "killed/training.json").read_text(encoding="utf-8"))["curve"]
    assert [point["steps"] for point in curve] == [point["steps"] for point in models[0][1]]


def test_a_checkpoint_of_another_run_is_refused(tmp_path):
    config = replace(TINY["ppo"], steps=512)
    train(config, tmp_path)
    with pytest.raises(InvalidInputError, match="gamma"):
        train(replace(config, gamma=0.9), tmp_path, resume=True)
    state = tmp_path / "checkpoint/state.pkl"
    state.write_bytes(state.read_bytes()[:100])
    with pytest.raises(InvalidInputError, match=r"cannot be read .* another --output"):
        train(config, tmp_path, resume=True)


def test_a_run_is_not_written_over(tmp_path):
    config = replace(TINY["ppo"], steps=512)
    args = command.Args(config, output=tmp_path)
    command.main(args)
    written = (tmp_path / "seed-0/policy.npz").read_bytes()
    with pytest.raises(InvalidInputError, match="--resume or another --output"):
        command.main(replace(args, config=replace(config, gamma=0.9), seeds=2))
    assert (tmp_path / "seed-0/policy.npz").read_bytes() == written
    assert not (tmp_path / "seed-1").exists()


def test_being_killed_while_a_checkpoint_is_written_leaves_the_one_before(tmp_path):
    config = replace(TINY["ppo"], steps=512)
    train(config, tmp_path)
    (tmp_path / "checkpoint").rename(tmp_path / "checkpoint.old")
    (tmp_path / "checkpoint.new").mkdir()
    found = checkpoint.find(tmp_path)
    assert found is not None
    assert checkpoint.resume(found, config, None)[0].num_timesteps == 512


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_learning_from_filtered_actions_remembers_what_the_robots_did(algorithm):
    config = TrainingConfig(algorithm, num_envs=4, hold=2)
    env = make_env(config)
    model = make_model(config, env, None)
    applied, chosen = [], []

    class Record(BaseCallback):
        def _on_step(self):
            chosen.append(self.locals["actions"].copy())
            applied.append(env.venv.applied.copy())
            return True

    model.learn(64 * 4 if algorithm == "ppo" else 64, CallbackList([Record(), LearnFromFiltered()]))
    memory = model.rollout_buffer if algorithm == "ppo" else model.replay_buffer
    remembered = memory.actions.reshape(-1, 2)[: 4 * len(applied)]
    if algorithm == "ppo":  # flattened environment by environment
        applied = np.swapaxes(applied, 0, 1)
    np.testing.assert_allclose(remembered, np.reshape(applied, (-1, 2)), atol=1e-6)
    assert not np.allclose(np.sort(np.ravel(chosen)), np.sort(np.ravel(applied)), atol=1e-3)


def test_the_adapter_reports_ends_as_sb3_expects():
    native = make_vector("random", 3, None)
    held = VectorHoldAction(native, 5, "Disabled")
    env = VecNormalize(Sb3VecEnv(held), norm_obs=False, norm_reward=False)
    env.seed(0)
    env.reset()
    goal = native.unwrapped.scenes[0].goal
    endings = []
    for _ in range(200):
        state = native.unwrapped.rom_state
        u = np.clip(2.0 * (goal - state[:, :2]) - 3.0 * state[:, 2:], -5, 5) / 5.0
        u[1:] = 0.0
        observation, _, done, infos = env.step(u)
        endings += [(i, infos[i]) for i in np.flatnonzero(done)]
        for i in np.flatnonzero(done):
            assert not np.allclose(observation[i], infos[i]["terminal_observation"])
            np.testing.assert_array_equal(native.unwrapped.rom_state[i], np.zeros(4))
    first = dict(reversed(endings))
    assert first[0]["is_success"]
    assert not first[0]["TimeLimit.truncated"]
    assert first[0]["episode"]["l"] < 200
    assert first[1]["TimeLimit.truncated"]
    assert first[1]["episode"] == {"r": pytest.approx(0.0), "l": 200, "t": 0.0}


def test_a_policy_for_another_observation_shape_is_refused_with_both_shapes(tmp_path):
    config = TrainingConfig(num_envs=2)
    env = make_env(config)
    export(make_model(config, env, None), env, {}).save(tmp_path / "policy.npz")
    other = gym.make("HCBF-Regions-v0", scenario="paper-simulation")
    with pytest.raises(InvalidInputError, match=r"\(24,\).*\(36,\)"):
        policies.load(tmp_path / "policy.npz", other)
    with pytest.raises(UnknownNameError, match="ppo"):
        policies.load("no-such-policy", other)
    (tmp_path / "broken.npz").write_bytes(b"no policy")
    with pytest.raises(InvalidInputError, match=r"LearnedPolicy\.save"):
        policies.load(tmp_path / "broken.npz", other)
    with pytest.raises(InvalidInputError):
        policies.load(tmp_path / "missing.npz", other)


@pytest.mark.parametrize(
    "given",
    [
        {"gamma": 2.0}, {"gamma": float("nan")}, {"filter": "of"}, {"steps": "x"}, {"seed": -1},
        {"network": (0,)}, {"penalty": True}, {"hold": 0}, {"learn_from": "both"},
    ],
)  # fmt: skip
def test_a_configuration_made_in_python_is_checked_as_a_commands(given):
    with pytest.raises((InvalidInputError, UnknownNameError), match=next(iter(given))):
        TrainingConfig(**given)


def test_training_refuses_a_scene_without_a_goal_to_reach(tmp_path):
    with pytest.raises(InvalidInputError, match="reach"):
        train(TrainingConfig(scenario="paper-simulation"), tmp_path)


@pytest.mark.parametrize("name", learned.names())
def test_a_shipped_policy_knows_how_it_was_trained_and_so_reaches_its_goals(name):
    env = gym.make("HCBF-Regions-v0", scenario="random")
    policy = policies.load(name, env)
    assert {"seed", "steps", "versions", "algorithm"} <= set(policy.about)
    if policy.about["filter"] != "off":
        guidance = policy.about.get("guidance")
        env = wrappers.SafetyFilter(env, policy.about["program"], guidance=guidance)
    reached = 0
    for seed in range(3):
        observation, info = env.reset(seed=seed)
        ended = False
        while not ended:
            observation, _, reached_goal, truncated, info = env.step(policy(observation, info))
            ended = reached_goal or truncated
        reached += reached_goal
    assert reached >= 2
