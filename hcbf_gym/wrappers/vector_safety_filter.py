"""The wrapper that puts a program between policies and a vector environment."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from hcbf_gym import programs
from hcbf_gym.arrays import Array, Info, Mask
from hcbf_gym.certificates import Certificate
from hcbf_gym.envs.infos import Reporter
from hcbf_gym.errors import InvalidInputError, as_array
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models.plant import Plant
from hcbf_gym.wrappers.arguments import record_filter
from hcbf_gym.wrappers.filter_base import FilterBase
from hcbf_gym.wrappers.infos import joined, reported


class VectorSafetyFilter(FilterBase, VectorWrapper, RecordConstructorArgs):
    """`SafetyFilter` around N plants, which filters all actions of two inputs in one compiled call.

    It wraps ``gym.make_vec("HCBF-Regions-v0", num_envs=N)``, or any vector environment of Gymnasium
    with a `plant`. The plant's readers return the state of all N, as (N, n) or as one `Estimate`,
    and the barriers as one list for all or as N lists. Of planar double integrators, a `BarrierSet`
    of N scenes is the fastest. A state that is not finite brakes its plant alone.

    Args:
        env: possibly wrapped; wrappers that change actions belong outside the filter.
        plant: the plant that all N share; None takes ``env.unwrapped.plant``. `to_action` and
            `from_action` get the inputs and the actions of all N.
        threads: the number of cores that filter at once; the results are the same.

    All other arguments are those of `SafetyFilter`.

    Raises:
        UnknownNameError, InvalidInputError: as `SafetyFilter` does, or without an autoreset mode.
    """

    def __init__(
        self,
        env: VectorEnv,
        program: programs.Named = "lex-cbf-qp",
        plant: Plant | None = None,
        rows: str = "held",
        guidance: str | Mapping[str, object] | None = None,
        margin: float | None = None,
        on_alarm: str | None = None,
        allow_late_inputs: bool = False,
        certificate: str | Path | Certificate | None = None,
        threads: int = 1,
        strict: str | Mapping[str, object] = "rows",
        **options: Any,
    ):
        settings = FilterSettings(
            program, rows, guidance, margin, None, on_alarm, allow_late_inputs, options, strict
        )
        record_filter(self, env, VectorEnv, plant, settings, certificate, threads=threads)
        VectorWrapper.__init__(self, env)
        if "autoreset_mode" not in env.metadata:
            raise InvalidInputError(
                f"environment: got {env} without metadata['autoreset_mode'], expected one of "
                "Gymnasium's AutoresetMode, by which episodes begin anew"
            )
        inner = cast(VectorEnv, env.unwrapped)
        spaces = env.single_action_space, inner.single_action_space
        self._prepare(spaces, plant, settings, certificate, env.num_envs, threads)
        self._reporter = Reporter(env, "safety_filter")

    @property
    def autoreset_mode(self) -> AutoresetMode:
        """Gymnasium's autoreset mode of the environment."""
        return self.env.metadata["autoreset_mode"]

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, object] | None = None,
    ) -> tuple[Any, Info]:
        """Start new episodes and report on their first states."""
        had_begun, self._begun = self._begun, False
        mask = np.ones(self.num_envs, dtype=np.bool_)
        if options is not None and "reset_mask" in options:
            mask = as_array("reset_mask", options["reset_mask"])
        copy = None if options is None else dict(options)  # Gymnasium takes the mask out of it
        observation, info = self.env.reset(seed=cast(Any, seed), options=copy)
        self._see(observation, info, mask)
        self._reporter.at_reset(info, self._begin(mask), options)
        self._begun = had_begun or bool(mask.all())
        return observation, info

    def _see(self, observation: object, info: Info, begins: Mask | None = None) -> None:
        """Store the data that readers read, with NaN for unreported infos.

        Where only some episodes begin, in the mask (N,), the others keep their infos.
        """
        before = self._info
        super()._see(observation, info)
        if self._copies_info:
            self._info = reported(self._info)
            if begins is not None and not begins.all():
                self._info = joined(self._info, before, begins)

    def step(  # pyright: ignore[reportIncompatibleMethodOverride] - as Gymnasium names it
        self, actions: Array
    ) -> tuple[Any, Array, Mask, Mask, Info]:
        """Filter u* (N, n_u) and step the environments with the result."""
        return super().step(actions)

    def _report(self, info: Info, report: Info, terminated: object, truncated: object) -> None:
        ended = as_array("terminated", terminated) | as_array("truncated", truncated)
        self._reporter.at_step(info, report, self._begin_within_step, ended)
