"""A policy of one's own is taken from a function, a zip, an ONNX file or a torch module."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import FrameStackObservation, NormalizeObservation, RescaleAction
from needs import needs
from networks import gains, write_onnx

from hcbf_gym import policies, wrappers
from hcbf_gym.errors import InvalidInputError, UnknownNameError

N = 24  # entries of an observation of the paper's scene

FUNCTION = """
from helper import KP

def act(observation, info):
    return KP * observation[:2] + 3.0 * observation[2:4]

class Counting:
    def __init__(self):
        self.steps = 0

    def __call__(self, observation, info):
        self.steps += 1
        return [float(self.steps), 0.0]

def raises(observation, info):
    return observation["position"]

def short(observation, info):
    return observation[:1]

def gives_nan(observation, info):
    return observation[:2] * float("nan")

number = 3
"""


@pytest.fixture
def env():
    env = gym.make("HCBF-Regions-v0", scenario="paper-simulation")
    assert env.observation_space.shape == (N,)
    yield env
    env.close()


@pytest.fixture
def own(tmp_path):
    (tmp_path / "helper.py").write_text("KP = 2.0\n", encoding="utf-8")
    (tmp_path / "own.py").write_text(FUNCTION, encoding="utf-8")
    return tmp_path


def asked(policy, observation):
    return np.asarray(policy(observation, {}), dtype=np.float64)


OBSERVATION = np.linspace(-0.4, 0.5, N)
WANTED = 2.0 * OBSERVATION[:2] + 3.0 * OBSERVATION[2:4]


def test_a_function_in_a_file_acts_and_finds_its_neighbours(own, env):
    name = f"{own / 'own.py'}:act"
    np.testing.assert_allclose(asked(policies.make(name, env), OBSERVATION), WANTED)
    assert {file.name for file in policies.files(name)} == {"own.py", "helper.py"}
    policies.try_out(name, env)


def test_a_function_in_a_module_of_the_current_folder_acts(own, env, monkeypatch):
    monkeypatch.chdir(own)
    monkeypatch.setattr("sys.path", ["nowhere", *__import__("sys").path])
    np.testing.assert_allclose(asked(policies.make("own:act", env), OBSERVATION), WANTED)


def test_every_episode_has_its_own_instance_of_a_class(own, env):
    for _ in range(2):
        policy = policies.make(f"{own / 'own.py'}:Counting", env)
        assert [asked(policy, OBSERVATION)[0] for _ in range(3)] == [1.0, 2.0, 3.0]


@needs("onnxruntime")
def test_a_network_acts_and_one_of_another_size_is_refused(tmp_path, env):
    path = write_onnx(tmp_path / "policy.onnx", gains(N).T)
    policy = policies.make(str(path), env)
    np.testing.assert_allclose(asked(policy, OBSERVATION), WANTED, rtol=1e-6)
    other = write_onnx(tmp_path / "other.onnx", gains(N + 1).T)
    with pytest.raises(InvalidInputError, match=rf"expected \[1, {N}\]"):
        policies.make(str(other), env)
    (tmp_path / "none.onnx").write_bytes(b"no network")
    with pytest.raises(InvalidInputError, match="onnxruntime refuses"):
        policies.make(str(tmp_path / "none.onnx"), env)


@needs("torch")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("form", ["whole", "script"])
def test_a_torch_module_acts(tmp_path, env, form):
    import torch

    module = torch.nn.Linear(N, 2, bias=False)
    module.weight.data = torch.tensor(gains(N))
    path = tmp_path / "policy.pt"
    if form == "whole":
        torch.save(module, path)
    else:
        torch.jit.trace(module, torch.zeros(1, N)).save(str(path))
    policy = policies.make(str(path), env)
    np.testing.assert_allclose(asked(policy, OBSERVATION), WANTED, rtol=1e-5)


@needs("torch")
def test_a_file_without_a_module_is_refused_in_a_sentence(tmp_path, env):
    import torch

    torch.save(torch.nn.Linear(N, 2).state_dict(), tmp_path / "weights.pt")
    with pytest.raises(InvalidInputError, match=r"a state_dict.*torch\.save\(module, path\)"):
        policies.make(str(tmp_path / "weights.pt"), env)
    torch.save(torch.nn.Linear(N + 1, 2), tmp_path / "other.pt")
    with pytest.raises(InvalidInputError, match=rf"observation of shape \({N},\)"):
        policies.try_out(str(tmp_path / "other.pt"), env)
    (tmp_path / "junk.pt").write_bytes(b"junk")
    with pytest.raises(InvalidInputError, match="expected a module"):
        policies.make(str(tmp_path / "junk.pt"), env)


@needs("stable_baselines3")
@pytest.mark.parametrize("name", ["PPO", "A2C", "SAC", "TD3"])
def test_a_zip_acts_as_the_model_that_was_saved(tmp_path, env, name):
    import stable_baselines3

    model = getattr(stable_baselines3, name)("MlpPolicy", env, seed=0, device="cpu")
    model.save(tmp_path / "model")
    policy = policies.make(str(tmp_path / "model.zip"), env)
    wanted, _ = model.predict(OBSERVATION, deterministic=True)
    np.testing.assert_array_equal(asked(policy, OBSERVATION), wanted)


@needs("stable_baselines3")
def test_a_zip_in_other_ranges_is_stretched_and_one_of_other_spaces_refused(tmp_path, env):
    from stable_baselines3 import DQN, PPO

    rescaled = gym.wrappers.RescaleAction(env, np.float32(-1), np.float32(1))
    model = PPO("MlpPolicy", rescaled, seed=0, device="cpu")
    model.save(tmp_path / "unit")
    wanted, _ = model.predict(OBSERVATION, deterministic=True)
    policy = policies.make(str(tmp_path / "unit.zip"), env)
    np.testing.assert_allclose(asked(policy, OBSERVATION), 5.0 * wanted, rtol=1e-4)
    PPO("MlpPolicy", gym.make("Pendulum-v1"), device="cpu").save(tmp_path / "pendulum")
    with pytest.raises(InvalidInputError, match=rf"shape \(3,\).*expected \({N},\)"):
        policies.make(str(tmp_path / "pendulum.zip"), env)
    DQN("MlpPolicy", gym.make("CartPole-v1"), device="cpu", buffer_size=10).save(tmp_path / "dqn")
    with pytest.raises(InvalidInputError, match=r"expected what model\.save"):
        policies.make(str(tmp_path / "dqn.zip"), env)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("own.py:raises", "IndexError"),
        ("own.py:short", r"shape \(1,\).*expected real numbers of shape \(2,\)"),
        ("own.py:gives_nan", "nan.*expected finite"),
        ("own.py:nothing", "AttributeError"),
        ("own.py:number", "expected a function"),
        ("nowhere.py:act", "no file"),
        ("broken.py:act", "SyntaxError"),
        ("no_such_module:act", "no_such_module"),
        ("missing.onnx", "expected an existing file"),
        ("missing.zip", "expected an existing file"),
    ],
)
def test_a_malformed_policy_is_refused_in_a_sentence(own, env, monkeypatch, name, message):
    (own / "broken.py").write_text("def act(:\n", encoding="utf-8")
    monkeypatch.chdir(own)
    with pytest.raises(InvalidInputError, match=message):
        policies.try_out(name, env)


def test_an_unknown_name_is_answered_with_what_there_is(env):
    with pytest.raises(UnknownNameError, match=r"pd-ff.*ppo.*file\.py:function"):
        policies.make("missing", env)


def test_a_registered_policy_is_made_by_its_name():
    env = gym.make("HCBF-Regions-v0")
    policies.register("still", lambda env: lambda observation, info: np.zeros(2))
    assert not policies.make("still", env)(*env.reset(seed=0)).any()
    assert {"pd", "pd-ff", "ppo", "still"} <= set(policies.names())
    for taken in ("pd", "ppo", "still", "still:life", ""):
        with pytest.raises(InvalidInputError, match="not"):
            policies.register(taken, policies.PDTracker.for_env)


ID = "HCBF-Regions-v0"


def rescaled(env):
    return RescaleAction(env, np.float32(-1), np.float32(1))


@pytest.mark.parametrize(
    "wrap", [rescaled, NormalizeObservation, lambda env: FrameStackObservation(env, 3)]
)
@pytest.mark.parametrize("joined", [False, True])
def test_it_refuses_what_it_cannot_read(wrap, joined):
    env = wrap(gym.make(ID))
    with pytest.raises(InvalidInputError, match="changes actions or observations"):
        policies.PDTracker.for_env(SyncVectorEnv([lambda: env]) if joined else env)


def test_it_refuses_another_kind_of_environment():
    with pytest.raises(InvalidInputError, match="Box of shape"):
        policies.PDTracker.for_env(gym.make("CartPole-v1"))


def test_filters_holds_and_limits_do_not_disturb_it():
    filtered = wrappers.SafetyFilter(gym.make(ID, max_episode_steps=5), program="lex-cbf-qp")
    env = wrappers.HoldAction(wrappers.InterventionPenalty(filtered), 2)
    plain = policies.PDTracker.for_env(gym.make(ID))
    for other in (env, SyncVectorEnv([lambda: env]), gym.make_vec(ID, num_envs=2)):
        policy = policies.PDTracker.for_env(other)
        np.testing.assert_array_equal(policy.low, plain.low)
        np.testing.assert_array_equal(policy.high, plain.high)
