"""Episodes that are run once: in parallel, and kept in a folder under all that decides them."""

import functools
import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import joblib
import numpy as np
from matplotlib.colors import to_rgba
from numpy.typing import NDArray

import hcbf_gym
from hcbf_gym import scenarios
from hcbf_gym.compilation import sources_hash
from hcbf_gym.drawing.palette import PROGRAM_COLORS
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation.rollouts import Case, Episode, in_parallel, make_policy
from hcbf_gym.records import whole

Array = NDArray[np.float64]

_PACKAGE = Path(hcbf_gym.__file__).parent
_DECIDE = ("evaluation/rollouts.py", "envs/regions.py", "envs/a1_regions.py", "robots/a1/a1.xml")
"""What an episode runs on, and through their imports all below them."""


@functools.cache
def _sources() -> str:
    return sources_hash([_PACKAGE / file for file in _DECIDE])


class Job(NamedTuple):
    """One episode to run: a case and its seed."""

    case: Case
    seed: int = 0

    def key(self) -> str:
        """Return a name that no other episode has: the hash of its settings and of the sources."""
        case = self.case
        settings = {
            "sources": _sources(),
            "env": case.env,
            "scenario": scenarios.make(case.scenario).to_dict(),
            "policy": case.policy,
            "program": case.program,
            "options": dict(case.options or {}),
            "env_options": dict(case.env_options or {}),
            "seed": self.seed,
        }
        text = json.dumps(settings, sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()[:20]


@dataclass(frozen=True)
class Runs:
    """The episodes of a study, each run at most once.

    Args:
        folder: where they are kept.
        workers: processes.
        backend: how joblib starts them.
        on_progress: called with a title, how many episodes are done, and of how many.
    """

    folder: Path
    workers: int = 1
    backend: str = "loky"
    on_progress: Callable[[str, int, int], None] = lambda title, done, total: None

    def episodes(self, title: str, jobs: Sequence[Job]) -> list[Episode]:
        """Return the episodes in the order of the jobs, running those that are not there yet.

        Args:
            title: what they are, for the progress.
            jobs: what to run.
        """
        paths = [self.folder / f"{job.key()}.npz" for job in jobs]
        self._complete(
            title, paths, [joblib.delayed(_run)(*task) for task in zip(jobs, paths, strict=True)]
        )
        return [_load(path) for path in paths]

    def films(
        self, title: str, jobs: Sequence[Job], times: Sequence[float]
    ) -> list[NDArray[np.uint8]]:
        """Return pictures (k, h, w, 3) of each episode at the given times [s].

        Raises:
            RenderingError: if no OpenGL context can be made.
        """
        name = "-".join(f"{time:g}" for time in times)
        paths = [self.folder / f"{job.key()}-film-{name}.npz" for job in jobs]
        tasks = [
            joblib.delayed(_film)(job, path, times) for job, path in zip(jobs, paths, strict=True)
        ]
        self._complete(title, paths, tasks)
        films = []
        for path in paths:
            with np.load(path) as data:
                films.append(data["frames"])
        return films

    def _complete(self, title: str, paths: Sequence[Path], tasks: Sequence[Any]) -> None:
        """Run the tasks whose files are not there yet."""
        self.folder.mkdir(parents=True, exist_ok=True)
        missing = {path: task for path, task in zip(paths, tasks, strict=True) if not path.exists()}
        done = len(paths) - len(missing)
        self.on_progress(title, done, len(paths))
        for _ in in_parallel(list(missing.values()), self.workers, self.backend) if missing else ():
            done += 1
            self.on_progress(title, done, len(paths))


def _run(job: Job, path: Path) -> None:
    episode = job.case.run(job.seed)
    _save(path, {field.name: getattr(episode, field.name) for field in fields(Episode)})


def _save(path: Path, arrays: dict[str, Any]) -> None:
    with whole(path) as partial:
        np.savez_compressed(partial, **arrays)


def _load(path: Path) -> Episode:
    with np.load(path) as data:
        values: dict[str, Any] = {name: data[name] for name in data.files}
    values |= {name: values[name].item() for name in ("goal_radius", "fell", "reached")}
    return Episode(**values)


def _film(job: Job, path: Path, times: Sequence[float]) -> None:
    env = job.case.make(render_mode="rgb_array")
    inner: Any = env.unwrapped
    inner.artist.path_color = to_rgba(PROGRAM_COLORS[job.case.program])
    policy = make_policy(job.case.policy, env)
    steps = [round(time / CONTROL_DT) for time in times]
    frames = []
    try:
        observation, info = env.reset(seed=job.seed)
        for step in range(max(steps) + 1):
            if step in steps:
                frames.append(env.render())
            observation, _, terminated, truncated, info = env.step(
                np.asarray(policy(observation, info), dtype=np.float64)
            )
            if terminated or truncated:
                break
    finally:
        env.close()
    _save(path, {"frames": np.array(frames, dtype=np.uint8)})
