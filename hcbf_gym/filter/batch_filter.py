"""The filter of N planar double integrators of any simulator, for arrays of NumPy, torch or JAX."""

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hcbf_gym import programs
from hcbf_gym.arrays import Array, Info, Mask
from hcbf_gym.barriers import class_k
from hcbf_gym.barriers.many import Element, is_list
from hcbf_gym.barriers.set import BarrierSet, Condition
from hcbf_gym.errors import (
    InvalidInputError,
    as_array,
    count,
    finite_array,
    finite_float,
    floats,
    instance,
    library_of,
    reals,
)
from hcbf_gym.filter.core import FilterCore
from hcbf_gym.filter.origin import World
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models import input_sets
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import CAUTIOUS, EXACT, Coverage, Estimate, Plant, Uncertainty
from hcbf_gym.models.reduced_order import DoubleIntegrator
from hcbf_gym.programs import ConflictReport

Numbers = NDArray[Any]


class BatchFilter:
    """Filters the inputs of N planar double integrators, each in its ranked scene.

    ``ẋ = (v, u)``; u is held for one period. A plant is brought to rest alone if its state is not
    finite, missing, or of a time that does not advance: its `status` is BACKUP, with a `reason`.

    Args:
        input_set: U of each plant [m/s²].
        period: T, how long an input is held [s].
        num_envs: N; None for one plant, whose arrays have no leading N.
        program: a name from `hcbf_gym.programs.names()`, or a `hcbf_gym.programs.Plan`.
        guidance: as `wrappers.SafetyFilter` takes it.
        uncertainty: how far a plant may be from its model; the default is an exact model. If more
            than the body is declared, `Plant.gain` is 2/s instead of 10/s.
        extent: ((x_min, y_min), (x_max, y_max)) of the world [m], for guidance; None takes it from
            barriers, states and goals.
        on_alarm: "warn" or "brake", if a plant is not the one that was declared.
        threads: how many cores work at once; the result does not depend on it.
        strict: as `wrappers.SafetyFilter` takes it.
        **options: as `wrappers.SafetyFilter` takes them, and `rows`.

    Raises:
        UnknownNameError: if a name is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range, or U is not planar.

    Examples:
        >>> import numpy as np
        >>> import hcbf_gym
        >>> from hcbf_gym.barriers import Disc
        >>> from hcbf_gym.models.input_sets import Box
        >>> filt = hcbf_gym.BatchFilter(Box.symmetric(5.0), 0.02, num_envs=1000)
        >>> filt.set_scene([Disc("pillar", 1, center=(2.0, 0.0), radius=0.5)])
        >>> x = np.zeros((1000, 4))
        >>> report = filt.reset(x=x)
        >>> u, report = filt(np.ones((1000, 2)), x)
        >>> u.shape, report["h"].shape
        ((1000, 2), (1000, 1))
    """

    def __init__(
        self,
        input_set: InputSet,
        period: float,
        num_envs: int | None = None,
        program: programs.Named = "lex-cbf-qp",
        guidance: str | Mapping[str, object] | None = None,
        uncertainty: Uncertainty = EXACT,
        extent: ArrayLike | None = None,
        on_alarm: str = "warn",
        threads: int = 1,
        strict: str | Mapping[str, object] = "rows",
        **options: Any,
    ):
        input_set = input_sets.read("input_set", input_set)
        if input_set.n_u != 2:
            raise InvalidInputError(f"input_set: got {input_set!r}, expected one of two inputs")
        self.num_envs = None if num_envs is None else count("num_envs", num_envs)
        self._count = 1 if num_envs is None else int(num_envs)
        finite_float("period", period, minimum=0.0, exclusive=True)
        rows = options.pop("rows", "held")
        instance("uncertainty", uncertainty, Uncertainty)
        is_exact = uncertainty._replace(body=EXACT.body, confidence=EXACT.confidence) == EXACT
        gain = class_k.GAIN if is_exact else CAUTIOUS
        plant = Plant(
            DoubleIntegrator(), _unused_reader, _unused_reader, input_set, period=period,
            goal=None, extent=extent, uncertainty=uncertainty, gain=gain,
        )  # fmt: skip
        settings = FilterSettings(
            program, rows, guidance, None, None, on_alarm, False, options, strict
        )
        self._core = FilterCore(plant, input_set, settings, num_envs, count("threads", threads))
        self._barriers: Any = None
        self._scenes: BarrierSet | None = None
        self._goal: Array | None = None
        self._extent = extent
        self._has_begun: Mask = np.zeros(self._count, dtype=np.bool_)

    @property
    def goal(self) -> Array | None:
        """(N, 2) the goals of guidance [m]; it may be set to (2,) or (N, 2) at any time."""
        return None if self._goal is None else self._goal.copy()

    @goal.setter
    def goal(self, goal: object) -> None:
        self._goal = np.broadcast_to(self._read_goal(goal), (self._count, 2)).copy()

    def _read_goal(self, goal: object) -> Array:
        """Return a goal for all plants (2,), or one for each (N, 2)."""
        array = _as_numpy("goal", goal)
        return finite_array("goal", array, (self._count, 2) if array.ndim == 2 else (2,))

    def conditions(self, i: int = 0) -> list[Condition]:
        """Return name and rank of each row in the report of plant `i`."""
        i = count("i", i, minimum=0, maximum=self._count - 1)
        return [] if self._scenes is None else self._scenes.conditions(i)

    def conflict(self, i: int = 0) -> ConflictReport | None:
        """Return which conditions no input met together at the last step of plant `i`.

        Its `rows` are indices of `conditions(i)`. It is None if there was no conflict, or the state
        was not accepted.
        """
        return self._core.conflict(i)

    def set_scene(self, barriers: Sequence[Element] | Sequence[Sequence[Element]]) -> None:
        """Set the scenes; a filter whose scene was refused brings all plants to rest.

        Args:
            barriers: a sequence of barriers for all plants, or N such sequences. `Shapes` in a
                sequence for all may hold arrays of each plant.

        Raises:
            InvalidInputError: if they are no scenes, or a speed limit cannot be satisfied.
        """
        self._scenes = self._barriers = None
        if is_list(barriers):
            barriers = tuple(tuple(item) if is_list(item) else item for item in barriers)
        scenes = self._core.scenes.read(barriers)
        self._core.scenes.check_limits(scenes)
        self._scenes, self._barriers = scenes, barriers

    def reset(self, mask: object = None, x: object = None, goal: object = None) -> Info:
        """Begin new episodes, and return the report of their first states.

        Args:
            mask: (N,) the plants that begin; None for all.
            x: (N, 4) states, positions [m] and velocities [m/s], or an `Estimate`.
            goal: (2,) or (N, 2) the goals of guidance [m]; None keeps the present ones.

        Raises:
            InvalidInputError: if there is no scene or no state, guidance has no goal, or an array
                is of another shape.
        """
        if self._barriers is None:
            raise InvalidInputError("reset: there is no scene, expected set_scene(…) before")
        if x is None:
            raise InvalidInputError("reset: got no x, expected the states (N, 4) of all plants")
        begins: Mask = np.ones(self._count, dtype=np.bool_)
        if mask is not None:
            begins = self._read_mask("mask", _as_numpy("mask", mask))
        if goal is not None:
            previous = np.full((self._count, 2), np.nan) if self._goal is None else self._goal
            self._goal = np.where(begins[:, None], self._read_goal(goal), previous)
        if self._core.guides and (self._goal is None or not np.isfinite(self._goal[begins]).all()):
            raise InvalidInputError("goal: got none for a plant that begins, expected (x, y) [m]")
        self._has_begun &= ~begins  # a reset that fails leaves them without an episode
        self._core.restart(begins)
        self._core.cover(Coverage.OUTSIDE)
        estimate = self._read_estimate(x)
        report = self._core.begin(self._barriers, estimate, self._goal, self._extent)
        self._has_begun |= begins
        convert = _converter_to_library_of(x.x if isinstance(x, Estimate) else x)
        return {key: convert(value) for key, value in report.items()}

    def __call__(
        self,
        u_nominal: object,
        x: object,
        time: object = None,
        *,
        elapsed: object = None,
        missing: object = None,
    ) -> tuple[Any, Info]:
        """Return u and the report, as arrays of the library of u*.

        Args:
            u_nominal: u* (N, 2) [m/s²] of 32 or 64 bits; u has its type, and is as reported.
            x: (N, 4) states, positions [m] and velocities [m/s], or an `Estimate`.
            time: () or (N,) the times of the states [s]; None counts periods since the reset.
            elapsed: () or (N,) the times since the samples before [s]; None is one period.
            missing: (N,) the plants without a sample now; None for none.

        Raises:
            InvalidInputError: if not all episodes have begun, or u* is not made of finite numbers.
        """
        if not self._has_begun.all():
            raise InvalidInputError(
                f"batch filter: got a step before a reset of {int((~self._has_begun).sum())} of "
                f"{self._count} plants, expected reset(x=…) first"
            )
        shape = (2,) if self.num_envs is None else (self._count, 2)
        u_numpy = floats("u_nominal", u_nominal, shape)
        convert = _converter_to_library_of(u_nominal)
        config = self._core.config
        config.applied_as(np.float32 if u_numpy.dtype == np.float32 else np.float64)
        estimate = self._read_estimate(x, time, elapsed, missing)
        world = World(self._goal, self._extent)
        u_numpy = u_numpy.astype(np.float64)
        u, report = self._core.step(u_numpy, self._barriers, estimate, world=world)
        u = u.astype(config.dtype)
        return convert(u), {key: convert(value) for key, value in report.items()}

    def _read_estimate(
        self, x: object, time: object = None, elapsed: object = None, missing: object = None
    ) -> Estimate:
        """Return the arguments of a step as an estimate of all plants."""
        given = x if isinstance(x, Estimate) else None
        states = floats("x", _as_numpy("x", x if given is None else given.x))
        estimate = Estimate(states) if given is None else given._replace(x=states)
        if time is not None:
            time = reals("time", self._for_each_plant("time", time))
            estimate = estimate._replace(time=time)
        if elapsed is not None:
            elapsed = reals("elapsed", self._for_each_plant("elapsed", elapsed))
            estimate = estimate._replace(elapsed=elapsed)
        if missing is not None:
            is_missing = self._read_mask("missing", self._for_each_plant("missing", missing))
            age = 0.0 if estimate.age is None else estimate.age
            estimate = estimate._replace(age=np.where(is_missing, math.inf, age))
        return estimate

    def _read_mask(self, name: str, mask: Numbers) -> Mask:
        """Return (N,) booleans; refuse anything else."""
        if mask.dtype != np.bool_ or mask.shape != (self._count,):
            got = f"{name}: got {mask.dtype} {mask.shape}"
            raise InvalidInputError(f"{got}, expected bool ({self._count},)")
        return mask

    def _for_each_plant(self, name: str, value: object) -> Numbers:
        """Return a value of each plant; a single value is that of all plants."""
        array = _as_numpy(name, value)
        return np.broadcast_to(array, self._count) if array.ndim == 0 else array


def _unused_reader(*_: object) -> tuple[()]:
    """Take the place of a plant's readers, which this filter does not call."""
    return ()


def _as_numpy(name: str, value: Any) -> Numbers:
    """Return `value` as `as_array` does; masked entries are NaN."""
    if np.ma.is_masked(value) and value.dtype.kind in "fiu":
        return np.ma.filled(value.astype(np.float64), np.nan)
    return as_array(name, value)


def _converter_to_library_of(example: object) -> Callable[[Numbers], Any]:
    """Return a function that converts arrays of NumPy to the library of `example`."""
    library = library_of(example)
    if library == "torch":
        return sys.modules["torch"].as_tensor
    if library == "jax":
        return sys.modules["jax"].numpy.asarray
    return lambda array: array
