"""An attacker of your own, and what it gets out of ten scenes behind the filter."""

import numpy as np

from hcbf_gym.evaluation.attacked import AttackedEpisode
from hcbf_gym.evaluation.attacks import ATTACKS, Attack, full


class Circling(Attack):
    """Presses into the nearest strict region and swings along its edge, once in a second."""

    def act(self, s):
        along = np.array([-s.normal[0, 1], s.normal[0, 0]])
        return full(np.sin(2.0 * np.pi * s.time) * along - s.normal[0])


ATTACKS["circling"] = Circling


def least_distance(seeds, env="HCBF-Regions-v0"):
    """Return the least distance from a strict region in the scenes of these seeds [m]."""
    episodes = [AttackedEpisode("circling", "random", seed, env=env) for seed in seeds]
    return min(episode.run().least_h for episode in episodes)


if __name__ == "__main__":
    print(f"{least_distance(range(10)):+.3f} m")
