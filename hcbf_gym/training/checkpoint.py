"""Checkpoints from which a killed run continues bit for bit."""

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
from hcbf_gym.training.config import ALGORITHMS, TrainingConfig

_FOLDER = "checkpoint"


def save(
    folder: Path, config: TrainingConfig, model: BaseAlgorithm, curve: list[dict[str, float]]
) -> None:
    """Replace the folder's checkpoint in one move: being killed meanwhile leaves the old one."""
    env = model.get_vec_normalize_env()
    assert env is not None
    fresh, current, old = (folder / f"{_FOLDER}{suffix}" for suffix in (".new", "", ".old"))
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
    """Return the run's newest whole checkpoint, if there is one."""
    for suffix in ("", ".old"):
        if (folder / f"{_FOLDER}{suffix}").exists():
            return folder / f"{_FOLDER}{suffix}"
    return None


def resume(
    checkpoint: Path, config: TrainingConfig, tensorboard: str | None
) -> tuple[BaseAlgorithm, list[dict[str, float]]]:
    """Return the model, with its environments, and the evaluations up to the checkpoint.

    It is unpickled, so it must be of this package and machine; the number of steps may differ.

    Raises:
        InvalidInputError: if the checkpoint belongs to another run, or cannot be read.
    """
    try:
        state: dict[str, Any] = pickle.loads((checkpoint / "state.pkl").read_bytes())
    except Exception as error:  # a pickle that is cut, or of another version, raises anything
        raise InvalidInputError(
            f"resume: got {checkpoint} that cannot be read ({error}), expected what this version "
            "saved; begin anew in another --output"
        ) from error
    saved = state["config"]
    differing = [
        name
        for name in vars(config)
        if name != "steps" and getattr(config, name) != getattr(saved, name)
    ]
    if differing:
        raise InvalidInputError(
            f"resume: got {[(name, getattr(config, name)) for name in differing]}, "
            f"expected {[(name, getattr(saved, name)) for name in differing]} as in {checkpoint}"
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
