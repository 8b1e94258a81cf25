"""The wrapper that puts a program between a policy and an environment."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.core import ActType, ObsType
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import RecordConstructorArgs

from hcbf_gym import programs
from hcbf_gym.arrays import Info
from hcbf_gym.certificates import Certificate
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models.plant import Plant
from hcbf_gym.wrappers.arguments import record_filter, with_plant
from hcbf_gym.wrappers.filter_base import FilterBase


class SafetyFilter(
    FilterBase, gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs
):
    """Filters every action through one of the programs, so that any policy respects the ranking.

    The policy's action u* goes to the program. The environment receives the program's input u.
    ``info["safety_filter"]`` holds the fields of `hcbf_gym.filter.bound`: u* and u, each row's
    slack, relaxation and margin, `status` (a `hcbf_gym.programs.FilterStatus`), `reason` (a
    `hcbf_gym.models.Reason`), `covered` (a `hcbf_gym.models.Coverage`), `covered_by` (why, a
    `hcbf_gym.models.CoveredBy`), `intervention` ‖u − u*‖, and `deadlock`: 1 where a planar double
    integrator is at rest (‖v‖ < 0.05 m/s) though u* requests motion (‖u*‖ > 0.3 m/s²). `reset`
    reports the same keys.

    Args:
        env: an environment of this package, possibly wrapped; any other with its `plant`. Wrappers
            that change actions belong outside the filter.
        program: a name from `hcbf_gym.programs.names()`, or a `hcbf_gym.programs.Plan`.
        plant: what the filter must know of the environment; None takes ``env.unwrapped.plant``.
        rows: "held" preserves h ≥ 0 while an input is held, "usual" at the samples alone. Plants
            other than the planar double integrator, or of unknown period, have usual rows.
        guidance: "geodesic" leads to the plant's goal around the regions by a row of the last rank,
            or, for programs with weights, by the input nearest u* that moves along the path;
            "local" circulates around what stops u*, where no goal is known; in a dict ``{"kind":
            "geodesic", "through": p}`` ranks from p on are relaxed for it; None leaves the path to
            the policy.
        margin: what rows on the position reserve between h and zero [m]; None derives it from what
            is uncertain.
        solver: "daqp", "clarabel" or any solver that qpsolvers knows, as a second opinion; None
            means the core.
        on_alarm: "warn" or "brake", where the plant is not the one that was declared; None takes
            the plant's.
        allow_late_inputs: whether a barrier may have a row that misses an input which helps by a
            later derivative; a warning then replaces the refusal.
        certificate: a `certificates.Certificate`, the path of its file, or the name of a shipped
            one: rows reserve its margins, and `covered` follows it. None leaves both to the plant,
            which follows a shipped one where there is one.
        strict: "rows", or "gatekeeper": verified manoeuvres satisfy strict conditions, which bind
            the input less (``docs/gatekeeper.md``); ``{"kind": "gatekeeper", "directions": 16,
            "manoeuvres": ["mine"]}`` has more of it. For the planar double integrator.
        **options: `alpha1` (default: the paper's logarithm), `alpha2` and, for speed limits and
            zones, `alpha_speed` (default: linear with the plant's gain), class-K functions as
            `barriers.class_k.make` reads them; all else goes to the program, such as `gamma0`,
            `delta_gamma`, `lambda_u`, `epsilon`.

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
        env: gym.Env[ObsType, ActType],
        program: programs.Named = "lex-cbf-qp",
        plant: Plant | None = None,
        rows: str = "held",
        guidance: str | Mapping[str, object] | None = None,
        margin: float | None = None,
        solver: str | None = None,
        on_alarm: str | None = None,
        allow_late_inputs: bool = False,
        certificate: str | Path | Certificate | None = None,
        strict: str | Mapping[str, object] = "rows",
        **options: Any,
    ):
        settings = FilterSettings(
            program, rows, guidance, margin, solver, on_alarm, allow_late_inputs, options, strict
        )
        record_filter(self, env, gym.Env, plant, settings, certificate)
        gym.Wrapper.__init__(self, env)
        spaces = env.action_space, env.unwrapped.action_space
        self._prepare(spaces, plant, settings, certificate)
        self._has_own_plant = plant is not None

    @property
    def spec(self) -> EnvSpec | None:
        """The id and arguments that make it again, as JSON only without an argument `plant`."""
        spec = super().spec
        return with_plant(spec) if self._has_own_plant and spec is not None else spec

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[ObsType, Info]:
        """Start a new episode, and report on its first state."""
        self._begun = False
        observation, info = self.env.reset(seed=seed, options=options)
        return self._begin_with(observation, info, joins=False)

    def join(self, observation: ObsType, info: Info) -> tuple[ObsType, Info]:
        """Begin to filter an episode that runs already, or whose scene has just changed.

        Args:
            observation: the environment's last observation.
            info: the environment's last infos, to which the filter's entry is added.
        """
        return self._begin_with(observation, info, joins=True)

    def _begin_with(self, observation: ObsType, info: Info, *, joins: bool) -> tuple[ObsType, Info]:
        """Begin to filter an episode, and write the report of its first state."""
        self._see(observation, info)
        info["safety_filter"] = self._begin(np.ones(1, dtype=np.bool_), joins)
        self._begun = True
        return observation, info

    def _report(self, info: Info, report: Info, terminated: bool, truncated: bool) -> None:
        info["safety_filter"] = report
