"""Policies by name, by a user's function, or by the file of a trained network."""

import importlib
import inspect
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from hcbf_gym import loading
from hcbf_gym.arrays import Array, Info
from hcbf_gym.errors import (
    InvalidInputError,
    UnknownNameError,
    as_array,
    count,
    in_words,
    instance,
    require,
    shown,
    text,
)
from hcbf_gym.policies import learned
from hcbf_gym.policies.pd import PDTracker, Policy

Make = Callable[[gym.Env], Policy]
_NAMED: dict[str, Make] = {}
FORMS = "file.py:function, module:function, model.zip, policy.onnx or policy.pt"
"""The forms of a user's policy."""


def register(name: str, make: Make) -> None:
    """Give a policy a name, for `hcbf evaluate --policy` and `make`.

    Args:
        name: a name without colon, dot and slash, which mark functions and files.
        make: (environment) → the policy of one episode in it.

    Raises:
        InvalidInputError: if the name is taken or invalid, or `make` is no function.
    """
    name = text("policy", name)
    if not name or set(name) & set(":./") or name in _NAMED:
        raise InvalidInputError(
            f"policy: got {name!r}, expected a name without colon, dot and slash that is not "
            f"taken: {names()}"
        )
    if not callable(make):
        raise InvalidInputError(f"policy {name!r}: got {shown(make)}, expected a function")
    _NAMED[name] = make


def names() -> list[str]:
    """Return the names of the registered policies."""
    return list(_NAMED)


def make(name: str, env: gym.Env) -> Policy:
    """Return a policy for one episode in an environment.

    A function is called as (observation, info) → action; a class without arguments is constructed
    for every episode. A zip is from ``model.save`` of Stable-Baselines3; its actions are stretched
    from the range of its training to the environment's. An ONNX file or a torch module maps an
    observation to an action, which is clipped to the environment's range. Zips and torch files hold
    pickles, which run code: take them only from sources that you trust.

    Args:
        name: one of `names()`, an .npz file, or one of `FORMS`.
        env: the environment, whose spaces the policy has to fit.

    Raises:
        UnknownNameError: if there is no such policy; the message lists the names.
        MissingDependencyError: if the file's reader is not installed.
        InvalidInputError: if the file or the function holds no policy, or one for other spaces.
    """
    check(name)
    name = str(name)
    instance("env", env, gym.Env, gym.vector.VectorEnv)
    if name in _NAMED:
        return _NAMED[name](env)
    if loading.is_function(name):
        function: Any = loading.function("policy", name)
        if not inspect.isclass(function):
            return function
        try:
            policy: Any = function()
        except TypeError as error:
            raise InvalidInputError(
                f"policy: got {name!r} ({in_words(error)}), expected a class without arguments"
            ) from error
        return policy
    reader = _READERS.get(Path(name).suffix)
    if reader is None:
        return learned.load(name, env)
    if not isinstance(env.action_space, spaces.Box):
        raise InvalidInputError(
            f"policy {name!r}: got the action space {env.action_space}, expected a Box"
        )
    return reader(Path(name), env.observation_space, env.action_space)


def check(name: str) -> None:
    """Refuse a name that `make` refuses with any environment.

    Raises:
        UnknownNameError: if there is no such policy; the message lists the names.
        InvalidInputError: if there is no such function or file.
    """
    name = text("policy", name)
    if name in _NAMED:
        return
    if loading.is_function(name):
        loading.function("policy", name)
    elif Path(name).suffix not in {".npz", *_READERS}:
        raise UnknownNameError(
            f"unknown policy: got {name!r}, expected one of {names()}, an .npz file, or {FORMS}"
        )
    elif not Path(name).is_file():
        raise InvalidInputError(f"policy: got {name!r}, expected an existing file")


def is_own(name: str) -> bool:
    """Return whether a name is a user's: one of `FORMS`, or an .npz file."""
    return loading.is_function(name) or Path(name).suffix in {".npz", *_READERS}


def files(name: str) -> list[Path]:
    """Return the user's files that decide a policy's actions; none for the package's policies."""
    if loading.is_function(name):
        return loading.files(name)
    return [Path(name)] if Path(name).is_file() else []


def try_out(name: str, env: gym.Env, seed: int = 0) -> Any:
    """Return a policy's action on the first observation after a reset by a seed.

    Raises:
        HcbfError: as `make` does.
        InvalidInputError: if the policy raises an error, or returns no finite numbers of the shape
            of an action.
    """
    policy = make(name, env)
    if seed is not None:
        seed = count("seed", seed, minimum=0, maximum=np.inf)
    observation, info = env.reset(seed=seed)
    try:
        action = policy(observation, info)
    except Exception as error:  # of the user's policy
        raise InvalidInputError(
            f"policy {name!r}: got {_first_line(error)} for an observation of shape "
            f"{_shape(env.observation_space)}, expected an action"
        ) from error
    array, shape = as_array(f"policy {name!r}: action", action), env.action_space.shape
    if array.dtype.kind not in "fiu" or array.shape != shape:
        raise InvalidInputError(
            f"policy {name!r}: got an action of shape {array.shape} and type {array.dtype}, "
            f"expected real numbers of shape {shape}"
        )
    if not np.isfinite(array).all():
        raise InvalidInputError(
            f"policy {name!r}: got the action {array.tolist()} for the first observation, expected "
            "finite numbers"
        )
    return action


def _shape(space: gym.Space) -> Any:
    """Return a Box's shape, key → shape of a Dict, and any other space itself, for messages."""
    if isinstance(space, spaces.Dict):
        return {key: _shape(entry) for key, entry in space.spaces.items()}
    return space.shape if isinstance(space, spaces.Box) else space


def _first_line(error: Exception) -> str:
    """Return the first line of an error's message."""
    return in_words(error).strip().partition("\n")[0]


def _check_box(path: Path, space: gym.Space) -> tuple[int, ...]:
    """Return the shape of a space of observations; refuse one whose elements are no arrays."""
    if isinstance(space, spaces.Box):
        return space.shape
    raise InvalidInputError(
        f"policy {path.name}: got the observation space {space}, expected a Box: such a file maps "
        "one array to an action; a zip of Stable-Baselines3 takes a Dict, "
        "gymnasium.wrappers.FlattenObservation makes a Box"
    )


def _read_onnx(path: Path, observations: gym.Space, actions: spaces.Box) -> Policy:
    """Return the policy of an ONNX network."""
    network = loading.Network(path, (_check_box(path, observations)[0], actions.shape[0]))
    return lambda observation, info: np.clip(network(observation), actions.low, actions.high)


def _read_torch(path: Path, observations: gym.Space, actions: spaces.Box) -> Policy:
    """Return the policy of a torch module that was saved whole, or as TorchScript."""
    require(f"policy {path.name}", "rl", "torch")
    _check_box(path, observations)
    torch: Any = importlib.import_module("torch")
    expected = "expected a module: torch.save(module, path), or torch.jit.script(module).save(path)"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch warns of either format
        try:
            module = torch.jit.load(path, map_location="cpu")
        except RuntimeError:  # the file is no TorchScript
            try:
                module = torch.load(path, map_location="cpu", weights_only=False)
            except Exception as error:  # of unpickling
                raise InvalidInputError(
                    f"policy: got {str(path)!r} ({_first_line(error)}), {expected}"
                ) from error
    if not isinstance(module, torch.nn.Module):
        got = "a state_dict, which has no network" if isinstance(module, dict) else repr(module)
        raise InvalidInputError(f"policy: got {got}, in {str(path)!r}, {expected}")
    module.eval()
    dtype = next((p.dtype for p in module.parameters()), torch.float32)

    def act(observation: Array, info: Info) -> NDArray[Any]:
        with torch.no_grad():
            batch = torch.as_tensor(np.asarray(observation), dtype=dtype)[None]
            return np.clip(module(batch)[0].numpy(), actions.low, actions.high)

    return act


def _read_stable_baselines(path: Path, observations: gym.Space, actions: spaces.Box) -> Policy:
    """Return the policy of a zip that ``model.save`` wrote, with actions in the right range."""
    require(f"policy {path.name}", "rl", "stable_baselines3")
    sb3: Any = importlib.import_module("stable_baselines3")
    save_util: Any = importlib.import_module("stable_baselines3.common.save_util")
    expected = "expected what model.save of Stable-Baselines3's PPO, A2C, SAC, TD3 or DDPG wrote"
    algorithms = (sb3.PPO, sb3.SAC, sb3.TD3)  # A2C has the policies of PPO, DDPG those of TD3
    try:
        policy_type = save_util.load_from_zip_file(path, device="cpu")[0]["policy_class"]
        fitting = [
            a for a in algorithms if issubclass(policy_type, tuple(a.policy_aliases.values()))
        ]
        if not fitting:
            raise TypeError(f"holds a {policy_type.__name__}")
        model = fitting[0].load(path, device="cpu")
    except Exception as error:  # of unzipping and unpickling
        raise InvalidInputError(
            f"policy: got {str(path)!r} ({_first_line(error)}), {expected}"
        ) from error
    model_shapes = _shape(model.observation_space), model.action_space.shape
    env_shapes = _shape(observations), actions.shape
    if model_shapes != env_shapes:
        raise InvalidInputError(
            f"policy: got a model of observations of shape {model_shapes[0]} and actions of shape "
            f"{model_shapes[1]} in {path.name}, expected {env_shapes[0]} and {env_shapes[1]} of "
            "the environment"
        )
    trained, low, high = model.action_space, actions.low, actions.high
    has_same_range = np.array_equal(low, trained.low) and np.array_equal(high, trained.high)
    stretch = (high - low) / (trained.high - trained.low).astype(np.float64)

    def act(observation: Any, info: Info) -> NDArray[Any]:
        action, _ = model.predict(observation, deterministic=True)
        return action if has_same_range else low + (action - trained.low) * stretch

    return act


_READERS: dict[str, Callable[[Path, gym.Space, spaces.Box], Policy]] = {
    ".zip": _read_stable_baselines,
    ".onnx": _read_onnx,
    ".pt": _read_torch,
}
"""Ending → the reader of such files: (path, observation space, action space) → policy."""

register("pd", PDTracker.for_env)
register("pd-ff", partial(PDTracker.for_env, feed_forward=True))
for baseline in learned.names():
    register(baseline, partial(learned.load, baseline))
