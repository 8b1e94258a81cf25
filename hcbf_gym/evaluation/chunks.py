"""A function over many jobs, by processes or on a Ray cluster, so that no finished work is lost.

Jobs run in chunks. A chunk is saved as soon as it has finished; one whose worker or node died runs
again; the same call, made again, runs what is missing. `docs/cluster.md` says how a cluster is
found.

>>> from tempfile import TemporaryDirectory
>>> with TemporaryDirectory() as folder:
...     results = dict(run(abs, [-1.5, 2.5], folder=Path(folder), workers=1))
>>> results
{0: 1.5, 1: 2.5}
"""

import functools
import hashlib
import importlib.metadata
import inspect
import pickle
import platform
import reprlib
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import joblib
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeElapsedColumn

import hcbf_gym
from hcbf_gym.compilation import PACKAGE, SAID_EVERY, read_by_name, sources_hash
from hcbf_gym.errors import UNREADABLE, ChunkError, HcbfError, InvalidInputError
from hcbf_gym.evaluation.workers import Backend, Pool, open_pool
from hcbf_gym.records import whole

COMPUTING = ("numpy", "scipy", "numba", "mujoco", "gymnasium")
"""Whose versions decide the bits of an episode."""
ATTEMPTS = 5
"""How often a chunk runs whose worker dies, before it is given up."""

J = TypeVar("J")
R = TypeVar("R")


class Chunk(NamedTuple):
    """Jobs that run together.

    Attributes:
        start: the number of the first.
        jobs: what the function is called with, one after the other.
        path: of the file of their results; None where they are not saved.
    """

    start: int
    jobs: Sequence[Any]
    path: Path | None

    def __str__(self) -> str:
        return f"chunk of {len(self.jobs)} from job {self.start}, {reprlib.repr(self.jobs[0])}"


def run(
    function: Callable[[J], R],
    jobs: Sequence[J],
    *,
    folder: Path | None = None,
    reads: Sequence[Path] = (),
    size: int = 1,
    workers: int | None = None,
    backend: Backend = "processes",
    title: str | None = None,
) -> Iterator[tuple[int, R]]:
    """Yield (number of the job, its result): what is saved at once, the others as they finish.

    Who stops iterating stops the workers. The results of a chunk are saved, bit for bit, in a file
    that is named by a hash of what was run: the function with all sources below it, the files that
    it reads, the versions of what computes, and the jobs. So a folder never answers for other work,
    and chunks of several machines may be put into one.

    Args:
        function: job → result; it, the jobs and the results can be pickled.
        jobs: what to run.
        folder: where chunks are saved; None to save nothing.
        reads: the files of the user's own that decide the results: scenes, contracts, policies.
        size: jobs in a chunk.
        workers: chunks that run at once; None for as many as the backend has CPUs.
        backend: "processes" or "ray".
        title: of a bar that tells what is done and how long the rest takes; None for no bar.

    Raises:
        InvalidInputError: if the size or the workers are below 1, if a cluster has fewer CPUs than
            workers, or if the function or a job cannot be pickled.
        UnknownNameError: if there is no such backend.
        MissingDependencyError: if Ray is asked for and not installed.
        ChunkError: if the function raises an error that is not of this package, or the workers of
            one chunk died `ATTEMPTS` times.
    """
    if size < 1:
        raise InvalidInputError(f"size: got {size}, expected at least 1")
    pool = open_pool(backend, workers)
    identity = ""
    if folder is not None:  # a shipped certificate sets the margins of its plant
        shipped = sorted(PACKAGE.glob("certificates/shipped/*.json"))
        identity = f"{sources_of(function, [*reads, *shipped])} {_hash(function)} {versions()}"
    chunks = []
    for start in range(0, len(jobs), size):
        part = jobs[start : start + size]
        path = None if folder is None else folder / f"{_key(identity, part)}.chunk"
        chunks.append(Chunk(start, part, path))
    return _complete(function, chunks, pool, title)


def in_order(runs: Iterator[tuple[int, R]]) -> list[R]:
    """Return all results of `run`, in the order of the jobs."""
    results = dict(runs)
    return [results[number] for number in range(len(results))]


@dataclass(frozen=True)
class Runs:
    """How the jobs of a study run; see `run`.

    Args:
        folder: where finished chunks are kept; None to keep none.
        workers: chunks that run at once; None for as many as the backend has CPUs.
        backend: "processes" or "ray".
        quiet: show no bar.
    """

    folder: Path | None = None
    workers: int | None = None
    backend: Backend = "processes"
    quiet: bool = False

    def check(self) -> None:
        """Refuse workers that there are not, before anything else is done.

        Raises:
            HcbfError: as `run` does.
        """
        open_pool(self.backend, self.workers).close()

    def over(
        self,
        function: Callable[[J], R],
        jobs: Sequence[J],
        title: str | None = None,
        reads: Sequence[Path] = (),
        size: int = 1,
    ) -> Iterator[tuple[int, R]]:
        """Yield (number, result) of jobs as `run` does; `title` is of the bar."""
        return run(
            function, jobs, folder=self.folder, reads=reads, size=size, workers=self.workers,
            backend=self.backend, title=None if self.quiet else title,
        )  # fmt: skip


def versions() -> dict[str, str]:
    """Return name → version of what decides the bits of a result."""
    found = {name: importlib.metadata.version(name) for name in COMPUTING}
    here = {"python": platform.python_version(), "machine": platform.machine()}
    return {"hcbf-gym": hcbf_gym.__version__} | found | here


def sources_of(function: Callable[..., object], reads: Sequence[Path] = ()) -> str:
    """Return a hash of the sources of all that a function may reach, and of files.

    Args:
        function: whose file is read with all that it imports of this package.
        reads: the files of the user's own that decide the results.
    """
    inner: Any = function
    while isinstance(inner, functools.partial):
        inner = inner.func
    try:
        own = [Path(inspect.getfile(inner))]
    except TypeError:  # built in
        own = []
    return sources_hash([*own, *read_by_name(), *reads])


def _key(identity: str, jobs: Sequence[object]) -> str:
    text = "\n".join([identity, *map(_hash, jobs)])
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def _hash(thing: object) -> str:
    try:
        return str(joblib.hash(thing, hash_name="sha1"))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InvalidInputError(
            f"chunks: got {reprlib.repr(thing)}, expected what can be pickled ({error})"
        ) from error


def _complete(
    function: Callable[[J], R], chunks: Sequence[Chunk], pool: Pool, title: str | None
) -> Iterator[tuple[int, R]]:
    """Yield what is saved, then what runs."""
    saved, missing = [], []
    for chunk in chunks:
        here = chunk.path is not None and chunk.path.exists()
        (saved if here else missing).append(chunk)
    for chunk in saved:
        yield from enumerate(_load(chunk), chunk.start)
    columns = (*Progress.get_default_columns(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(
        *columns,
        console=Console(stderr=True),
        disable=title is None,
        speed_estimate_period=3600.0,  # of chunks that take minutes, too
    ) as progress:
        bar = progress.add_task(
            title or "",
            total=sum(len(chunk.jobs) for chunk in chunks),
            completed=sum(len(chunk.jobs) for chunk in saved),
        )
        said = time.monotonic()
        for chunk, results in _finished(function, missing, pool):
            progress.advance(bar, len(results))
            quiet = title is None or progress.console.is_terminal
            if not quiet and time.monotonic() - said > SAID_EVERY:
                said, task = time.monotonic(), progress.tasks[bar]
                progress.print(f"{title}: {task.completed:g} of {task.total:g}")
            yield from enumerate(results, chunk.start)


def _finished(
    function: Callable[[J], R], chunks: Sequence[Chunk], pool: Pool
) -> Iterator[tuple[Chunk, list[R]]]:
    """Run chunks, save each as it finishes, and yield it; those whose worker dies run again."""
    waiting = deque(chunks)
    deaths: Counter[int] = Counter()
    running: dict[Future, Chunk] = {}
    failures: list[BaseException] = []
    try:
        while running or (waiting and not failures):
            while waiting and not failures and len(running) < pool.workers:
                chunk = waiting.popleft()
                running[pool.submit(_call, function, chunk.jobs)] = chunk
            finished = []
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                chunk = running.pop(future)
                error = future.exception()
                if pool.died(future):
                    deaths[chunk.start] += 1
                    waiting.append(chunk)
                    if deaths[chunk.start] == ATTEMPTS:
                        what = f"its worker died {ATTEMPTS} times, and the last time of"
                        failures.append(_failure(chunk, what, error))
                elif error is not None:
                    failures.append(_failure(chunk, "got", error))
                else:
                    _save(chunk, future.result())
                    finished.append((chunk, future.result()))
            yield from finished
        if failures:  # after the end of those that ran beside it
            raise failures[0]
    finally:
        pool.close()


def _call(function: Callable[[J], R], jobs: Sequence[J]) -> list[R]:
    return [function(job) for job in jobs]


def _failure(chunk: Chunk, what: str, error: BaseException | None) -> BaseException:
    """Return an error of this package as it is, of any other one a sentence with its chunk."""
    error = getattr(error, "cause", error)  # what was raised on a node of Ray
    if isinstance(error, HcbfError):
        return error
    reason = f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}"
    failure = ChunkError(f"{chunk}: {what} {reason}")
    failure.__cause__ = error
    return failure


def _save(chunk: Chunk, results: list[R]) -> None:
    if chunk.path is not None:
        chunk.path.parent.mkdir(parents=True, exist_ok=True)
        with whole(chunk.path) as partial:
            joblib.dump(results, partial, compress=3)


def _load(chunk: Chunk) -> list[Any]:
    try:
        return joblib.load(chunk.path)
    except (*UNREADABLE, EOFError, OSError, ImportError, pickle.UnpicklingError) as error:
        raise InvalidInputError(
            f"chunks: got {chunk.path} that cannot be read ({error}), expected a finished chunk; "
            "delete it to run it again"
        ) from error
