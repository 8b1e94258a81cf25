"""The trajectories of one model side by side, as the panels of figure 5 read them."""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.evaluation.rollouts import Episode
from hcbf_gym.studies.tuning import WeightRollouts


class Trajectories(NamedTuple):
    """N trajectories of k steps in one scene.

    Attributes:
        time: (k + 1,) [s].
        position: (k + 1, N, 2) [m].
        h: (k + 1, N, m) [m].
        min_h: (N, m) over all physics steps [m].
        tracking_error: (k + 1, N) [m].
        fell: (N,) whether the robot fell.
    """

    time: Array
    position: Array
    h: Array
    min_h: Array
    tracking_error: Array
    fell: Mask


def of_simulations(*parts: WeightRollouts) -> Trajectories:
    """Put batches of the reduced-order model, which cannot fall, side by side."""
    return Trajectories(
        parts[0].time,
        np.concatenate([part.position for part in parts], axis=1),
        np.concatenate([part.h for part in parts], axis=1),
        np.concatenate([part.min_h for part in parts]),
        np.concatenate([part.tracking_error for part in parts], axis=1),
        np.zeros(sum(len(part.min_h) for part in parts), dtype=np.bool_),
    )


def of_episodes(episodes: list[Episode]) -> Trajectories:
    """Put episodes side by side, up to the end of the shortest."""
    steps = min(len(episode.time) for episode in episodes)
    return Trajectories(
        episodes[0].time[:steps],
        np.stack([episode.position[:steps] for episode in episodes], axis=1),
        np.stack([episode.h[:steps] for episode in episodes], axis=1),
        np.stack([episode.min_h.min(axis=0) for episode in episodes]),
        np.stack([episode.tracking_error[:steps] for episode in episodes], axis=1),
        np.array([episode.fell for episode in episodes]),
    )
