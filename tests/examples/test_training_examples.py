"""The examples of training run as printed, only shorter.

Those of TorchRL, Minari and RLlib need libraries that the extra `test` does not bring.
"""

import importlib.util
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from needs import needs

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@needs("stable_baselines3")
@pytest.mark.physics
def test_an_agent_learns_under_the_filter_and_walks_the_a1(capsys):
    source = (EXAMPLES / "agent_in_20_lines.py").read_text(encoding="utf-8")
    short = source.replace("num_envs=256", "num_envs=4").replace("1_000_000", "256")
    short = short.replace("batch_size=2048", "batch_size=256")
    assert short.count("256") == 2
    names = {}
    exec(compile(short, "agent_in_20_lines.py", "exec"), names)
    scenario = names["a1"].unwrapped.scenario
    strict = [barrier.priority == 1 for barrier in scenario.barriers]
    assert (names["least"][: len(strict)][strict] >= 0.0).all()
    assert np.isfinite(names["observation"]).all()
    assert "least h" in capsys.readouterr().out


@pytest.mark.filterwarnings("ignore")
def test_torchrls_collector_runs_on_a_filtered_batch():
    pytest.importorskip("torchrl", reason="needs torchrl: pip install torchrl")
    collector = load("torchrl_collector")
    (data,) = collector.collect(n=4, frames=4 * 12, batches=1, max_episode_steps=20)
    reward, done = data["next", "reward"], data["next", "done"]
    assert done[:, 3].all()  # 20 steps are four decisions
    assert not done[:, 4].any()
    assert data["next", "costs"].shape == (4, 12, 3)
    assert (data["next", "cost"] == 0.0).all()  # rank 1 is not entered
    assert reward.isfinite().all()


@needs("torch")
def test_ppo_in_one_file_goes_the_guided_way():
    reports = list(load("cleanrl_ppo").train(4 * 8 * 64, "geodesic", n=8))
    assert [count for count, _ in reports] == [512, 1024, 1536, 2048]
    assert reports[-1][1] > 0.5  # whatever it learned: the filter leads


@needs("stable_baselines3")
@pytest.mark.filterwarnings("ignore:Training and eval env:UserWarning")
def test_sb3s_callback_counts_successes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    evaluation = load("sb3_evaluation").train(1024, n=8, every=512, episodes=2)
    log = np.load(tmp_path / "results/sb3/evaluations.npz")
    assert log["successes"].shape == (2, 2)
    assert evaluation.evaluations_timesteps == [512, 1024]


def test_trainers_that_want_an_id_get_one():
    load("held_regions")
    env = gym.make("HeldRegions-v0", max_episode_steps=7)
    env.reset(seed=0)
    assert env.action_space == gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
    assert env.unwrapped.time == 0.0
    env.step(np.array([1.0, 0.0], dtype=np.float32))
    assert env.unwrapped.time == pytest.approx(0.1)
    *_, truncated, info = env.step(np.array([1.0, 0.0], dtype=np.float32))
    assert not truncated
    assert "safety_filter" in info
    env.close()
