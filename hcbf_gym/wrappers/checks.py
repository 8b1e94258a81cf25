"""Checks of environment and plant, before a filter's wrapper filters anything."""

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

TRANSFORMING_WRAPPERS = (
    gym.ObservationWrapper,
    gym.vector.VectorObservationWrapper,
    gym.wrappers.MaxAndSkipObservation,
)
"""Wrappers that change observations, even where the observation space stays the same."""
OBSERVATION, INFO = 1, 2  # positions among a reader's arguments (env, observation, info)
READERS_OF_ALL = {"eval", "exec", "locals", "vars"}
"""Built-in functions that may read every argument of the function that calls them."""


def plant_of(env: object) -> Plant:
    """Return an environment's attribute `plant`.

    Raises:
        InvalidInputError: if it has none.
    """
    plant = getattr(env, "plant", None)
    if isinstance(plant, Plant):
        return plant
    remedy = ""
    if isinstance(env, VectorEnv):
        remedy = "; around single environments put a SafetyFilter on each before they are joined"
    raise InvalidInputError(
        f"environment: got {env}, which brings no plant; expected one of this package's, or "
        f"plant=hcbf_gym.Plant(model, barriers, state, …), what the filter must know{remedy}"
    )


def check_order(env: Any) -> None:
    """Refuse wrappers inside the filter that belong outside, which no action space shows.

    Raises:
        InvalidInputError: if one holds decisions, begins episodes, or gives infos another form.
    """
    while env is not env.unwrapped:
        name, problem, remedy = type(env).__name__, "", ""
        if isinstance(env, DictInfoToList):
            problem, remedy = "whose infos are no dict", "DictInfoToList(VectorSafetyFilter(env))"
        elif isinstance(env, gym.wrappers.Autoreset):
            problem = "so that episodes would begin unfiltered"
            remedy = "Autoreset(SafetyFilter(env))"
        elif isinstance(env, HoldAction | VectorHoldAction):
            problem = f"so that the filter would look once in {env.steps} steps"
            remedy = f"{name}(filtered, {env.steps})"
        if problem:
            raise InvalidInputError(
                f"safety filter: got a {name} inside, {problem}; expected it outside: {remedy}"
            )
        env = env.env


def check_observations(env: Any, plant: Plant) -> None:
    """Refuse an environment whose wrappers transform observations that the plant's readers read.

    Raises:
        InvalidInputError: if there are such wrappers, and a reader may read observations.
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
        is_known = isinstance(env, TRANSFORMING_WRAPPERS)
        if is_known or env.observation_space != env.env.observation_space:
            return env
        env = env.env
    for single in env.envs if isinstance(env, SyncVectorEnv) else ():
        wrapper = _transforming(single)
        if wrapper is not None:
            return wrapper
    return None


def reads(reader: object, position: int) -> bool:
    """Return whether a plant's reader (env, observation, info) may read one of its arguments.

    The reader's bytecode decides. A callable without bytecode, such as one of C, may read all.

    Args:
        reader: a function or another callable; anything else reads nothing.
        position: the argument's position.
    """
    if not callable(reader):
        return False
    while isinstance(reader, functools.partial):
        position += len(reader.args)
        reader = reader.func
    if not inspect.isroutine(reader):
        reader = type(reader).__call__
        position += 1  # self comes first
    elif inspect.ismethod(reader):
        position += 1
    code = getattr(inspect.unwrap(reader), "__code__", None)
    if code is None or not READERS_OF_ALL.isdisjoint(code.co_names):
        return True
    name = code.co_varnames[position] if position < code.co_argcount else None
    if name is None and code.co_flags & inspect.CO_VARARGS:  # the argument is one of *args
        name = code.co_varnames[code.co_argcount + code.co_kwonlyargcount]
    if name is None or name in code.co_cellvars:  # an inner function may read it
        return True
    loads = [load.argval for load in dis.get_instructions(code) if "LOAD" in load.opname]
    return any(name in load if isinstance(load, tuple) else name == load for load in loads)


def check_spaces(plant: Plant, outer: gym.Space, inner: gym.Space) -> None:
    """Refuse a wrapper that changes the actions, and an action space that cannot hold u.

    The action spaces are `outer`, with the environment's wrappers, and `inner`, without them.

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
    """Return U, which is the plant's input set or else the environment's action space.

    Raises:
        InvalidInputError: if neither bounds u.
    """
    if plant.input_set is not None:
        return plant.input_set
    is_bounded = isinstance(space, gym.spaces.Box) and space.is_bounded() and len(space.shape) == 1
    if not is_bounded or plant.to_action is not None:
        raise InvalidInputError(
            f"plant: input_set is missing, and the action space {space} cannot take its place, "
            "expected an input_set, or a bounded Box of shape (n_u,) that u shares"
        )
    return input_sets.read("action space", space)
