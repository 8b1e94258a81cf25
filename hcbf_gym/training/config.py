"""The configuration of a training run, its environments, and its algorithm."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import gymnasium as gym
import numpy as np

from hcbf_gym.arguments import Amount, Count, Range, check
from hcbf_gym.errors import InvalidInputError, MissingDependencyError, install
from hcbf_gym.wrappers import VectorHoldAction, VectorInterventionPenalty, VectorSafetyFilter

try:
    from stable_baselines3 import PPO, SAC, TD3
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.noise import NormalActionNoise
    from stable_baselines3.common.vec_env import VecNormalize

    from hcbf_gym.wrappers.sb3 import Sb3VecEnv
except ImportError as error:
    raise MissingDependencyError(
        f"training: got no stable_baselines3, expected the extra rl: {install('rl')}"
    ) from error

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "sac": SAC, "td3": TD3}

Curve = list[dict[str, float]]
"""The reports of a run, each with its decisions ("steps"), where a decision is one action of one
environment, the time of training ("seconds_spent") [s], and the figures of `export.Report`."""
Show = Callable[[int, Curve], None]
"""A function that shows the progress of a run: (decisions so far, curve) → None."""

HELD_OUT = 1_000_000  # the least seed of training scenes, so that those of lesser are held out

_NUM_ENVS = {"ppo": 256, "sac": 32, "td3": 32}
_STEPS = {"ppo": 1_000_000, "sac": 200_000, "td3": 200_000}
_BUFFER_SIZE = 200_000  # the decisions that SAC and TD3 learn from
_TD3_NOISE = 0.2  # standard deviation of the actions' noise, as a share of half their range
_OPTIONS: dict[str, dict[str, Any]] = {
    "ppo": {
        "n_steps": 64,
        "batch_size": 2048,
        "n_epochs": 5,
        "learning_rate": 7e-4,
        "policy_kwargs": {"log_std_init": -1.0},
    },
    "sac": {"batch_size": 512, "gradient_steps": 8, "learning_rate": 7e-4},
    "td3": {"batch_size": 512, "gradient_steps": 8, "learning_rate": 7e-4},
}


@dataclass(frozen=True)
class TrainingConfig:
    """One training run on the reduced-order model."""

    algorithm: Literal["ppo", "sac", "td3"] = "ppo"
    """Stable-Baselines3's algorithm."""
    scenario: str = "random"
    """A scene whose task is to reach a goal."""
    filter: Literal["off", "on", "penalty"] = "on"
    """Whether a safety filter is in the loop, and whether its interventions cost reward."""
    program: str = "lex-cbf-qp"
    """The filter's program."""
    guidance: Literal["geodesic"] | None = None
    """Whether the filter leads around the regions to the goal."""
    penalty: Amount = 0.005
    """Price of an intervention, with filter "penalty" [s²/m]."""
    learn_from: Literal["nominal", "filtered"] = "nominal"
    """The action that the algorithm learns from: its own, or the filtered one."""
    steps: Annotated[int, Range(1, 10**12)] | None = None
    """Decisions over all environments [default: ppo 1000000, sac and td3 200000]."""
    num_envs: Count | None = None
    """Environments stepped together [default: ppo 256, sac and td3 32]."""
    hold: Count = 5
    """Control steps of 0.02 s for which training holds a decision."""
    gamma: Annotated[float, Range(0.0, 1.0, above=True)] = 0.99
    """Discount from one decision to the next."""
    network: tuple[Annotated[int, Range(1, 65_536)], ...] = (64, 64)
    """Widths of the hidden layers."""
    seed: Annotated[int, Range(0, 2**32 - 1)] = 0
    """Seed of the scenes, the network and the algorithm."""
    report_every: Count = 150_000
    """Decisions between two evaluations on held-out scenes, each followed by a checkpoint."""
    report_episodes: Count = 200
    """Held-out scenes of one evaluation."""

    def __post_init__(self) -> None:
        check(self, prefix="")
        if self.guidance is not None and self.filter == "off":
            raise InvalidInputError("guidance: got filter 'off', expected 'on' or 'penalty'")

    @property
    def n(self) -> int:
        """The number of environments."""
        return _NUM_ENVS[self.algorithm] if self.num_envs is None else self.num_envs

    @property
    def total_steps(self) -> int:
        """The number of decisions."""
        return _STEPS[self.algorithm] if self.steps is None else self.steps

    @property
    def in_the_loop(self) -> str | None:
        """The program that filters in training, if one does."""
        return None if self.filter == "off" else self.program


def make_vector(
    scenario: str, n: int, program: str | None, guidance: str | None = None
) -> gym.vector.VectorEnv:
    """Return n native environments that do not reset themselves, filtered if there is a program.

    Raises:
        HcbfError: if the scenario or program is not registered, or the task is not "reach".
    """
    env = gym.make_vec("HCBF-Regions-v0", num_envs=n, scenario=scenario, autoreset_mode="Disabled")
    task = env.unwrapped.scenario.task  # type: ignore[attr-defined]
    if task != "reach":
        raise InvalidInputError(f"scenario {scenario!r}: got task {task!r}, expected 'reach'")
    return env if program is None else VectorSafetyFilter(env, program, guidance=guidance)


def make_env(config: TrainingConfig) -> VecNormalize:
    """Return the training environments as SB3 takes them, with normalised observations."""
    env = make_vector(config.scenario, config.n, config.in_the_loop, config.guidance)
    if config.filter == "penalty":
        env = VectorInterventionPenalty(env, config.penalty)
    held = VectorHoldAction(env, config.hold, "Disabled")
    return VecNormalize(Sb3VecEnv(held), gamma=config.gamma)


def make_model(config: TrainingConfig, env: VecNormalize, tensorboard: str | None) -> BaseAlgorithm:
    """Return the untrained algorithm, which logs to the folder `tensorboard` if there is one."""
    options = dict(_OPTIONS[config.algorithm])
    layers = {"net_arch": list(config.network)}
    options["policy_kwargs"] = layers | options.get("policy_kwargs", {})
    if config.algorithm == "ppo":
        options["batch_size"] = min(options["batch_size"], config.n * options["n_steps"])
    else:
        options["buffer_size"] = min(_BUFFER_SIZE, config.total_steps)
    if config.algorithm == "td3":
        options["action_noise"] = NormalActionNoise(np.zeros(2), np.full(2, _TD3_NOISE))
    algorithm: Any = ALGORITHMS[config.algorithm]
    model = algorithm(
        "MlpPolicy",
        env,
        gamma=config.gamma,
        seed=config.seed,
        device="cpu",
        tensorboard_log=tensorboard,
        **options,
    )
    env.seed(HELD_OUT * (1 + config.seed))  # other scenes in each run
    return model
