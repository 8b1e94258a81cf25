"""What a filter's wrapper refuses before it filters anything."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, as_array, shown
from hcbf_gym.models.input_sets import Box, InputSet
from hcbf_gym.models.plant import Plant
from hcbf_gym.wrappers.hold import HoldAction, VectorHoldAction

JOINED = "; around single environments put a SafetyFilter on each before they are joined"


def real_input(action: object, shape: tuple[int, ...]) -> Array:
    """Return a copy of u* as float64; the cores refuse what is not finite.

    Raises:
        InvalidInputError: if it is not an array of real numbers of that shape.
    """
    given = as_array("action", action)
    if given.dtype.kind not in "fiu":
        raise InvalidInputError(f"action: got {shown(action)}, expected {shape} real numbers")
    u = given.astype(np.float64)
    if u.shape != shape:
        raise InvalidInputError(f"action: got shape {u.shape}, expected {shape}")
    return u


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


def check_begun(begun: bool) -> None:
    """Refuse a step before a reset, or after one that failed.

    Raises:
        InvalidInputError: if no episode has begun.
    """
    if not begun:
        raise InvalidInputError(
            "safety filter: got a step before a reset that succeeded, expected reset() first"
        )


def check_order(env: Any) -> None:
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


def check_spaces(outer: gym.Space, inner: gym.Space) -> None:
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
    assert isinstance(space, gym.spaces.Box)
    return Box(space.low.astype(np.float64), space.high.astype(np.float64))
