"""Episodes and films of a study, each run once and kept in a folder."""

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgba
from numpy.typing import NDArray

from hcbf_gym.drawing.palette import PROGRAM_COLORS
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation import chunks
from hcbf_gym.evaluation.episode import in_double, samples
from hcbf_gym.evaluation.rollouts import Episode, Job, make_policy
from hcbf_gym.evaluation.workers import Backend


@dataclass(frozen=True)
class Runs:
    """The episodes of a study, each run at most once.

    Args:
        folder: where they are kept.
        workers: episodes that run at once; None for as many as the backend has CPUs.
        backend: "processes" or "ray".
    """

    folder: Path
    workers: int | None = None
    backend: Backend = "processes"

    def episodes(self, title: str, jobs: Sequence[Job]) -> list[Episode]:
        """Return the episodes in the order of the jobs, running those that are not there yet.

        Args:
            title: what they are, for the progress.
            jobs: what to run.
        """
        return self._results(Job.run, title, jobs)

    def films(
        self, title: str, jobs: Sequence[Job], times: Sequence[float]
    ) -> list[NDArray[np.uint8]]:
        """Return pictures (k, h, w, 3) of each episode at the given times [s].

        Raises:
            RenderingError: if no OpenGL context can be made.
        """
        return self._results(functools.partial(_film, times=tuple(times)), title, jobs)

    def _results(self, function: Any, title: str, jobs: Sequence[Job]) -> list[Any]:
        runs = chunks.run(
            function, jobs, folder=self.folder, workers=self.workers, backend=self.backend,
            title=title,
        )  # fmt: skip
        return chunks.in_order(runs)


def _film(job: Job, times: Sequence[float]) -> NDArray[np.uint8]:
    env = job.case.make(render_mode="rgb_array")
    inner: Any = env.unwrapped
    inner.artist.path_color = to_rgba(PROGRAM_COLORS[job.case.program])
    steps = [round(time / CONTROL_DT) for time in times]
    frames = []
    try:
        walk = samples(env, in_double(make_policy(job.case.policy, env)), job.seed)
        for step, sample in enumerate(itertools.islice(walk, max(steps) + 1)):
            if step in steps and not sample.over:
                frames.append(env.render())
    finally:
        env.close()
    return np.array(frames, dtype=np.uint8)
