"""Every form of a policy of one's own, by one command, gives the numbers of a loop by hand."""

import json
from pathlib import Path

import gymnasium as gym
import pytest
from by_hand import by_hand
from needs import needs
from networks import gains, write_onnx

from hcbf_gym import cli, loading, wrappers
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.policies import named

pytestmark = pytest.mark.filterwarnings(
    "ignore::DeprecationWarning", "ignore::hcbf_gym.errors.CoverageWarning"
)

OWN = """
import gymnasium as gym
import numpy as np
from gymnasium import spaces

from hcbf_gym import Plant
from hcbf_gym.barriers import Disc
from hcbf_gym.models import DoubleIntegrator

T = 0.05


class Point(gym.Env):
    observation_space = spaces.Box(-np.inf, np.inf, (4,))
    action_space = spaces.Box(-3.0, 3.0, (2,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = np.array([-3.0, self.np_random.uniform(-0.2, 0.2), 0.0, 0.0])
        return -self.x.astype(np.float32), {}

    def step(self, u):
        p, v = self.x[:2], self.x[2:]
        self.x = np.array([*(p + T * v + T**2 / 2 * u), *(v + T * u)])
        return -self.x.astype(np.float32), -float(np.hypot(*self.x[:2])), False, False, {}


def make():
    plant = Plant(
        model=DoubleIntegrator(),
        barriers=[Disc("pillar", 1, center=(-1.5, 0.0), radius=0.5)],
        state=lambda env, observation, info: env.x,
        period=T,
    )
    return Point(), plant
"""
STEPS = 25
ENVIRONMENTS = {
    "rom": ("HCBF-Regions-v0", {"scenario": "random"}),
    "a1": ("HCBF-A1Regions-v0", {"scenario": "random"}),
    "cart": ("HCBF-WalkerRegions-v0", {"robot": "cart", "scenario": "random"}),
    "own": ("own.py:make", {}),
}
FORMS = {
    "function": ("law.py:act", ()),
    "zip": ("model.zip", ("stable_baselines3",)),
    "onnx": ("policy.onnx", ("onnxruntime",)),
    "pt": ("policy.pt", ("torch",)),
}


def written(form, env):
    """Write a policy of a form into the current folder, and return its name."""
    name = FORMS[form][0]
    n = env.observation_space.shape[0]
    if form == "function":
        law = "def act(observation, info):\n    return 2 * observation[:2] + 3 * observation[2:4]\n"
        Path(name.partition(":")[0]).write_text(law, encoding="utf-8")
    elif form == "onnx":
        write_onnx(Path(name), gains(n).T)
    elif form == "pt":
        import torch

        module = torch.nn.Linear(n, 2, bias=False)
        module.weight.data = torch.tensor(gains(n))
        torch.save(module, name)
    else:
        import stable_baselines3

        stable_baselines3.PPO("MlpPolicy", env, seed=0, device="cpu").save("model")
    return name


@pytest.mark.parametrize(
    ("where", "form"),
    [
        *((where, "function") for where in ENVIRONMENTS),
        *(
            pytest.param("own", form, marks=needs(*modules))
            for form, (_, modules) in FORMS.items() if modules
        ),
    ],
)  # fmt: skip
def test_a_command_gives_the_numbers_of_a_loop_by_hand(where, form, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(OWN, encoding="utf-8")
    name, options = ENVIRONMENTS[where]
    env, plant = (
        loading.function("env", name)() if where == "own" else (gym.make(name, **options), None)
    )
    policy_name = written(form, env)
    arguments = [f"--{key}={value}" for key, value in options.items()]
    cli.main([
        "evaluate", f"--env={name}", *arguments, f"--policy={policy_name}", "--program=lex-cbf-qp",
        f"--steps={STEPS}", "--workers=1", "--seed=3", "--output=out",
    ])  # fmt: skip
    written_rows = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    policy = named.make(policy_name, env)
    env = wrappers.SafetyFilter(env, plant=plant)
    total, changed = by_hand(env, policy, 3, STEPS)
    (row,) = written_rows["episodes"]
    assert row["return"] == pytest.approx(total, rel=1e-9)
    assert row["intervention_rms"] == pytest.approx(changed, rel=1e-9)


DICT = """

class Split(Point):
    observation_space = spaces.Dict({"x": Point.observation_space, "goal": Point.observation_space})

    def reset(self, *, seed=None, options=None):
        seen, info = super().reset(seed=seed)
        return {"x": seen, "goal": 0 * seen}, info

    def step(self, u):
        seen, *rest = super().step(u)
        return {"x": seen, "goal": 0 * seen}, *rest


def split():
    return Split(), make()[1]
"""


@needs("stable_baselines3")
def test_a_model_of_dict_observations_is_evaluated(tmp_path, monkeypatch):
    import stable_baselines3

    monkeypatch.chdir(tmp_path)
    (tmp_path / "seen.py").write_text(OWN + DICT, encoding="utf-8")
    env, plant = loading.function("env", "seen.py:split")()
    stable_baselines3.PPO("MultiInputPolicy", env, seed=0, device="cpu").save("model")
    cli.main([
        "evaluate", "--env=seen.py:split", "--policy=model.zip", "--program=lex-cbf-qp",
        f"--steps={STEPS}", "--workers=1", "--seed=3", "--output=out",
    ])  # fmt: skip
    written = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    policy = named.make("model.zip", env)
    total, _ = by_hand(wrappers.SafetyFilter(env, plant=plant), policy, 3, STEPS)
    assert written["episodes"][0]["return"] == pytest.approx(total, rel=1e-9)
    (tmp_path / "network.onnx").write_bytes(b"")
    with pytest.raises(InvalidInputError, match="FlattenObservation"):
        named.make("network.onnx", env)
