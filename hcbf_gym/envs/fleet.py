"""Many environments on all cores: a vector environment whose processes step a group each."""

import contextlib
import itertools
import math
import multiprocessing
import signal
import sys
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Any

import joblib
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import CloudpickleWrapper, batch_space
from numpy.typing import NDArray

from hcbf_gym.arrays import Array, Info, Mask, Records
from hcbf_gym.envs import infos as vector_infos
from hcbf_gym.envs.fleet_group import Group, Maker, first_report, layout
from hcbf_gym.envs.task import check_seeds
from hcbf_gym.errors import HcbfError, InvalidInputError, as_array, floats

_PATIENCE = 5.0
"""How long a process may take to close its environments [s]."""


class FleetVectorEnv(VectorEnv[Any, Any, NDArray[Any]]):
    """N environments in as many groups as there are cores; equal to Gymnasium's `SyncVectorEnv`.

    This process steps the first group, one more process each of the others. They share a memory to
    which every environment writes its own observation, reward and infos: nothing is pickled, and
    nothing is gathered environment by environment. So this suits environments of some 100 µs a
    step, where the pipes of `AsyncVectorEnv` cost as much as the step.

    Environment i is seeded with ``seed + i``. With mode "Disabled" an environment that has ended
    steps on until it is reset.

    Args:
        makers: N functions that make an environment, filtered as wanted. All must have boxes of
            one shape, and always report the same infos: numbers and arrays of one shape.
        processes: of which this is one; None for as many as this process may use cores.
        autoreset_mode: Gymnasium's "NextStep", "SameStep" or "Disabled".

    Raises:
        InvalidInputError: if there is no maker, a space is no box, infos hold something else than
            numbers, or there are more processes than environments.

    Examples:
        >>> import gymnasium as gym, hcbf_gym
        >>> from hcbf_gym.envs.fleet import FleetVectorEnv
        >>> def make():
        ...     return hcbf_gym.wrappers.SafetyFilter(gym.make("HCBF-Regions-v0"))
        >>> fleet = FleetVectorEnv([make] * 4, processes=2)
        >>> observation, infos = fleet.reset(seed=0)
        >>> observation, reward, terminated, truncated, infos = fleet.step(np.zeros((4, 2)))
        >>> infos["safety_filter"]["u_safe"].shape
        (4, 2)
        >>> fleet.close()
    """

    def __init__(
        self,
        makers: Sequence[Maker],
        processes: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
    ):
        self.num_envs = len(makers)
        count = min(joblib.cpu_count(), self.num_envs) if processes is None else processes
        if not 1 <= count <= self.num_envs:
            raise InvalidInputError(
                f"fleet: got {self.num_envs} makers and {count} processes, expected at least one "
                "of each, and no process without an environment"
            )
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        first = makers[0]()
        self.metadata = first.metadata | {"autoreset_mode": self.autoreset_mode}
        self.render_mode, self.spec = first.render_mode, first.spec
        self.single_observation_space = _box("observation", first.observation_space)
        self.single_action_space = _box("action", first.action_space)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        # a forked process lacks JAX's threads
        start: Any = multiprocessing.get_context("spawn" if "jax" in sys.modules else None)
        record = layout(first_report(first))
        self._now = _Shared(start, record, (self.num_envs,))
        self._last = _Shared(start, record, (self.num_envs,))
        action = np.dtype(np.float64)
        self._actions = _Shared(start, action, self.action_space.shape or ())
        shared = self._actions, self._now, self._last
        bounds = np.linspace(0, self.num_envs, count + 1).astype(int).tolist()
        here, *elsewhere = (slice(*ends) for ends in itertools.pairwise(bounds))
        self._groups = [here, *elsewhere]
        self._pipes: list[Connection] = []
        self._processes = []
        for group in elsewhere:
            mine, theirs = start.Pipe()
            self._pipes.append(mine)
            told = (
                [CloudpickleWrapper(make) for make in makers[group]],
                self.autoreset_mode,
                shared,
                group,
            )
            served = start.Process(target=_serve, args=(theirs, self._pipes, *told), daemon=True)
            served.start()
            theirs.close()
            self._processes.append(served)
        envs = [first, *(make() for make in makers[here][1:])]
        self._group = Group(envs, self.autoreset_mode, *(memory.array[here] for memory in shared))
        self._hear()

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, object] | None = None,
    ) -> tuple[Any, Info]:
        """Start new episodes in all environments, or in those of ``options["reset_mask"]``.

        Args:
            seed: of environment 0, the others follow; or one for each.
            options: "reset_mask" (N,), and what a single environment takes.

        Raises:
            InvalidInputError: if the mask is none, or the seeds are not N.
        """
        given = None if options is None else dict(options)
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        mask = everyone
        if given is not None:
            mask = as_array("reset_mask", given.pop("reset_mask", everyone))
        if mask.shape != everyone.shape or mask.dtype != np.bool_ or not mask.any():
            raise InvalidInputError(
                f"reset_mask: got {mask!r}, expected ({self.num_envs},) of bool with a True"
            )
        seeds = check_seeds(seed, self.num_envs)
        self._ask("reset", *((seeds[group], mask[group], given) for group in self._groups))
        now = self._now.array.copy()
        infos = vector_infos.only(vector_infos.with_masks(_fields(now["info"]), everyone), mask)
        return now["observation"].copy(), infos

    def step(self, actions: object) -> tuple[Any, Array, Mask, Mask, Info]:
        """Step every environment.

        Raises:
            InvalidInputError: if the actions (N, …) are no numbers or of another shape.
        """
        expected = self._actions.array
        expected[...] = floats("actions", actions, expected.shape)
        self._ask("step", *((),) * len(self._groups))
        now = self._now.array.copy()
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        infos = vector_infos.with_masks(_fields(now["info"]), everyone)
        terminated, truncated = now["terminated"].copy(), now["truncated"].copy()
        ended = terminated | truncated
        if self.autoreset_mode is AutoresetMode.SAME_STEP and ended.any():
            last = self._last.array
            of_step = vector_infos.with_masks(_fields(last["info"]), everyone)
            infos |= vector_infos.endings(of_step, ended, last["observation"])
        return now["observation"].copy(), now["reward"].copy(), terminated, truncated, infos

    def call(self, name: str, *args: object, **kwargs: object) -> tuple[Any, ...]:
        """Return each environment's attribute, or what it returns where it can be called."""
        answers = self._ask("call", *((name, args, kwargs),) * len(self._groups))
        return tuple(one for answer in answers for one in answer)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return each environment's attribute."""
        return self.call(name)

    def render(self) -> tuple[Any, ...]:
        """Return each environment's picture."""
        return self.call("render")

    def close_extras(self, **kwargs: object) -> None:
        """Close all environments, and end the other processes."""
        self._group.close()
        for pipe in self._pipes:
            pipe.close()  # its process ends
        for process in self._processes:
            process.join(_PATIENCE)
            process.kill()

    def _ask(self, command: str, *told: tuple[object, ...]) -> list[Any]:
        """Return what each group answers to a command.

        Args:
            command: a method of `Group`.
            told: its arguments, for each group.
        """
        here, *elsewhere = told
        for pipe, arguments in zip(self._pipes, elsewhere, strict=True):
            with contextlib.suppress(OSError):  # it died, as its silence will tell
                pipe.send((command, arguments))
        try:
            answer = getattr(self._group, command)(*here)
        finally:
            answers = self._hear()
        return [answer, *answers]

    def _hear(self) -> list[Any]:
        """Return what the other processes answer.

        Raises:
            HcbfError: if one has died.
            Exception: what an environment has raised there.
        """
        answers = []
        for k, pipe in enumerate(self._pipes):
            try:
                answers.append(pipe.recv())
            except (EOFError, OSError) as error:
                code = self._processes[k].exitcode
                raise HcbfError(
                    f"fleet: process {k + 1} died (exit code {code}), expected an answer"
                ) from error
        for answer in answers:
            if isinstance(answer, Exception):
                raise answer
        return answers


class _Shared:
    """An array in memory that all processes of a fleet see.

    Args:
        start: how they start.
        dtype: of the entries.
        shape: of the array.
    """

    def __init__(self, start: Any, dtype: np.dtype, shape: tuple[int, ...]):
        self._dtype, self._shape = dtype, shape
        self._memory = start.RawArray("b", dtype.itemsize * math.prod(shape))

    @property
    def array(self) -> Records:
        """The array; no copy."""
        return np.ndarray(self._shape, self._dtype, self._memory)


def _serve(
    pipe: Connection,
    inherited: Sequence[Connection],
    makers: Sequence[Maker],
    mode: AutoresetMode,
    shared: tuple[_Shared, _Shared, _Shared],
    group: slice,
) -> None:
    """Do in a process of its own what the fleet asks of a group, until the pipe is closed."""
    for other in inherited:
        other.close()  # the fleet's own ends: else nobody would see it close them
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the fleet's process closes the pipe
    served: Any = None
    try:
        envs = [make() for make in makers]
        served = Group(envs, mode, *(memory.array[group] for memory in shared))
        pipe.send(None)
        while True:
            command, arguments = pipe.recv()
            try:
                answer = getattr(served, command)(*arguments)
            except Exception as error:
                answer = error
            pipe.send(answer)
    except EOFError:
        served.close()
    except Exception as error:  # of a maker
        pipe.send(error)


def _fields(records: Records) -> Info:
    """Return the arrays (N, …) of records by the names of their fields, nested as these are."""
    return {
        name: _fields(records[name]) if records[name].dtype.names else records[name]
        for name in records.dtype.names or ()
    }


def _box(what: str, space: object) -> spaces.Box:
    """Return a space that is a box.

    Raises:
        InvalidInputError: if it is another one.
    """
    if not isinstance(space, spaces.Box):
        raise InvalidInputError(f"fleet: got the {what} space {space}, expected a Box")
    return space
