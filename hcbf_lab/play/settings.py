"""The settings of the playground, and the environment, filter and policy that they make."""

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
"""The environments of the A1 in MuJoCo and of its reduced-order model; others have a contract."""
BODIES = ("point", "footprint")  # to stay outside: the trunk's centre, or the whole A1

NO_FILTER = "none"
HUMAN = "human"
PD = "pd"

STICK_GAIN = 3.0  # of a person's acceleration, on the error of the velocity [1/s]


@dataclass(frozen=True)
class Settings:
    """The choices of a person on the page or the command line."""

    model: str = "a1"
    """The A1 with full physics, the reduced-order model alone (reduced), or a robot that takes
    velocities: cart, holonomic-cart, or a contract's path."""
    body: Literal["point", "footprint"] = "point"
    """The part that must stay outside: the robot's centre, or the whole robot."""
    policy: str = PD
    """pd, human, a learned policy, or one of your own: file.py:function, module:function,
    model.zip, policy.onnx, policy.pt. A zip and a .pt hold pickles, which run code."""
    program: str = "lex-cbf-qp"
    """none, or a name from hcbf_gym.programs.names()."""
    guidance: bool = True
    """Lead to the goal around the regions, unless a human steers."""
    margin: Amount | None = None
    """The margin between h and zero in rows on the position [m; default: derived]."""
    gamma0: Amount = 5.0
    """Weight γ₀, if the program has one."""
    delta_gamma: Amount = 1.3
    """Slope Δγ of the weight, if the program has one."""
    seed: Seed = 0
    """Of random scenes and of the episode."""
    returns: bool = True
    """Whether a robot that has arrived returns to its start, and then to the goal again."""

    def __post_init__(self) -> None:
        check(self, prefix="")
        if not self.model.endswith(".json"):
            choose("model", self.model, dict.fromkeys(model_names()))
        if not policies.is_own(self.policy):
            choose("policy", self.policy, dict.fromkeys(policy_names()))
        choose("program", self.program, dict.fromkeys(program_names()))


def model_names() -> list[str]:
    """Return the names of the robots; the path of a contract is valid, too."""
    return [*MODELS, *NAMES]


def policy_names() -> list[str]:
    """Return the names of the policies; a policy of one's own is valid, too."""
    return [PD, HUMAN, *learned.names()]


def program_names() -> list[str]:
    """Return the names of the filter's programs, and that of no filter."""
    return [NO_FILTER, *programs.names()]


class Human:
    """A person at the stick, ``u* = k (v_requested − v)``, clipped to [low, high] (2,) [m/s²].

    The requested velocity points to the target, if there is one, and is at most 1 m/s.

    Attributes:
        velocity: (2,) of the stick [m/s].
        target: (2,) the point to which the stick is dragged [m]; None for no point.
    """

    def __init__(self, low: Array, high: Array):
        self.low, self.high = low, high
        self.velocity = np.zeros(2)
        self.target: Array | None = None

    def act(self, x: Array) -> Array:
        """Return u* (2,) at position and velocity x (4,)."""
        requested = self.velocity if self.target is None else self.target - x[:2]
        requested = requested / max(1.0, float(np.linalg.norm(requested)))
        return np.clip(STICK_GAIN * (requested - x[2:]), self.low, self.high)


class Arrangement(NamedTuple):
    """An environment with its filter and its policy."""

    env: gym.Env  # the environment in its filter, or `inner` without a filter
    inner: Any  # the unwrapped environment
    policy: Policy | None  # (observation, info) → u*; None if a person steers


def arrange(settings: Settings, scenario: Scenario, inner: Any = None) -> Arrangement:
    """Return the environment, filter and policy of the settings.

    Args:
        settings: that are chosen.
        scenario: the scene.
        inner: the unwrapped environment to keep; None makes a new one.

    Raises:
        InvalidInputError: if the policy does not fit the scene.
    """
    if inner is None:
        options: dict[str, Any] = {} if settings.model == REDUCED else {"body": settings.body}
        if settings.model not in MODELS:
            options["robot"] = settings.model
        inner = gym.make(
            MODELS.get(settings.model, "HCBF-WalkerRegions-v0"),
            scenario=scenario,
            max_episode_steps=-1,
            disable_env_checker=True,
            **options,
        ).unwrapped
    policy = None if settings.policy == HUMAN else policies.make(settings.policy, inner)
    if settings.program == NO_FILTER:
        return Arrangement(inner, inner, policy)
    weights: dict[str, Any] = {"gamma0": settings.gamma0, "delta_gamma": settings.delta_gamma}
    accepted = programs.options(settings.program)
    is_guided = settings.guidance and policy is not None
    env = SafetyFilter(
        inner,
        program=settings.program,
        guidance="geodesic" if is_guided else None,
        margin=settings.margin,
        **{name: value for name, value in weights.items() if name in accepted},
    )
    return Arrangement(env, inner, policy)
