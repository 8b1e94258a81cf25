"""The trajectories of one model side by side, as the panels of figure 5 read them."""

import numpy as np

from hcbf_gym.evaluation.rollouts import Episode
from hcbf_lab.tuning import Trajectories
from hcbf_lab.tuning.cost import relaxation


def side_by_side(*parts: Trajectories) -> Trajectories:
    """Put batches of one scene side by side, each as long as the others."""
    joined = {
        name: np.concatenate(
            [getattr(part, name) for part in parts], axis=0 if name in ("min_h", "fell") else 1
        )
        for name in Trajectories._fields[1:]
    }
    return Trajectories(parts[0].time, **joined)


def of_episodes(episodes: list[Episode]) -> Trajectories:
    """Put episodes side by side, up to the end of the shortest."""
    steps = min(len(episode.time) for episode in episodes)
    return side_by_side(*(
        Trajectories(
            episode.time[:steps], episode.position[:steps, None], episode.h[:steps, None],
            episode.min_h.min(axis=0)[None], episode.tracking_error[:steps, None],
            relaxation(episode.delta, episode.priority)[: steps - 1, None],
            np.array([episode.fell]),
        )
        for episode in episodes
    ))  # fmt: skip
