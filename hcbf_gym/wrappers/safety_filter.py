"""The wrappers that put a program between a policy and an environment."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import NDArray

from hcbf_gym import programs
from hcbf_gym.barriers import class_k
from hcbf_gym.barriers.class_k import ClassK, LogClassK
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.envs.task import check_action
from hcbf_gym.errors import InvalidInputError, check_options, finite_float

Array = NDArray[np.float64]

_ROW_OPTIONS = ("alpha1", "alpha2", "margin")


class _RowSettings:
    """How an environment's barriers become rows: α₁, α₂ and the margin of strict rows."""

    def __init__(self, env: Any, options: dict[str, Any]):
        if not hasattr(env, "barrier_set"):
            raise InvalidInputError(
                f"environment: got {env}, expected one with barriers, such as HCBF-Regions-v0"
            )
        self.alpha1: ClassK = class_k.make(options.get("alpha1", LogClassK()))
        self.alpha2: ClassK = class_k.make(options.get("alpha2", 2.0))
        margin = options.get("margin", env.margin)
        self.margin = finite_float("margin", margin, minimum=0.0)

    def rows(self, env: Any, x: Array, t: Array) -> CbfRows:
        """Return the rows of an environment's N states x (N, 4) at the times t (N,)."""
        return env.barrier_set.rows(x, t, self.alpha1, self.alpha2, self.margin)


def _split(program: str, options: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the options that make rows and those that the program takes.

    Raises:
        InvalidInputError: if an option is neither; the message lists both.
    """
    check_options(
        f"safety filter {program!r}", options, (*_ROW_OPTIONS, *programs.options(program))
    )
    rows = {key: value for key, value in options.items() if key in _ROW_OPTIONS}
    return rows, {key: value for key, value in options.items() if key not in _ROW_OPTIONS}


class SafetyFilter(gym.Wrapper, RecordConstructorArgs):
    """Filters every action through one of the programs, so that any policy respects the ranking.

    The action u* becomes the rows' and the program's ``u``, which the environment receives;
    ``info["safety_filter"]`` holds `u_nominal` (2,), `u_safe` (2,), `slack` (m,) the rows'
    violation, `delta` (m,) the program's own relaxation, `status` (a float of
    `hcbf_gym.programs.FilterStatus`), `intervention` ‖u − u*‖ and `fallbacks`.

    Args:
        env: an environment of this package, possibly wrapped.
        program: a name from `hcbf_gym.programs.names()`.
        solver: "daqp", "clarabel" or any solver that qpsolvers knows.
        **options: `alpha1` (default: the paper's logarithm) and `alpha2` (default: gain 2), class-K
            functions as `barriers.class_k.make` reads them; `margin` [m] that strict rows keep
            (default: the environment's own); all else goes to the program, such as `gamma0`,
            `delta_gamma`, `lambda_u`, `epsilon`.

    Raises:
        UnknownNameError: if the program or the solver is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range, or the environment has no
            barriers.

    Example:
        >>> import gymnasium as gym, hcbf_gym
        >>> env = gym.make("HCBF-Regions-v0", scenario="paper-simulation")
        >>> env = hcbf_gym.wrappers.SafetyFilter(env, program="h-cbf-qp", gamma0=5.0)
        >>> policy = hcbf_gym.policies.PDTracker.for_env(env)
        >>> obs, info = env.reset(seed=0)
        >>> obs, reward, terminated, truncated, info = env.step(policy(obs, info))
        >>> info["safety_filter"]["status"]
        0.0
    """

    def __init__(
        self, env: gym.Env, program: str = "eh-cbf-qp", solver: str = "daqp", **options: Any
    ):
        RecordConstructorArgs.__init__(self, program=program, solver=solver, **options)
        gym.Wrapper.__init__(self, env)
        row_options, program_options = _split(program, options)
        self._settings = _RowSettings(env.unwrapped, row_options)
        self.program = programs.make(
            program,
            input_set=env.unwrapped.scenario.input_set,  # type: ignore[attr-defined]
            solver=solver,
            **program_options,
        )

    def rows(self) -> CbfRows:
        """Return the rows of the present state."""
        env: Any = self.env.unwrapped
        batch = self._settings.rows(env, env.rom_state[None], np.array([env.time]))
        a, b, h, priority, alpha2_psi = batch
        assert alpha2_psi is not None
        return CbfRows(a[0], b[0], h[0], priority[0], alpha2_psi[0])

    def step(self, action: Array) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Filter u* (2,) [m/s²] and step the environment with the result."""
        u_nominal = check_action(action, (2,))
        result = self.program(u_nominal, self.rows())
        observation, reward, terminated, truncated, info = self.env.step(result.u)
        info["safety_filter"] = {
            "u_nominal": u_nominal.copy(),
            "u_safe": result.u.copy(),
            "slack": result.slack.copy(),
            "delta": result.delta.copy(),
            "status": float(result.status),
            "intervention": float(np.linalg.norm(result.u - u_nominal)),
            "fallbacks": float(result.fallbacks),
        }
        return observation, reward, terminated, truncated, info


class VectorSafetyFilter(VectorWrapper, RecordConstructorArgs):
    """`SafetyFilter` for the native vector environment: all N actions in one compiled call.

    Args:
        env: ``gym.make_vec("HCBF-Regions-v0", num_envs=N)``, possibly wrapped.
        program: a name from `hcbf_gym.programs.names()`.
        **options: as `SafetyFilter` takes them.

    Raises:
        UnknownNameError: if the program is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range, or the environment is no native
            vector environment of this package.
    """

    def __init__(self, env: VectorEnv, program: str = "eh-cbf-qp", **options: Any):
        RecordConstructorArgs.__init__(self, program=program, **options)
        VectorWrapper.__init__(self, env)
        row_options, program_options = _split(program, options)
        inner: Any = env.unwrapped
        self._settings = _RowSettings(inner, row_options)
        self.program = programs.make_batch(
            program, input_set=inner.scenario.input_set, **program_options
        )

    def step(self, actions: Array) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Filter u* (N, 2) [m/s²] and step the environments with the result."""
        u_nominal = check_action(actions, (self.num_envs, 2))
        env: Any = self.env.unwrapped
        result = self.program(u_nominal, self._settings.rows(env, env.rom_state, env.time))
        observation, reward, terminated, truncated, info = self.env.step(result.u)
        info["safety_filter"] = {
            "u_nominal": u_nominal.copy(),
            "u_safe": result.u,
            "slack": result.slack,
            "delta": result.delta,
            "status": result.status.astype(np.float64),
            "intervention": np.linalg.norm(result.u - u_nominal, axis=1),
            "fallbacks": np.asarray(result.fallbacks, dtype=np.float64),
        }
        info["_safety_filter"] = np.ones(self.num_envs, dtype=np.bool_)
        return observation, reward, terminated, truncated, info
