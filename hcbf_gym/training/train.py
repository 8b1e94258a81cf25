"""One training run from its configuration to a policy file, new or resumed."""

from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import torch
from stable_baselines3.common.callbacks import BaseCallback

from hcbf_gym.evaluation.output_folder import write_json
from hcbf_gym.policies.learned import LearnedPolicy, read
from hcbf_gym.records import make_folder
from hcbf_gym.training import checkpoint
from hcbf_gym.training.callbacks import LearnFromFiltered, Reports
from hcbf_gym.training.config import Curve, Show, TrainingConfig, make_env, make_model
from hcbf_gym.wrappers.sb3 import FilterCallback

_PACKAGES = ("hcbf-gym", "gymnasium", "numpy", "stable-baselines3", "torch")


def train(
    config: TrainingConfig,
    folder: Path,
    resume: bool = False,
    tensorboard: bool = False,
    show: Show = lambda steps, curve: None,
) -> LearnedPolicy:
    """Train a policy, and return the best one of the run.

    The folder then has `policy.npz`, `training.json` (configuration, versions, learning curve) and
    `checkpoint/` (model, normalisation, environments, generators).

    Args:
        config: the configuration of the run.
        folder: the folder of the run.
        resume: continue from the folder's checkpoint, if there is one.
        tensorboard: log to the subfolder `tensorboard`.
        show: called with the decisions so far and the curve, for a progress bar.

    Raises:
        InvalidInputError: if the checkpoint belongs to another run.
    """
    torch.set_num_threads(1)  # the network is small: threads cost more than they bring
    log = str(folder / "tensorboard") if tensorboard else None
    saved = checkpoint.find(folder) if resume else None
    if saved is None:
        curve: Curve = []
        model = make_model(config, make_env(config), log)
    else:
        model, curve = checkpoint.resume(saved, config, log)
    make_folder(folder)
    about = asdict(config) | {"versions": {name: _version(name) for name in _PACKAGES}}
    callbacks: list[BaseCallback] = []
    if config.learn_from == "filtered":
        callbacks.append(LearnFromFiltered())
    if tensorboard and config.filter != "off":
        callbacks.append(FilterCallback())
    callbacks.append(Reports(config, folder, curve, about, show))
    remaining = config.total_steps - model.num_timesteps
    if remaining > 0:
        model.learn(remaining, callbacks, reset_num_timesteps=saved is None)
    write_json(folder / "training.json", about | {"curve": curve})
    return read(folder / "policy.npz")


def _version(package: str) -> str:
    """Return the version of an installed package; "source tree" if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "source tree"
