"""Policies by what one types: a name, a function of one's own, or the file of a trained network."""

import importlib
import inspect
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

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
"""How a policy of one's own is named."""


def register(name: str, make: Make) -> None:
    """Name a policy, as `hcbf evaluate --policy` and `make` take it.

    Args:
        name: without colon and dot, which names of files and functions have.
        make: (environment) → the policy of one episode in it.

    Raises:
        InvalidInputError: if the name is taken or no name, or `make` is no function.
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
    """Return the names of policies that are registered."""
    return list(_NAMED)


def make(name: str, env: gym.Env) -> Policy:
    """Return a policy for one episode in an environment.

    A function is called as (observation, info) → action; of a class without arguments every
    episode gets an instance of its own, which is called so. A zip is what ``model.save`` of
    Stable-Baselines3 wrote, whose actions are stretched from the range that it learned in to the
    environment's; an ONNX file or a torch module maps an observation to an action, which is cut to
    the environment's range. Zips and torch files hold pickles, which run code: take them from those
    whom you trust.

    Args:
        name: one of `names()`, an .npz file, or one of `FORMS`.
        env: the environment, whose spaces it has to fit.

    Raises:
        UnknownNameError: if there is no such policy; the message lists those that are.
        MissingDependencyError: if what reads the file is not installed.
        InvalidInputError: if the file or function is none, or of other spaces.
    """
    check(name)
    name = str(name)
    instance("env", env, gym.Env, gym.vector.VectorEnv)
    if name in _NAMED:
        return _NAMED[name](env)
    if loading.is_function(name):
        found: Any = loading.function("policy", name)
        made: Any = found() if inspect.isclass(found) else found
        return made
    reader = _READERS.get(Path(name).suffix)
    if reader is None:
        return learned.load(name, env)
    return reader(Path(name), _Spaces.of(name, env))


def check(name: str) -> None:
    """Refuse what no policy is called, without an environment.

    Args:
        name: as `make` takes it.

    Raises:
        UnknownNameError: if there is no such policy; the message lists those that are.
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
    """Return whether a name is one of `FORMS`, or of an .npz file."""
    return loading.is_function(name) or Path(name).suffix in {".npz", *_READERS}


def files(name: str) -> list[Path]:
    """Return the user's files that decide what a policy does; none of one that comes along."""
    if loading.is_function(name):
        return loading.files(name)
    return [Path(name)] if Path(name).is_file() else []


def try_out(name: str, env: gym.Env, seed: int = 0) -> Any:
    """Return a policy's answer to the first observation, and refuse what is no action.

    Args:
        name: as `make` takes it.
        env: is reset.
        seed: of the reset.

    Raises:
        HcbfError: as `make` does.
        InvalidInputError: if the policy raises an error, or its answer has another shape than an
            action or is not finite.
    """
    policy = make(name, env)
    if seed is not None:
        seed = count("seed", seed, minimum=0, maximum=np.inf)
    observation, info = env.reset(seed=seed)
    try:
        action = policy(observation, info)
    except Exception as error:  # whatever a user's policy raises
        said = str(error).strip().partition("\n")[0]
        raise InvalidInputError(
            f"policy {name!r}: got {type(error).__name__}: {said} for an observation of shape "
            f"{_shape(env.observation_space)}, expected an action"
        ) from error
    array, wanted = as_array(f"policy {name!r}: action", action), env.action_space.shape
    if array.dtype.kind not in "fiu" or array.shape != wanted:
        raise InvalidInputError(
            f"policy {name!r}: got an action of shape {array.shape} and type {array.dtype}, "
            f"expected real numbers of shape {wanted}"
        )
    if not np.isfinite(array).all():
        raise InvalidInputError(
            f"policy {name!r}: got the action {array.tolist()} for the first observation, expected "
            "finite numbers"
        )
    return action


def _shape(space: gym.Space) -> Any:
    """Return the shape of a space's entries, key → shape of a Dict; the space itself of others."""
    if isinstance(space, spaces.Dict):
        return {key: _shape(part) for key, part in space.spaces.items()}
    return space.shape if isinstance(space, spaces.Box) else space


class _Spaces(NamedTuple):
    """The spaces of an environment that a network has to fit."""

    observation: gym.Space
    action: spaces.Box

    @classmethod
    def of(cls, name: str, env: gym.Env) -> "_Spaces":
        """Return them.

        Raises:
            InvalidInputError: if the actions are no Box.
        """
        action = env.action_space
        if not isinstance(action, spaces.Box):
            raise InvalidInputError(
                f"policy {name!r}: got the action space {action}, expected a Box"
            )
        return cls(env.observation_space, action)

    def box(self, path: Path) -> tuple[int, ...]:
        """Return the shape of the observations, which have to be arrays.

        Raises:
            InvalidInputError: if they are none.
        """
        if isinstance(self.observation, spaces.Box):
            return self.observation.shape
        raise InvalidInputError(
            f"policy {path.name}: got the observation space {self.observation}, expected a Box: "
            "such a file maps one array to an action; a zip of Stable-Baselines3 takes a Dict, "
            "gymnasium.wrappers.FlattenObservation makes a Box"
        )


def _of_onnx(path: Path, fits: _Spaces) -> Policy:
    network = loading.Network(path, (fits.box(path)[0], fits.action.shape[0]))
    low, high = fits.action.low, fits.action.high
    return lambda observation, info: np.clip(network(observation), low, high)


def _of_torch(path: Path, fits: _Spaces) -> Policy:
    """Return the policy of a torch module that was saved whole, or as TorchScript."""
    require(f"policy {path.name}", "rl", "torch")
    fits.box(path)
    torch: Any = importlib.import_module("torch")
    expected = "expected a module: torch.save(module, path), or torch.jit.script(module).save(path)"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of how torch would rather have it saved
        try:
            module = torch.jit.load(path, map_location="cpu")
        except RuntimeError:  # no TorchScript
            try:
                module = torch.load(path, map_location="cpu", weights_only=False)
            except Exception as error:  # whatever unpickling raises
                raise InvalidInputError(
                    f"policy: got {str(path)!r} ({type(error).__name__}: {error}), {expected}"
                ) from error
    if not isinstance(module, torch.nn.Module):
        kind = "a state_dict, which has no network" if isinstance(module, dict) else repr(module)
        raise InvalidInputError(f"policy: got {kind}, in {str(path)!r}, {expected}")
    module.eval()
    dtype = next((p.dtype for p in module.parameters()), torch.float32)

    def act(observation: Array, info: Info) -> NDArray[Any]:
        with torch.no_grad():
            seen = torch.as_tensor(np.asarray(observation), dtype=dtype)
            return np.clip(module(seen[None])[0].numpy(), fits.action.low, fits.action.high)

    return act


def _of_stable_baselines(path: Path, fits: _Spaces) -> Policy:
    """Return the policy of a zip that ``model.save`` wrote, with actions in the right range."""
    require(f"policy {path.name}", "rl", "stable_baselines3")
    sb3: Any = importlib.import_module("stable_baselines3")
    saving: Any = importlib.import_module("stable_baselines3.common.save_util")
    expected = "expected what model.save of Stable-Baselines3's PPO, A2C, SAC, TD3 or DDPG wrote"
    kinds = (sb3.PPO, sb3.SAC, sb3.TD3)  # A2C has the policies of PPO, DDPG those of TD3
    try:
        kind = saving.load_from_zip_file(path, device="cpu")[0]["policy_class"]
        fitting = [one for one in kinds if issubclass(kind, tuple(one.policy_aliases.values()))]
        if not fitting:
            raise TypeError(f"holds a {kind.__name__}")
        model = fitting[0].load(path, device="cpu")
    except Exception as error:  # whatever unzipping and unpickling raise
        said = str(error).strip().partition("\n")[0]
        raise InvalidInputError(
            f"policy: got {str(path)!r} ({type(error).__name__}: {said}), {expected}"
        ) from error
    seen, given = _shape(model.observation_space), model.action_space.shape
    expected_seen = _shape(fits.observation)
    if (seen, given) != (expected_seen, fits.action.shape):
        raise InvalidInputError(
            f"policy: got a model of observations of shape {seen} and actions of shape {given} in "
            f"{path.name}, expected {expected_seen} and {fits.action.shape}, as the environment "
            "has them"
        )
    low, high = fits.action.low, fits.action.high
    least, most = model.action_space.low, model.action_space.high
    same = np.array_equal(low, least) and np.array_equal(high, most)
    stretch = (high - low) / (most - least).astype(np.float64)

    def act(observation: Any, info: Info) -> NDArray[Any]:
        action, _ = model.predict(observation, deterministic=True)
        return action if same else low + (action - least) * stretch

    return act


_READERS: dict[str, Callable[[Path, _Spaces], Policy]] = {
    ".zip": _of_stable_baselines,
    ".onnx": _of_onnx,
    ".pt": _of_torch,
}
"""Ending → what reads such a file."""

register("pd", PDTracker.for_env)
register("pd-ff", partial(PDTracker.for_env, feed_forward=True))
for baseline in learned.names():
    register(baseline, partial(learned.load, baseline))
