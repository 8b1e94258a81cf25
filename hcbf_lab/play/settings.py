"""What a person chooses in the playground, and the environment, filter and policy that makes."""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import gymnasium as gym
import numpy as np

from hcbf_gym import policies, programs
from hcbf_gym.arguments import Amount, Seed, check
from hcbf_gym.arrays import Array
from hcbf_gym.errors import choose
from hcbf_gym.policies import Policy, learned
from hcbf_gym.scenarios import Scenario
from hcbf_gym.wrappers import SafetyFilter
from hcbf_robots.walkers.walker import NAMES

REDUCED = "reduced"
MODELS = {"a1": "HCBF-A1Regions-v0", REDUCED: "HCBF-Regions-v0"}
"""The robot: the whole A1 in MuJoCo, or its reduced-order model alone; others by contract."""

BODIES = ("point", "footprint")  # what must stay outside: the trunk's centre, or the whole A1

NO_FILTER = "none"
HUMAN = "human"
PD = "pd"

STICK_GAIN = 3.0  # how the human's acceleration follows the wanted velocity [1/s]


@dataclass(frozen=True)
class Settings:
    """What a person chooses."""

    model: str = "a1"
    """The A1 with full physics, the reduced-order model alone (reduced), or a robot that takes
    velocities: cart, holonomic-cart, or a contract's path."""
    body: Literal["point", "footprint"] = "point"
    """What must stay outside: the robot's centre, or the whole robot."""
    policy: str = PD
    """pd, human, a learned policy, or one of your own: file.py:function, module:function,
    model.zip, policy.onnx, policy.pt. A zip and a .pt hold pickles, which run code."""
    program: str = "lex-cbf-qp"
    """none, or a name from hcbf_gym.programs.names()."""
    guidance: bool = True
    """Lead to the goal around the regions, but where a human leads."""
    margin: Amount | None = None
    """What rows on the position reserve between h and zero [m; default: derived]."""
    gamma0: Amount = 5.0
    """Weight γ₀, where the program has one."""
    delta_gamma: Amount = 1.3
    """Slope Δγ of the weight, where the program has one."""
    seed: Seed = 0
    """Of random scenes and of the episode."""
    returns: bool = True
    """Whether a robot that has arrived goes back, and there again."""

    def __post_init__(self) -> None:
        check(self, prefix="")
        if not self.model.endswith(".json"):
            choose("model", self.model, dict.fromkeys(model_names()))
        if not policies.is_own(self.policy):
            choose("policy", self.policy, dict.fromkeys(policy_names()))
        choose("program", self.program, dict.fromkeys(program_names()))


def model_names() -> list[str]:
    """Return what may move; a contract's path may, too."""
    return [*MODELS, *NAMES]


def policy_names() -> list[str]:
    """Return what may choose the nominal input."""
    return [PD, HUMAN, *learned.names()]


def program_names() -> list[str]:
    """Return what may filter it."""
    return [NO_FILTER, *programs.names()]


class Human:
    """A person at the stick, ``u* = k (v_wanted − v)``, within least and greatest accelerations.

    Attributes:
        velocity: (2,) of the stick [m/s].
        target: (2,) where the stick was dragged to, which is walked to instead [m]; or None.
    """

    def __init__(self, low: Array, high: Array):
        self.low, self.high = low, high
        self.velocity = np.zeros(2)
        self.target: Array | None = None

    def act(self, x: Array) -> Array:
        """Return u* (2,) at position and velocity x (4,)."""
        wanted = self.velocity if self.target is None else self.target - x[:2]
        wanted = wanted / max(1.0, float(np.linalg.norm(wanted)))
        return np.clip(STICK_GAIN * (wanted - x[2:]), self.low, self.high)


class Arrangement(NamedTuple):
    """What steps: an environment, what filters its actions, and what acts."""

    env: gym.Env  # the environment, in its filter if there is one
    inner: Any  # the environment itself
    policy: Policy | None  # (observation, info) → u*; None where a person acts


def arrange(settings: Settings, scenario: Scenario, inner: Any = None) -> Arrangement:
    """Return the environment, filter and policy of the settings.

    Args:
        settings: what was chosen.
        scenario: the scene.
        inner: the environment that stays; None makes another.

    Raises:
        InvalidInputError: if the policy does not fit the scene.
    """
    if inner is None:
        more: dict[str, Any] = {} if settings.model == REDUCED else {"body": settings.body}
        if settings.model not in MODELS:
            more["robot"] = settings.model
        inner = gym.make(
            MODELS.get(settings.model, "HCBF-WalkerRegions-v0"),
            scenario=scenario,
            max_episode_steps=-1,
            disable_env_checker=True,
            **more,
        ).unwrapped
    policy: Policy | None = None
    if settings.policy != HUMAN:
        policy = policies.make(settings.policy, inner)
    if settings.program == NO_FILTER:
        return Arrangement(inner, inner, policy)
    weights: dict[str, Any] = {"gamma0": settings.gamma0, "delta_gamma": settings.delta_gamma}
    taken = programs.options(settings.program)
    guided = settings.guidance and policy is not None
    env = SafetyFilter(
        inner,
        program=settings.program,
        guidance="geodesic" if guided else None,
        margin=settings.margin,
        **{name: value for name, value in weights.items() if name in taken},
    )
    return Arrangement(env, inner, policy)
