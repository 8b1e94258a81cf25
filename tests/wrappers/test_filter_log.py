"""Training curves of what a filter did are those of its reports."""

import gymnasium as gym
import numpy as np
import pytest
from needs import needs

from hcbf_gym.errors import InvalidInputError
from hcbf_gym.wrappers import FilterLog, SafetyFilter, VectorSafetyFilter


def test_a_batch_is_logged_as_its_single_environments():
    batch = gym.make_vec("HCBF-Regions-v0", 3, scenario="random", autoreset_mode="Disabled")
    batch = VectorSafetyFilter(batch)
    batch.reset(seed=0)
    whole = FilterLog(batch.conditions)
    parts = FilterLog(batch.conditions)
    reports = []
    for _ in range(30):
        report = batch.step(np.tile([4.0, 0.0], (3, 1)))[-1]["safety_filter"]
        whole.add(report)
        for i in range(3):
            parts.add({key: report[key][i] for key in ("status", "intervention", "h")})
        reports.append(report)
    found, other = whole.scalars(), parts.scalars()
    assert found == pytest.approx(other)
    shares = [share for name, share in found.items() if "status" in name]
    assert sum(shares) == pytest.approx(1.0)
    assert found["filter/intervention"] == pytest.approx(
        np.mean([report["intervention"] for report in reports])
    )
    ranks = np.array([condition.rank for condition in batch.conditions])
    for rank in (1, 2, 3):
        least = min(report["h"][:, ranks == rank].min() for report in reports)
        assert found[f"filter/least_h_rank_{rank}"] == least
    assert whole.scalars() == {}


@needs("stable_baselines3")
@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
def test_the_callback_logs_for_tensorboard(tmp_path, algorithm):
    import stable_baselines3
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    from hcbf_gym.wrappers.sb3 import FilterCallback, Sb3VecEnv

    robots = gym.make_vec("HCBF-Regions-v0", 4, scenario="random", autoreset_mode="Disabled")
    robots = Sb3VecEnv(VectorSafetyFilter(robots))
    options = {"n_steps": 32} if algorithm == "PPO" else {"learning_starts": 10, "buffer_size": 500}
    model = getattr(stable_baselines3, algorithm)(
        "MlpPolicy", robots, tensorboard_log=str(tmp_path), device="cpu", seed=0, **options
    )
    model.learn(300, callback=FilterCallback(), log_interval=1)
    if algorithm == "SAC":
        model.logger.dump(model.num_timesteps)  # SB3 logs at the ends of episodes
    (folder,) = tmp_path.iterdir()
    log = EventAccumulator(str(folder)).Reload()
    names = set(log.Tags()["scalars"])
    assert {"filter/status_SAFE", "filter/least_h_rank_1", "filter/intervention"} <= names
    assert log.Scalars("filter/least_h_rank_1")[-1].value > 0.0


@needs("stable_baselines3")
def test_environments_without_a_filter_are_refused():
    from stable_baselines3 import PPO

    from hcbf_gym.wrappers.sb3 import FilterCallback

    model = PPO("MlpPolicy", gym.make("HCBF-Regions-v0"), device="cpu", n_steps=16, batch_size=16)
    with pytest.raises(InvalidInputError, match="without a filter"):
        model.learn(16, callback=FilterCallback())


def test_an_environment_of_ones_own_is_logged():
    import importlib.util
    from pathlib import Path

    file = Path(__file__).parents[2] / "examples" / "boat.py"
    spec = importlib.util.spec_from_file_location("boat", file)
    boat = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(boat)
    env, plant = boat.certify()
    env = SafetyFilter(env, plant=plant)
    env.reset(seed=0)
    log = FilterLog(env.conditions)
    for _ in range(10):
        log.add(env.step(np.array([1.0, 0.0]))[-1]["safety_filter"])
    assert log.scalars()["filter/least_h_rank_1"] > 0.0
