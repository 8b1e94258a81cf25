"""Rendered pictures of the A1 in episodes of R and H."""

import itertools
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgba
from numpy.typing import NDArray

from hcbf_gym import policies
from hcbf_gym.drawing.palette import PROGRAM_COLORS
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import RenderingError
from hcbf_gym.evaluation.episode import in_double, samples
from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_gym.evaluation.rollouts import Job
from hcbf_lab.reproduction import plots


def draw_frames(runs: Runs, jobs: Sequence[Job], times: Sequence[float], file: Path) -> str:
    """Draw R's and H's episodes at times [s] into a file; return its name, or OpenGL's error."""
    try:
        films = in_order(runs.over(partial(film, times=times), jobs, f"{file.stem}, pictures"))
    except RenderingError as error:
        return str(error)
    plots.frames(("R", "H"), films, times).savefig(file)
    return file.name


def film(job: Job, times: Sequence[float]) -> NDArray[np.uint8]:
    """Return pictures (k, h, w, 3) of an episode at the given times [s].

    Raises:
        RenderingError: if no OpenGL context can be made.
    """
    env = job.case.make(render_mode="rgb_array")
    inner: Any = env.unwrapped
    inner.artist.path_color = to_rgba(PROGRAM_COLORS[job.case.program])
    steps = [round(time / CONTROL_DT) for time in times]
    frames = []
    try:
        walk = samples(env, in_double(policies.make(job.case.policy, env)), job.seed)
        for step, sample in enumerate(itertools.islice(walk, max(steps) + 1)):
            if step in steps and not sample.over:
                frames.append(env.render())
    finally:
        env.close()
    return np.array(frames, dtype=np.uint8)
