"""What a filter's wrapper refuses before it filters anything."""

import dis
import functools
import inspect
from typing import Any

import gymnasium as gym
from gymnasium.vector import SyncVectorEnv, VectorEnv
from gymnasium.wrappers.vector import DictInfoToList

from hcbf_gym.errors import InvalidInputError, instance
from hcbf_gym.models import input_sets
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Plant
from hcbf_gym.wrappers.hold import HoldAction, VectorHoldAction

TRANSFORM = (
    gym.ObservationWrapper,
    gym.vector.VectorObservationWrapper,
    gym.wrappers.MaxAndSkipObservation,
)
"""Wrappers that make other observations, also where the space is the same."""
OBSERVATION, INFO = 1, 2
"""Places of a reader's arguments."""


def plant_of(env: object) -> Plant:
    """Return the plant that an environment brings.

    Raises:
        InvalidInputError: if it brings none.
    """
    plant = getattr(env, "plant", None)
    if isinstance(plant, Plant):
        return plant
    joined = "; around single environments put a SafetyFilter on each before they are joined"
    raise InvalidInputError(
        f"environment: got {env}, which brings no plant; expected one of this package's, or "
        "plant=hcbf_gym.Plant(model, barriers, state, …), what the filter must know"
        + joined
        * isinstance(env, VectorEnv)
    )


def check_order(env: Any) -> None:
    """Refuse what no action space shows: a held decision inside, episodes that begin unseen.

    Raises:
        InvalidInputError: if there is one, or infos of another form.
    """
    while env is not env.unwrapped:
        name, wrong = type(env).__name__, ""
        if isinstance(env, DictInfoToList):
            wrong = "whose infos are no dict", "DictInfoToList(VectorSafetyFilter(env))"
        elif isinstance(env, gym.wrappers.Autoreset):
            wrong = "so that episodes would begin unfiltered", "Autoreset(SafetyFilter(env))"
        elif isinstance(env, HoldAction | VectorHoldAction):
            seldom = f"so that the filter would look once in {env.steps} steps"
            wrong = seldom, f"{name}(filtered, {env.steps})"
        if wrong:
            raise InvalidInputError(
                f"safety filter: got a {name} inside, {wrong[0]}; expected it outside: {wrong[1]}"
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
        reader: a function, or anything else.
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


def check_spaces(plant: Plant, outer: gym.Space, inner: gym.Space) -> None:
    """Refuse a wrapper that changes the actions, and an action space that cannot hold u.

    Raises:
        InvalidInputError: if the action spaces differ; or u is the environment's action, and the
            space is no Box of (n_u,) numbers of 32 or 64 bits.
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
    is_box = isinstance(outer, gym.spaces.Box) and outer.dtype.char in "fd"
    if plant.to_action is None and not (is_box and outer.shape == (plant.model.n_u,)):
        raise InvalidInputError(
            f"action space: got {outer}, expected a Box of shape ({plant.model.n_u},) and dtype "
            "float32 or float64, which can hold u; where actions are others, give "
            "Plant(to_action=…, from_action=…)"
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
