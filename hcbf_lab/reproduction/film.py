"""Pictures of an episode."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import to_rgba
from numpy.typing import NDArray

from hcbf_gym import policies
from hcbf_gym.drawing.palette import PROGRAM_COLORS
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation.episode import in_double, samples
from hcbf_gym.evaluation.rollouts import Job


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
