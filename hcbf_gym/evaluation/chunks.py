"""A function over many jobs, by processes or on a Ray cluster, so that no finished work is lost.

Jobs run in chunks. A chunk is saved as soon as it has finished; one whose worker or node died runs
again; the same call, made again, runs what is missing. `docs/cluster.md` says how a cluster is
found.

>>> from tempfile import TemporaryDirectory
>>> with TemporaryDirectory() as folder:
...     results = dict(Runs(Path(folder), workers=1).over(abs, [-1.5, 2.5]))
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
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import joblib
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeElapsedColumn

from hcbf_gym import opened, version
from hcbf_gym.certificates import same
from hcbf_gym.errors import UNREADABLE, ChunkError, HcbfError, InvalidInputError, warn_caller
from hcbf_gym.evaluation import workers as working
from hcbf_gym.evaluation.workers import Backend
from hcbf_gym.opened import MISSING, content
from hcbf_gym.records import make_folder, whole
from hcbf_gym.sources import PACKAGE, read_by_name, sources_hash

SAID_EVERY = 15.0
"""Where no terminal shows the progress, it is printed [s]."""
COMPUTING = ("numpy", "scipy", "mujoco", "gymnasium")
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


@dataclass(frozen=True)
class Runs:
    """How the jobs of a study run.

    Args:
        folder: where chunks are saved; None to save nothing.
        workers: chunks that run at once; None for as many as the backend has CPUs.
        backend: "processes" or "ray".
        quiet: show no bar.
    """

    folder: Path | None = None
    workers: int | None = None
    backend: Backend = "processes"
    quiet: bool = False

    def check(self) -> int:
        """Return how many chunks run at once.

        Raises:
            HcbfError: as `workers.count` does.
        """
        return working.count(self.backend, self.workers)

    def over(
        self,
        function: Callable[[J], R],
        jobs: Sequence[J],
        title: str | None = None,
        reads: Sequence[Path] = (),
        size: int = 1,
        plant: str = "",
        repeat: bool = False,
    ) -> Iterator[tuple[int, R]]:
        """Yield (number of the job, its result): first saved ones, the others as they finish.

        An end of the iteration stops the workers. The results of a chunk are saved, bit for bit, in
        a file that is named by a hash of what was run: the function with all sources below it, the
        files and the plant that it reads, the versions of what computes, and the jobs. With them
        the file holds a hash of every file that the jobs opened, see `opened`, and it counts only
        while these are the same. So a folder never answers for other work, and chunks of several
        machines may be put into one.

        Args:
            function: job → result; it, the jobs and the results can be pickled.
            jobs: what to run.
            title: of a bar that shows what is done and how long the rest takes; None for no bar.
            reads: the files of the user's own that decide the results: scenes, contracts, policies.
            size: jobs in a chunk.
            plant: the identity of the user's plant, see `own_environment.identity`; "" for none.
            repeat: whether one job of every saved chunk runs again and is compared; where it comes
                out otherwise, all of the chunk runs again, with a warning.

        Raises:
            InvalidInputError: if the size or the workers are below 1, if a cluster has fewer CPUs
                than workers, if the function or a job cannot be pickled, or if what decides the
                results changes while they are computed.
            UnknownNameError: if there is no such backend.
            MissingDependencyError: if Ray is requested and not installed.
            ChunkError: if the function raises an error that is not of this package, or the workers
                of one chunk died `ATTEMPTS` times.
        """
        if size < 1:
            raise InvalidInputError(f"size: got {size}, expected at least 1")
        read = {str(file): content(str(file)) for file in reads}
        work = _Work(function, read, self.backend, self.check())
        identity = ""
        if self.folder is not None:  # a shipped certificate sets the margins of its plant
            shipped = sorted(PACKAGE.glob("certificates/shipped/*.json"))
            sources = sources_of(function, [*reads, *shipped])
            identity = f"{sources} {_hash(function)} {versions()} {plant}"
        chunks = []
        for start in range(0, len(jobs), size):
            part = jobs[start : start + size]
            path = self.folder and self.folder / f"{_key(identity, part)}.chunk"
            chunks.append(Chunk(start, part, path))
        return _complete(work, chunks, repeat, None if self.quiet else title)


def in_order(runs: Iterator[tuple[int, R]]) -> list[R]:
    """Return all results of `Runs.over`, in the order of the jobs."""
    results = dict(runs)
    return [results[number] for number in range(len(results))]


def versions() -> dict[str, str]:
    """Return name → version of what decides the bits of a result."""
    found = {name: importlib.metadata.version(name) for name in COMPUTING}
    here = {"python": platform.python_version(), "machine": platform.machine()}
    return {"hcbf-gym": version.VERSION} | found | here


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


class _Work(NamedTuple):
    """What runs.

    Attributes:
        function: as `Runs` takes them.
        read: path → hash of what `Runs.over` reads beside what jobs open.
        backend: as `Runs` takes them.
        workers: chunks that run at once.
    """

    function: Callable[..., Any]
    read: Mapping[str, str]
    backend: Backend
    workers: int


class _Done(NamedTuple):
    """What a chunk's file holds.

    Attributes:
        results: one for each job.
        read: path → hash of what decided them, see `opened.recorded`.
    """

    results: list[Any]
    read: dict[str, str]


def _complete(
    work: _Work, chunks: Sequence[Chunk], repeat: bool, title: str | None
) -> Iterator[tuple[int, Any]]:
    """Yield what is saved and still holds, then what runs."""
    for folder in {chunk.path.parent for chunk in chunks if chunk.path is not None}:
        make_folder(folder)
    saved = _saved(work, chunks, repeat)
    for chunk in saved:
        yield from enumerate(_load(chunk).results, chunk.start)
    columns = (*Progress.get_default_columns(), MofNCompleteColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(
        *columns,
        console=console,
        disable=title is None or console.is_jupyter,  # rich warns there without ipywidgets
        speed_estimate_period=3600.0,  # of chunks that take minutes, too
    ) as progress:
        bar = progress.add_task(
            title or "",
            total=sum(len(chunk.jobs) for chunk in chunks),
            completed=sum(len(chunk.jobs) for chunk in saved),
        )
        said = time.monotonic()
        held = {chunk.start for chunk in saved}
        missing = [chunk for chunk in chunks if chunk.start not in held]
        for chunk, done in _finished(work, missing):
            progress.advance(bar, len(done.results))
            quiet = title is None or progress.console.is_terminal
            if not quiet and time.monotonic() - said > SAID_EVERY:
                said, task = time.monotonic(), progress.tasks[bar]
                progress.print(f"{title}: {task.completed:g} of {task.total:g}")
            yield from enumerate(done.results, chunk.start)


def _saved(work: _Work, chunks: Sequence[Chunk], repeat: bool) -> list[Chunk]:
    """Return the chunks that are saved and still hold; the files of others are deleted."""
    holding: dict[int, Chunk] = {}
    samples: dict[int, tuple[Chunk, Any]] = {}
    for chunk in chunks:
        if chunk.path is None or not chunk.path.exists():
            continue
        done = _load(chunk)
        if _changed(work, done):
            chunk.path.unlink()
            continue
        holding[chunk.start] = chunk
        k = int(hashlib.sha256(chunk.path.name.encode()).hexdigest(), 16) % len(chunk.jobs)
        samples[chunk.start + k] = chunk, done.results[k]
    again = [Chunk(n, [one.jobs[n - one.start]], None) for n, (one, _) in samples.items()]
    for repeated, done in _finished(work, again) if repeat else ():
        chunk, kept = samples[repeated.start]
        if not same(kept, done.results[0]):
            warn_caller(
                f"{chunk}: {chunk.path} holds another result of job {repeated.start} than it gives "
                "now: the chunk runs again"
            )
            assert chunk.path is not None
            chunk.path.unlink()
            del holding[chunk.start]
    return list(holding.values())


def _changed(work: _Work, done: _Done) -> list[str]:
    """Return the files that decided results and are not the same any more."""
    read = {**work.read, **done.read}
    return [name for name, then in read.items() if content(name) != then]


def _finished(work: _Work, chunks: Sequence[Chunk]) -> Iterator[tuple[Chunk, _Done]]:
    """Run chunks, and yield each as it finishes; those whose worker dies run again.

    joblib does not report which job killed its worker, and stops the others. So a death counts for
    each chunk that ran, and the last attempt of a chunk is alone. A chunk that dies then is given
    up, and a second one ends the run.
    """
    waiting = {chunk.start: chunk for chunk in chunks}
    deaths: Counter[int] = Counter()
    given_up: list[Exception] = []
    while waiting and len(given_up) < 2:
        together = [one for one in waiting.values() if deaths[one.start] < ATTEMPTS - 1]
        begun: list[Chunk] = []
        failures: list[Exception] = []
        calls = _calls(work, together or list(waiting.values())[:1], begun, failures)
        results: Any = None
        try:
            results = working.parallel(work.backend, work.workers)(calls)
            for start, done in results:
                if isinstance(done, _Done):
                    chunk = waiting.pop(start)
                    _save(work, chunk, done)
                    yield chunk, done
                else:
                    failures.append(done)  # raised after the end of those that run beside it
        except working.deaths(work.backend) as error:
            deaths[-1] += not begun  # a node died where workers were to start
            if deaths[-1] == ATTEMPTS:
                raise
            for chunk in [one for one in begun if one.start in waiting]:
                if chunk.path is not None and chunk.path.exists():
                    yield waiting.pop(chunk.start), _load(chunk)
                    continue
                deaths[chunk.start] += 1
                if deaths[chunk.start] == ATTEMPTS:
                    what = f"its worker died {ATTEMPTS} times, and the last time of"
                    given_up.append(_failure(chunk, what, error))
                    del waiting[chunk.start]
        finally:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # that jobs were stopped
                if results is not None:
                    results.close()
        if failures:
            raise failures[0]
    if given_up:
        raise given_up[0]


def _calls(
    work: _Work, chunks: Sequence[Chunk], begun: list[Chunk], failures: Sequence[Exception]
) -> Iterator[Any]:
    """Yield the calls of chunks for joblib, and note each, until one has failed."""
    for chunk in chunks:
        if failures:
            return
        begun.append(chunk)
        yield joblib.delayed(_call)(work, chunk)


def _call(work: _Work, chunk: Chunk) -> tuple[int, _Done | Exception]:
    """Run the jobs of a chunk, save their results, and return its start and what came of it."""
    try:
        with opened.recorded() as read:
            done = _Done([work.function(job) for job in chunk.jobs], read)
        there = [
            name for name in _changed(work, done) if MISSING not in (read.get(name), content(name))
        ]
        if there:
            raise InvalidInputError(
                f"{chunk}: {', '.join(there)} changed after it was read, expected it "
                "to stay; give the command again, in a new process"
            )
        _save(work, chunk, done)
    except Exception as error:  # of the function, or of the disk
        return chunk.start, _failure(chunk, "got", error)
    return chunk.start, done


def _failure(chunk: Chunk, what: str, error: Exception) -> Exception:
    """Return an error of this package as it is, of any other one a sentence with its chunk."""
    if isinstance(error, HcbfError):
        return error
    reason = f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}"
    failure = ChunkError(f"{chunk}: {what} {reason}")
    failure.__cause__ = error
    return failure


def _save(work: _Work, chunk: Chunk, done: _Done) -> None:
    """Save results where the folder is, unless they are there, or a file came or went meanwhile."""
    path = chunk.path
    if path is None or path.exists() or not path.parent.is_dir() or _changed(work, done):
        return
    with whole(path) as partial:
        joblib.dump(tuple(done), partial, compress=3)


def _load(chunk: Chunk) -> _Done:
    try:
        return _Done(*joblib.load(chunk.path))
    except (*UNREADABLE, EOFError, OSError, ImportError, pickle.UnpicklingError) as error:
        raise InvalidInputError(
            f"chunks: got {chunk.path} that cannot be read ({error}), expected a finished chunk; "
            "delete it to run it again"
        ) from error
