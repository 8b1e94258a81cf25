"""What a filter's wrapper refuses before it filters anything."""

import dis
import functools
import inspect
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import SyncVectorEnv, VectorEnv
from gymnasium.wrappers.vector import DictInfoToList

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, floats, instance
from hcbf_gym.models import input_sets
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Plant
from hcbf_gym.wrappers.hold import HoldAction, VectorHoldAction

_FLOATS = np.dtype(np.float64), np.dtype(np.float32)
TRANSFORM = (
    gym.ObservationWrapper,
    gym.vector.VectorObservationWrapper,
    gym.wrappers.MaxAndSkipObservation,
)
"""Wrappers that make other observations, also where the space is the same."""
OBSERVATION, INFO = 1, 2
"""Places of a reader's arguments."""
JOINED = "; around single environments put a SafetyFilter on each before they are joined"


def real_input(action: object, shape: tuple[int, ...]) -> Array:
    """Return a copy of u* as float64; the cores refuse what is not finite.

    Raises:
        InvalidInputError: if it is not an array of 32 or 64 bits of that shape.
    """
    if type(action) is np.ndarray and action.dtype in _FLOATS and action.shape == shape:
        return action.astype(_FLOATS[0])
    return floats("action", action, shape).astype(np.float64)


def plant_of(env: object) -> Plant:
    """Return the plant that an environment brings.

    Raises:
        InvalidInputError: if it brings none.
    """
    plant = getattr(env, "plant", None)
    if not isinstance(plant, Plant):
        raise InvalidInputError(
            f"environment: got {env}, which brings no plant; expected one of this package's, or "
            "plant=hcbf_gym.Plant(model, barriers, state, …), which says what the filter must know"
            + JOINED
            * isinstance(env, VectorEnv)
        )
    return plant


def check_order(env: Any) -> None:
    """Refuse what no action space shows: a held decision inside, episodes that begin unseen.

    Raises:
        InvalidInputError: if there is one, or infos of another form.
    """
    while env is not env.unwrapped:
        if isinstance(env, DictInfoToList):
            raise InvalidInputError(
                "safety filter: got a DictInfoToList inside, whose infos are no dict; expected it "
                "outside: DictInfoToList(VectorSafetyFilter(env))"
            )
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


def check_observations(env: Any, plant: Plant) -> None:
    """Refuse wrappers that transform what the plant's readers read.

    Args:
        env: as the filter is put around it.
        plant: of it.

    Raises:
        InvalidInputError: if a wrapper inside transforms observations, and a reader reads them.
    """
    fields = ("state", "barriers", "goal", "extent")
    reading = [name for name in fields if reads(getattr(plant, name), OBSERVATION)]
    wrapper = _transforming(env)
    if reading and wrapper is not None:
        name = type(wrapper).__name__
        raise InvalidInputError(
            f"safety filter: got a {name} inside, which transforms observations, with a plant "
            f"whose {' and '.join(reading)} may read them; expected it outside: {name}(filtered, "
            "…), or readers (env, observation, info) that read env or info alone"
        )


def _transforming(env: Any) -> Any:
    """Return the outermost wrapper that transforms observations; None where there is none."""
    while env is not env.unwrapped:
        named = isinstance(env, TRANSFORM)
        if named or env.observation_space != env.env.observation_space:
            return env
        env = env.env
    singles = env.envs if isinstance(env, SyncVectorEnv) else ()
    return next(filter(None, map(_transforming, singles)), None)


READERS_OF_ALL = {"eval", "exec", "locals", "vars"}
"""What reads every argument of the function that calls it."""


def reads(reader: object, at: int) -> bool:
    """Return whether a reader (env, observation, info) of a plant may read one of its arguments.

    Its own code decides. Where that is not known, as of a callable of C, it may.

    Args:
        reader: a function, or what is no reader.
        at: which argument.
    """
    if not callable(reader):
        return False
    while isinstance(reader, functools.partial):
        at += len(reader.args)
        reader = reader.func
    if not inspect.isroutine(reader):
        reader = type(reader).__call__
        at += 1
    elif inspect.ismethod(reader):
        at += 1
    code = getattr(inspect.unwrap(reader), "__code__", None)
    if code is None or not READERS_OF_ALL.isdisjoint(code.co_names):
        return True
    name = code.co_varnames[at] if at < code.co_argcount else None
    if name is None and code.co_flags & inspect.CO_VARARGS:
        name = code.co_varnames[code.co_argcount + code.co_kwonlyargcount]
    if name is None or name in code.co_cellvars:
        return True
    loads = (one for one in dis.get_instructions(code) if "LOAD" in one.opname)
    return any(
        name in (one.argval if isinstance(one.argval, tuple) else (one.argval,)) for one in loads
    )


def check_spaces(outer: gym.Space, inner: gym.Space) -> None:
    """Refuse a wrapper between filter and environment that changes the actions.

    Raises:
        InvalidInputError: if the action spaces differ.
    """
    instance("action space", outer, gym.Space)
    instance("action space", inner, gym.Space)
    if outer != inner:
        raise InvalidInputError(
            f"safety filter: got an environment whose wrappers change the actions from {inner} to "
            f"{outer}, so that the filter's input would not be what the robot gets; expected such "
            "wrappers outside: RescaleAction(SafetyFilter(env), …), not "
            "SafetyFilter(RescaleAction(env, …))"
        )


def input_set_of(plant: Plant, space: gym.Space) -> InputSet:
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
    return input_sets.read("action space", space)


def check_type(plant: Plant, space: gym.Space) -> None:
    """Refuse an action space that cannot hold u.

    Raises:
        InvalidInputError: if u is the environment's action, and the space is no Box of (n_u,)
            numbers of 32 or 64 bits.
    """
    if plant.to_action is not None:
        return
    is_box = isinstance(space, gym.spaces.Box) and space.dtype.char in "fd"
    if not is_box or space.shape != (plant.model.n_u,):
        raise InvalidInputError(
            f"action space: got {space}, expected a Box of shape ({plant.model.n_u},) and dtype "
            "float32 or float64, which can hold u; where actions are others, give "
            "Plant(to_action=…, from_action=…)"
        )
