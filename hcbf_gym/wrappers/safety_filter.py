"""The wrappers that put a program between a policy and an environment."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import NDArray

from hcbf_gym import certificates, programs, records
from hcbf_gym.arrays import Array
from hcbf_gym.certificates import Certificate
from hcbf_gym.envs.infos import Reporter
from hcbf_gym.envs.regions_vector import RegionsVectorEnv
from hcbf_gym.errors import InvalidInputError, as_array
from hcbf_gym.filtering.certified import certified, differs, limits
from hcbf_gym.filtering.core import FilterCore, FilterSettings, plain_options
from hcbf_gym.filtering.general_core import GeneralCore
from hcbf_gym.filtering.planar_core import PlanarCore
from hcbf_gym.models.input_sets import Box, InputSet
from hcbf_gym.models.plant import Estimate, Plant, read
from hcbf_gym.models.reduced_order import DoubleIntegrator
from hcbf_gym.wrappers.hold import HoldAction, VectorHoldAction
from hcbf_gym.wrappers.readers import Readers


class SafetyFilter(gym.Wrapper, RecordConstructorArgs):
    """Filters every action through one of the programs, so that any policy respects the ranking.

    The policy's action u* goes to the program. The environment receives the program's input u.
    ``info["safety_filter"]`` holds the fields of `hcbf_gym.filtering.report`: u* and u, each row's
    slack, relaxation and margin, `status` (a `hcbf_gym.programs.FilterStatus`), `reason` (a
    `hcbf_gym.models.plant.Reason`, 0 where there is none), `covered` (a
    `hcbf_gym.models.plant.Coverage`), `covered_by` (why, a `hcbf_gym.models.plant.CoveredBy`), and
    what is measured on the way, such as `intervention` ‖u − u*‖ and `deadlock`, 1 where the plant
    stands (‖v‖ < 0.05 m/s) though u* asks it to move (‖u*‖ > 0.3 m/s²).
    `reset` reports the same keys.

    Args:
        env: an environment of this package, possibly wrapped; any other with its `plant`. Wrappers
            that change actions belong outside the filter.
        program: a name from `hcbf_gym.programs.names()`, or a `hcbf_gym.programs.Plan`.
        plant: what the filter must know of the environment; None takes ``env.unwrapped.plant``.
        rows: "held" preserves h ≥ 0 while an input is held, "usual" at the samples alone. Plants
            other than the planar double integrator, or of unknown period, have usual rows.
        guidance: "geodesic" leads to the plant's goal around the regions by a row of the last rank,
            or, for programs with weights, by the input nearest u* that moves along the way; "local"
            circulates around what stops u*, where no goal is known; a dict ``{"kind": "geodesic",
            "through": p}`` lets ranks from p on give way to it; None leaves the way to the
            policy.
        margin: what rows on the position reserve between h and zero [m]; None derives it from what
            is uncertain.
        solver: "daqp", "clarabel" or any solver that qpsolvers knows; None means the compiled
            programs where u has two entries, else "daqp".
        on_alarm: "warn" or "brake", where the plant is not the one that was declared; None takes
            the plant's.
        allow_late_inputs: whether a barrier may have a row that misses an input which helps by a
            later derivative; a warning then replaces the refusal.
        certificate: a `certificates.Certificate`, the path of its file, or the name of a shipped
            one: rows reserve its margins, and `covered` says what it covers. None leaves both to
            the plant, which follows a shipped one where there is one.
        **options: `alpha1` (default: the paper's logarithm) and `alpha2` (default: gain 2), class-K
            functions as `barriers.class_k.make` reads them; all else goes to the program, such as
            `gamma0`, `delta_gamma`, `lambda_u`, `epsilon`.

    Raises:
        UnknownNameError: if a name is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range, the environment has no plant,
            or a wrapper inside changes the actions.

    Examples:
        >>> import gymnasium as gym, hcbf_gym
        >>> env = gym.make("HCBF-Regions-v0", scenario="paper-simulation")
        >>> env = hcbf_gym.wrappers.SafetyFilter(env, program="h-cbf-qp", gamma0=5.0)
        >>> policy = hcbf_gym.policies.PDTracker.for_env(env)
        >>> obs, info = env.reset(seed=0)
        >>> obs, reward, terminated, truncated, info = env.step(policy(obs, info))
        >>> info["safety_filter"]["status"]
        np.int64(2)
    """

    def __init__(
        self,
        env: gym.Env,
        program: programs.Named = "lex-cbf-qp",
        plant: Plant | None = None,
        rows: str = "held",
        guidance: Any = None,
        margin: float | None = None,
        solver: str | None = None,
        on_alarm: str | None = None,
        allow_late_inputs: bool = False,
        certificate: str | Path | Certificate | None = None,
        **options: Any,
    ):
        RecordConstructorArgs.__init__(
            self,
            program=programs.plain(program),
            plant=plant,
            rows=rows,
            guidance=guidance,
            margin=margin,
            solver=solver,
            on_alarm=on_alarm,
            allow_late_inputs=allow_late_inputs,
            certificate=records.plain(certificate),
            **plain_options(options),
        )
        gym.Wrapper.__init__(self, env)
        inner = env.unwrapped
        brought = getattr(inner, "plant", None)
        plant = _plant_of(inner) if plant is None else plant
        one = None if certificate is None else certificates.load(certificate)
        self.plant = _under(plant, one, inner)
        other = differs(plant, brought) if isinstance(brought, Plant) else []
        _check_order(env)
        _check_spaces(env.action_space, inner.action_space)
        self._input_set = _input_set(self.plant, inner.action_space)
        settings = FilterSettings(
            program, rows, guidance, margin, solver, on_alarm, allow_late_inputs, options
        )
        self._core = _core_of(self.plant, self._input_set, settings)
        self._dtype = None if self.plant.to_action is not None else env.action_space.dtype
        if self._dtype is not None:
            self._core.applied_as(self._dtype)
        self._limits = limits(settings._asdict(), self.plant, other, one)
        self._inner: Any = inner
        self._shape = (self._input_set.n_u,)
        self._observation: Any = None
        self._info: dict[str, Any] = {}
        self._begun = False
        self._readers = Readers(self.plant)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start a new episode, and report on its first state."""
        self._begun = False
        observation, info = self.env.reset(seed=seed, options=options)
        return self.join(observation, info)

    def join(self, observation: Any, info: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Begin to filter an episode that runs already, or whose scene has just changed.

        Args:
            observation: the environment's last one.
            info: the environment's last one; it gets the filter's entry.
        """
        self._observation, self._info = observation, info
        self._core.restart(np.ones(1, dtype=np.bool_))
        inner = self.env.unwrapped
        goal = read(self.plant.goal, inner, observation, info)
        extent = read(self.plant.extent, inner, observation, info)
        covered = read(self.plant.covered, inner, observation, info)
        self._core.cover(self._limits or covered)
        info["safety_filter"] = self._core.begin(*self._sense(), goal, extent)
        self._begun = True
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Filter u* and step the environment with the result.

        Raises:
            InvalidInputError: if no episode has begun, or u* is not made of n_u finite numbers.
        """
        _check_begun(self._begun)
        plant = self.plant
        wanted = action if plant.from_action is None else plant.from_action(action)
        u_nominal = _input(wanted, self._shape)
        u, report = self._core.step(u_nominal, *self._sense())
        applied = u.astype(self._dtype) if plant.to_action is None else plant.to_action(u)
        observation, reward, terminated, truncated, info = self.env.step(applied)
        self._observation, self._info = observation, info
        info["safety_filter"] = report
        return observation, reward, terminated, truncated, info

    def _sense(self) -> tuple[Any, Estimate]:
        """Return the barriers and the state as the plant gives them now."""
        return self._readers(self._inner, self._observation, self._info)


class VectorSafetyFilter(VectorWrapper, RecordConstructorArgs):
    """`SafetyFilter` for the native vector environment: all N actions in one compiled call.

    Args:
        env: ``gym.make_vec("HCBF-Regions-v0", num_envs=N)``, possibly wrapped.
        program: a name from `hcbf_gym.programs.names()`, or a `hcbf_gym.programs.Plan`.
        rows: as `SafetyFilter` takes it.
        guidance: as `SafetyFilter` takes it.
        margin: as `SafetyFilter` takes it.
        on_alarm: as `SafetyFilter` takes it.
        certificate: as `SafetyFilter` takes it.
        **options: as `SafetyFilter` takes them.

    Raises:
        UnknownNameError: if a name is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range, a wrapper inside changes the
            actions, or the environment is no native vector environment of this package.
    """

    def __init__(
        self,
        env: VectorEnv,
        program: programs.Named = "lex-cbf-qp",
        rows: str = "held",
        guidance: Any = None,
        margin: float | None = None,
        on_alarm: str | None = None,
        certificate: str | Path | Certificate | None = None,
        **options: Any,
    ):
        RecordConstructorArgs.__init__(
            self,
            program=programs.plain(program),
            rows=rows,
            guidance=guidance,
            margin=margin,
            on_alarm=on_alarm,
            certificate=records.plain(certificate),
            **plain_options(options),
        )
        VectorWrapper.__init__(self, env)
        inner: Any = env.unwrapped
        if not isinstance(inner, RegionsVectorEnv):
            raise InvalidInputError(
                f"environment: got {inner}, which is no batch that this package compiles; expected "
                'gym.make_vec("HCBF-Regions-v0", …); around single environments put a SafetyFilter '
                "on each before they are joined"
            )
        one = None if certificate is None else certificates.load(certificate)
        self.plant = _under(_plant_of(inner), one, inner)
        _check_order(env)
        _check_spaces(env.single_action_space, inner.single_action_space)
        input_set = _input_set(self.plant, inner.single_action_space)
        settings = FilterSettings(program, rows, guidance, margin, None, on_alarm, False, options)
        self._core = PlanarCore(self.plant, input_set, settings, env.num_envs)
        self._core.applied_as(env.action_space.dtype)
        self._limits = limits(settings._asdict(), self.plant, [], one)
        self._readers = Readers(self.plant)
        self._begun = False
        self._reporter = Reporter(env, "safety_filter")

    @property
    def autoreset_mode(self) -> Any:
        """How the environment starts over."""
        return self.env.unwrapped.metadata["autoreset_mode"]

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Start new episodes and report on their first states."""
        begun, self._begun = self._begun, False
        observation, info = self.env.reset(seed=cast(Any, seed), options=options)
        mask = np.ones(self.num_envs, dtype=np.bool_)
        if options is not None and "reset_mask" in options:
            mask = as_array("reset_mask", options["reset_mask"])
        self._reporter.at_reset(info, self._begin(mask), options)
        self._begun = begun or bool(mask.all())
        return observation, info

    def step(self, actions: Array) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Filter u* (N, 2) [m/s²] and step the environments with the result.

        Raises:
            InvalidInputError: if not all episodes have begun, or u* is not made of finite numbers.
        """
        _check_begun(self._begun)
        u_nominal = _input(actions, (self.num_envs, 2))
        u, report = self._core.step(u_nominal, *self._sense())
        applied = u.astype(cast(Any, self.env.action_space.dtype))
        observation, reward, terminated, truncated, info = self.env.step(applied)
        self._reporter.at_step(info, report, self._begin, terminated | truncated)
        return observation, reward, terminated, truncated, info

    def _begin(self, mask: NDArray[np.bool_]) -> dict[str, Any]:
        """Tell the core that new episodes have begun, and return the reports of all."""
        self._core.restart(mask)
        inner: Any = self.env.unwrapped
        goal = read(self.plant.goal, inner, None, {})
        extent = read(self.plant.extent, inner, None, {})
        covered = read(self.plant.covered, inner, None, {})
        self._core.cover(self._limits or covered)
        return self._core.begin(*self._sense(), goal, extent)

    def _sense(self) -> tuple[Any, Estimate]:
        """Return the barriers and the states as the plant gives them now."""
        return self._readers(self.env.unwrapped, None, {})


def _core_of(plant: Plant, input_set: InputSet, settings: FilterSettings) -> FilterCore:
    """Return the core that fits a plant: compiled for the planar double integrator."""
    if plant.model == DoubleIntegrator():
        return PlanarCore(plant, input_set, settings)
    return GeneralCore(plant, input_set, settings)


def _input(action: Any, shape: tuple[int, ...]) -> Array:
    """Return a copy of u* as float64; the cores refuse what is not finite.

    Raises:
        InvalidInputError: if it is not an array of real numbers of that shape.
    """
    given = as_array("action", action)
    if given.dtype.kind not in "fiu":
        raise InvalidInputError(f"action: got {action!r}, expected {shape} real numbers")
    u = given.astype(np.float64)
    if u.shape != shape:
        raise InvalidInputError(f"action: got shape {u.shape}, expected {shape}")
    return u


def _plant_of(env: Any) -> Plant:
    """Return the plant that an environment brings.

    Raises:
        InvalidInputError: if it brings none.
    """
    plant = getattr(env, "plant", None)
    if not isinstance(plant, Plant):
        raise InvalidInputError(
            f"environment: got {env}, which brings no plant; expected one of this package's, or "
            "plant=hcbf_gym.Plant(model, barriers, state, …), which says what the filter must know"
        )
    return plant


def _under(plant: Plant, certificate: Certificate | None, env: Any) -> Plant:
    """Return the plant as a certificate speaks of it, or as it is where none was given."""
    return plant if certificate is None else certified(plant, certificate, env)


def _check_begun(begun: bool) -> None:
    """Refuse a step before a reset, or after one that failed.

    Raises:
        InvalidInputError: if no episode has begun.
    """
    if not begun:
        raise InvalidInputError(
            "safety filter: got a step before a reset that succeeded, expected reset() first"
        )


def _check_order(env: Any) -> None:
    """Refuse what no action space shows: a held decision inside, episodes that begin unseen.

    Raises:
        InvalidInputError: if there is one.
    """
    while env is not env.unwrapped:
        if isinstance(env, gym.wrappers.Autoreset):
            raise InvalidInputError(
                "safety filter: got an Autoreset inside, so that episodes would begin without the "
                "filter; expected it outside: Autoreset(SafetyFilter(env))"
            )
        if isinstance(env, HoldAction | VectorHoldAction):
            name = type(env).__name__
            raise InvalidInputError(
                f"safety filter: got a {name} inside, so that the filter would look once in "
                f"{env.steps} steps; expected it outside: {name}(filtered, {env.steps})"
            )
        env = env.env


def _check_spaces(outer: gym.Space, inner: gym.Space) -> None:
    """Refuse a wrapper between filter and environment that changes the actions.

    Raises:
        InvalidInputError: if the action spaces differ.
    """
    if outer != inner:
        raise InvalidInputError(
            f"safety filter: got an environment whose wrappers change the actions from {inner} to "
            f"{outer}, so that the filter's input would not be what the robot gets; expected such "
            "wrappers outside: RescaleAction(SafetyFilter(env), …), not "
            "SafetyFilter(RescaleAction(env, …))"
        )


def _input_set(plant: Plant, space: gym.Space) -> InputSet:
    """Return U: the plant's own, or the environment's action space.

    Raises:
        InvalidInputError: if neither bounds u.
    """
    if plant.input_set is not None:
        return plant.input_set
    bounded = isinstance(space, gym.spaces.Box) and space.is_bounded() and len(space.shape) == 1
    if not bounded or plant.to_action is not None:
        raise InvalidInputError(
            f"plant: input_set is missing, and the action space {space} cannot take its place, "
            "expected an input_set, or a bounded Box of shape (n_u,) that u shares"
        )
    assert isinstance(space, gym.spaces.Box)
    return Box(space.low.astype(np.float64), space.high.astype(np.float64))
