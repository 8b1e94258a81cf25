"""Learned policies that need no learning library to act: a small network in one .npz file."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from hcbf_gym.arrays import Array, Info
from hcbf_gym.errors import InvalidInputError, UnknownNameError, instance, reals, text
from hcbf_gym.records import whole

_FOLDER = Path(__file__).parent / "baselines"
CLIP = 10.0  # the bound of the entries of a normalised observation, as in training
ACTIVATIONS = {"tanh": np.tanh, "relu": lambda x: np.maximum(x, 0.0)}


@dataclass(frozen=True)
class LearnedPolicy:
    """A multilayer perceptron on normalised observations, ``u* = centre + reach ⊙ clip(f(o))``.

    Args:
        weights: each layer's (n_out, n_in).
        biases: each layer's (n_out,).
        mean: (n,) the mean of the observations.
        scale: (n,) their standard deviation; infinite for entries that are ignored.
        low: (2,) least acceleration [m/s²].
        high: (2,) greatest acceleration [m/s²].
        activation: the function between the layers, "tanh" or "relu".
        squash: the function that bounds the last layer's output to [−1, 1], "clip" or "tanh".
        about: configuration and versions of the training.
    """

    weights: tuple[Array, ...]
    biases: tuple[Array, ...]
    mean: Array
    scale: Array
    low: Array
    high: Array
    activation: str
    squash: str
    about: dict[str, Any]

    def __call__(self, observation: Array, info: Info) -> Array:
        """Return u* (…, 2) [m/s²] for one observation (n,) or a batch (N, n)."""
        observation = reals("observation", observation)
        if observation.shape[-1:] != self.mean.shape:
            raise InvalidInputError(
                f"observation: got shape {observation.shape}, expected (…, {self.mean.size})"
            )
        x = np.clip((observation - self.mean) / self.scale, -CLIP, CLIP)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = ACTIVATIONS[self.activation](x @ weight.T + bias)
        x = x @ self.weights[-1].T + self.biases[-1]
        x = np.tanh(x) if self.squash == "tanh" else np.clip(x, -1.0, 1.0)
        return 0.5 * (self.high + self.low) + 0.5 * (self.high - self.low) * x

    def save(self, path: Path) -> None:
        """Write the policy to an .npz file, whole or not at all."""
        layers: dict[str, Any] = {}
        layers |= {f"weight{i}": w.astype(np.float32) for i, w in enumerate(self.weights)}
        layers |= {f"bias{i}": b.astype(np.float32) for i, b in enumerate(self.biases)}
        header = {"activation": self.activation, "squash": self.squash, "about": self.about}
        with whole(path) as partial:
            np.savez_compressed(
                partial,
                **layers,
                mean=self.mean,
                scale=self.scale,
                low=self.low,
                high=self.high,
                header=np.array(json.dumps(header)),
            )


def names() -> list[str]:
    """Return the names of the policies that come with the package."""
    return sorted(file.stem for file in _FOLDER.glob("*.npz"))


def load(name: str | Path, env: gym.Env | gym.vector.VectorEnv) -> LearnedPolicy:
    """Return a learned policy, one of `names()` or an .npz file, for an environment.

    Raises:
        UnknownNameError: if there is neither such a policy nor such a file.
        InvalidInputError: if the file holds no policy, or it was trained for observations of
            another shape; the message names both.
    """
    policy, shape = read(file_of(name)), _observation_shape(env)
    if policy.mean.shape != shape:
        raise InvalidInputError(
            f"policy {str(name)!r}: got observations of shape {shape}, "
            f"expected {policy.mean.shape}, for which it was trained"
        )
    return policy


def file_of(name: str | Path) -> Path:
    """Return the file of a learned policy, which is one of `names()` or an .npz file."""
    path = Path(text("policy", name))
    if path.suffix == ".npz":
        return path
    if str(name) not in names():
        raise UnknownNameError(
            f"unknown policy: got {str(name)!r}, expected one of {names()}, or an .npz file"
        )
    return _FOLDER / f"{name}.npz"


def fitting(env: gym.Env | gym.vector.VectorEnv) -> list[str]:
    """Return the policies of this package that take observations of an environment's shape."""
    shape = _observation_shape(env)
    return [name for name in names() if read(file_of(name)).mean.shape == shape]


def _observation_shape(env: gym.Env | gym.vector.VectorEnv) -> tuple[int, ...]:
    """Return the shape of one robot's observation."""
    instance("env", env, gym.Env, gym.vector.VectorEnv)
    is_vector = isinstance(env, gym.vector.VectorEnv)
    space = env.single_observation_space if is_vector else env.observation_space
    if not isinstance(space, spaces.Box):
        raise InvalidInputError(
            f"policy: got observations of {space}, expected a Box: put the environment in "
            "gymnasium.wrappers.FlattenObservation"
        )
    return space.shape


def read(path: Path) -> LearnedPolicy:
    """Read a policy from an .npz file.

    Raises:
        InvalidInputError: if the file cannot be read or holds no policy.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            header = json.loads(str(file["header"]))
            n_layers = sum(key.startswith("weight") for key in file.files)
            return LearnedPolicy(
                weights=tuple(file[f"weight{i}"].astype(np.float64) for i in range(n_layers)),
                biases=tuple(file[f"bias{i}"].astype(np.float64) for i in range(n_layers)),
                mean=file["mean"],
                scale=file["scale"],
                low=file["low"],
                high=file["high"],
                **header,
            )
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise InvalidInputError(
            f"policy file: got {str(path)!r} ({error}), expected an .npz that "
            "LearnedPolicy.save wrote"
        ) from error
