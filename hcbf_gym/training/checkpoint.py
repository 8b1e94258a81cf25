"""Checkpoints from which an interrupted run continues bit for bit."""

import os
import pickle
import random
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from hcbf_gym.errors import InvalidInputError
from hcbf_gym.training.config import ALGORITHMS, Curve, TrainingConfig

_FOLDER = "checkpoint"
_OLD_FOLDER = "checkpoint.old"  # exists alone if a run was killed while it replaced the checkpoint


def save(folder: Path, config: TrainingConfig, model: BaseAlgorithm, curve: Curve) -> None:
    """Save a run's checkpoint, and then replace the old one, which remains if the run is killed."""
    env = model.get_vec_normalize_env()
    assert env is not None
    current, old = folder / _FOLDER, folder / _OLD_FOLDER
    fresh = folder / f"{_FOLDER}.new"  # renamed when it is complete
    shutil.rmtree(fresh, ignore_errors=True)
    fresh.mkdir(parents=True)
    model.save(fresh / "model.zip")
    if isinstance(model, OffPolicyAlgorithm):
        model.save_replay_buffer(fresh / "replay_buffer.pkl")
    state = {
        "config": config,
        "normalization": env,
        "returns": env.returns,
        "environments": env.venv,
        "generators": (random.getstate(), np.random.get_state(), torch.get_rng_state()),  # noqa: NPY002 - SB3 draws from these
        "action_space": model.action_space,
        "curve": curve,
    }
    (fresh / "state.pkl").write_bytes(pickle.dumps(state))
    shutil.rmtree(old, ignore_errors=True)
    if current.exists():
        os.replace(current, old)
    os.replace(fresh, current)
    shutil.rmtree(old, ignore_errors=True)


def find(folder: Path) -> Path | None:
    """Return the folder of a run's newest complete checkpoint; None if there is none."""
    for checkpoint in (folder / _FOLDER, folder / _OLD_FOLDER):
        if checkpoint.exists():
            return checkpoint
    return None


def resume(
    checkpoint: Path, config: TrainingConfig, tensorboard: str | None
) -> tuple[BaseAlgorithm, Curve]:
    """Return the model, with its environments, and the curve up to a checkpoint.

    A checkpoint holds pickles, so resume only those of your own runs. The configuration may differ
    from the saved one in `steps`.

    Raises:
        InvalidInputError: if the checkpoint belongs to another run, or cannot be read.
    """
    try:
        state: dict[str, Any] = pickle.loads((checkpoint / "state.pkl").read_bytes())
    except Exception as error:  # a truncated pickle, or one of another version, may raise any type
        raise InvalidInputError(
            f"resume: got {checkpoint} that cannot be read ({error}), expected what this version "
            "saved; begin anew in another --output"
        ) from error
    given, saved = vars(config), vars(state["config"])
    differing = [name for name in given if name != "steps" and given[name] != saved[name]]
    if differing:
        raise InvalidInputError(
            f"resume: got {[(name, given[name]) for name in differing]}, "
            f"expected {[(name, saved[name]) for name in differing]} as in {checkpoint}"
        )
    env: VecNormalize = state["normalization"]
    env.set_venv(state["environments"])
    env.returns = state["returns"]
    model = ALGORITHMS[config.algorithm].load(
        checkpoint / "model.zip",
        env=env,
        device="cpu",
        force_reset=False,
        tensorboard_log=tensorboard,
    )
    if isinstance(model, OffPolicyAlgorithm):
        model.load_replay_buffer(checkpoint / "replay_buffer.pkl")
    model.action_space = state["action_space"]
    interpreter, numpy_state, torch_state = state["generators"]
    random.setstate(interpreter)
    np.random.set_state(numpy_state)  # noqa: NPY002
    torch.set_rng_state(torch_state)
    return model, state["curve"]
