"""A function over many jobs, by processes or on a Ray cluster, so that no finished job is lost.

Each result is saved as soon as its job has finished. A job whose worker or node died runs again;
the same call, made again, runs what is missing. `docs/cluster.md` explains how a cluster is found.

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
from hcbf_gym.errors import UNREADABLE, HcbfError, InvalidInputError, JobError, warn_caller
from hcbf_gym.evaluation import workers as backends
from hcbf_gym.evaluation.workers import Backend
from hcbf_gym.opened import MISSING, content
from hcbf_gym.records import make_folder, whole
from hcbf_gym.sources import of_user, sources_hash

PRINTED_EVERY = 15.0  # where no terminal shows the progress, it is printed [s]
COMPUTING = ("numpy", "scipy", "mujoco", "gymnasium")
"""Whose versions decide the bits of an episode."""
ATTEMPTS = 5  # how often a job runs whose worker dies, before it is given up
REPEATED = 10  # one of so many saved jobs is repeated

J = TypeVar("J")
R = TypeVar("R")


@dataclass(frozen=True)
class Runs:
    """How the jobs of a study run."""

    folder: Path | None = None  # where results are saved; None to save nothing
    workers: int | None = None  # jobs that run at once; None for as many as the backend has CPUs
    backend: Backend = "processes"  # "processes" or "ray"
    quiet: bool = False  # show no bar

    def check(self) -> int:
        """Return how many jobs run at once.

        Raises:
            HcbfError: as `workers.count` does.
        """
        return backends.count(self.backend, self.workers)

    def over(
        self,
        function: Callable[[J], R],
        jobs: Sequence[J],
        title: str | None = None,
        reads: Sequence[Path] = (),
        plant: str = "",
        repeat: bool = False,
    ) -> Iterator[tuple[int, R]]:
        """Yield (number of the job, its result): first saved ones, the others as they finish.

        An end of the iteration stops the workers. A result is saved, bit for bit, in a file that is
        named by a hash of the work: the function with its file, the packages' sources, the files
        and the plant that it reads, the versions of what computes, and the job. With it the file
        holds a hash of every file that the job opened, see `opened`, and it counts only while these
        are the same. So files of several machines may be put into one folder.

        Args:
            function: job → result; it, the jobs and the results can be pickled.
            jobs: what to run.
            title: of a bar that shows what is done and how long the rest takes; None for no bar.
            reads: the user's files that decide the results: scenes, contracts, policies.
            plant: the identity of the user's plant, see `own_environment.identity`; "" for none.
            repeat: whether one in `REPEATED` saved jobs runs again and is compared; where one
                differs, all of them run again, with a warning.

        Raises:
            InvalidInputError: if there is less than one worker, a cluster has fewer CPUs than
                workers, the function or a job cannot be pickled, or a file that decides the results
                changes while they are computed.
            UnknownNameError: if there is no such backend.
            MissingDependencyError: if Ray is requested and not installed.
            JobError: if the function raises an error that is not of this package, or the workers of
                one job died `ATTEMPTS` times.
        """
        read = {str(file): content(str(file)) for file in reads}
        work = _Work(function, read, self.backend, self.check())
        listed = [_Job(number, job, None) for number, job in enumerate(jobs)]
        if self.folder is not None:
            identity = f"{sources_of(function, reads)} {_hash(function)} {versions()} {plant}"
            listed = [
                one._replace(path=self.folder / f"{key(identity, one.job)}.job") for one in listed
            ]
        return _complete(work, self.folder, listed, repeat, None if self.quiet else title)


def in_order(runs: Iterator[tuple[int, R]]) -> list[R]:
    """Return all results of `Runs.over`, in the order of the jobs."""
    results = dict(runs)
    return [results[number] for number in range(len(results))]


def versions() -> dict[str, str]:
    """Return name → version of what decides the bits of a result."""
    found = {name: importlib.metadata.version(name) for name in COMPUTING}
    here = {"python": platform.python_version(), "machine": platform.machine()}
    return {"hcbf-gym": version.release()} | found | here


def sources_of(function: Callable[..., object], reads: Sequence[Path] = ()) -> str:
    """Return a hash of the packages, of a user's function with its file, and of files."""
    inner: Any = function
    while isinstance(inner, functools.partial):
        inner = inner.func
    try:
        own = of_user(Path(inspect.getfile(inner)))
    except TypeError:  # built in
        own = []
    return sources_hash([*own, *reads])


def key(identity: str, job: object) -> str:
    """Return the name of a job's file."""
    return hashlib.sha256(f"{identity}\n{_hash(job)}".encode()).hexdigest()[:20]


def _hash(thing: object) -> str:
    try:
        return str(joblib.hash(thing, hash_name="sha1"))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InvalidInputError(
            f"jobs: got {reprlib.repr(thing)}, expected what can be pickled ({error})"
        ) from error


class _Job(NamedTuple):
    """A job, its number, and the file of its result; None where it is not saved."""

    number: int
    job: Any
    path: Path | None

    def __str__(self) -> str:
        return f"job {self.number}, {reprlib.repr(self.job)}"


class _Work(NamedTuple):
    """What runs and where; `read` is path → hash of what `Runs.over` reads."""

    function: Callable[..., Any]
    read: Mapping[str, str]
    backend: Backend
    workers: int


class _Done(NamedTuple):
    """What a file holds: a result, and path → hash of the files that decided it."""

    result: Any
    read: dict[str, str]


def _complete(
    work: _Work, folder: Path | None, jobs: Sequence[_Job], repeat: bool, title: str | None
) -> Iterator[tuple[int, Any]]:
    """Yield what is saved and still holds, then what runs."""
    saved: list[_Job] = []
    if folder is not None:
        make_folder(folder)
        saved = _saved(work, jobs, repeat)
    for one in saved:
        yield one.number, _load(one).result
    columns = (*Progress.get_default_columns(), MofNCompleteColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(
        *columns,
        console=console,
        disable=title is None or console.is_jupyter,  # rich warns there without ipywidgets
        speed_estimate_period=3600.0,  # of jobs that take minutes, too
    ) as progress:
        bar = progress.add_task(title or "", total=len(jobs), completed=len(saved))
        printed = time.monotonic()
        held = {one.number for one in saved}
        for number, done in _finished(work, [one for one in jobs if one.number not in held]):
            progress.advance(bar)
            quiet = title is None or progress.console.is_terminal
            if not quiet and time.monotonic() - printed > PRINTED_EVERY:
                printed, task = time.monotonic(), progress.tasks[bar]
                progress.print(f"{title}: {task.completed:g} of {task.total:g}")
            yield number, done.result


def _saved(work: _Work, jobs: Sequence[_Job], repeat: bool) -> list[_Job]:
    """Return the jobs that are saved and still hold; the files of others are deleted."""
    holding, sample = [], {}
    for one in jobs:
        if one.path is None or not one.path.exists():
            continue
        done = _load(one)
        if _changed(work, done):
            one.path.unlink()
            continue
        if len(holding) % REPEATED == 0:
            sample[one.number] = one, done.result
        holding.append(one)
    again = [one._replace(path=None) for one, _ in sample.values()] if repeat else []
    for number, done in _finished(work, again):
        one, result = sample[number]
        if not same(result, done.result):
            warn_caller(
                f"{one}: {one.path} holds another result than the job gives now: all saved jobs "
                "run again"
            )
            for other in holding:
                assert other.path is not None
                other.path.unlink(missing_ok=True)
            return []
    return holding


def _changed(work: _Work, done: _Done) -> list[str]:
    """Return the files that decided a result and are not the same any more."""
    read = {**work.read, **done.read}
    return [name for name, then in read.items() if content(name) != then]


def _finished(work: _Work, jobs: Sequence[_Job]) -> Iterator[tuple[int, _Done]]:
    """Run jobs, and yield each as it finishes; those whose worker dies run again.

    joblib does not report which job killed its worker, and stops the others. So a death counts for
    each job that ran, and the last attempt of a job is alone. A job that dies then is given up,
    and a second one ends the run.
    """
    waiting = {one.number: one for one in jobs}
    deaths: Counter[int] = Counter()
    given_up: list[Exception] = []
    while waiting and len(given_up) < 2:
        together = [one for one in waiting.values() if deaths[one.number] < ATTEMPTS - 1]
        begun: list[_Job] = []
        failures: list[Exception] = []
        calls = _calls(work, together or list(waiting.values())[:1], begun, failures)
        results: Any = None
        try:
            results = backends.parallel(work.backend, work.workers)(calls)
            for number, done in results:
                if isinstance(done, _Done):
                    _save(work, waiting.pop(number), done)
                    yield number, done
                else:
                    failures.append(done)  # raised after the end of those that run beside it
        except backends.deaths(work.backend) as error:
            deaths[-1] += not begun  # a node died where workers were to start
            if deaths[-1] == ATTEMPTS:
                raise
            for one in [one for one in begun if one.number in waiting]:
                if one.path is not None and one.path.exists():
                    yield one.number, _load(waiting.pop(one.number))
                    continue
                deaths[one.number] += 1
                if deaths[one.number] == ATTEMPTS:
                    what = f"its worker died {ATTEMPTS} times, and the last time of"
                    given_up.append(_failure(one, what, error))
                    del waiting[one.number]
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
    work: _Work, jobs: Sequence[_Job], begun: list[_Job], failures: Sequence[Exception]
) -> Iterator[Any]:
    """Yield the calls of jobs for joblib, and note each, until one has failed."""
    for one in jobs:
        if failures:
            return
        begun.append(one)
        yield joblib.delayed(_call)(work, one)


def _call(work: _Work, one: _Job) -> tuple[int, _Done | Exception]:
    """Run a job, save its result, and return its number and what came of it."""
    try:
        with opened.recorded() as read:
            result = work.function(one.job)
        done = _Done(result, read)
        edited = [
            name for name in _changed(work, done) if MISSING not in (read.get(name), content(name))
        ]
        if edited:
            raise InvalidInputError(
                f"{one}: {', '.join(edited)} changed after it was read, expected it "
                "to stay; give the command again, in a new process"
            )
        _save(work, one, done)
    except Exception as error:  # of the function, or of the disk
        return one.number, _failure(one, "got", error)
    return one.number, done


def _failure(one: _Job, what: str, error: Exception) -> Exception:
    """Return an error of this package as it is, of any other one a sentence with its job."""
    if isinstance(error, HcbfError):
        return error
    reason = f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}"
    failure = JobError(f"{one}: {what} {reason}")
    failure.__cause__ = error
    return failure


def _save(work: _Work, one: _Job, done: _Done) -> None:
    """Save a result where the folder is, unless it is there, or a file came or went meanwhile."""
    path = one.path
    if path is None or path.exists() or not path.parent.is_dir() or _changed(work, done):
        return
    with whole(path) as partial:
        joblib.dump(tuple(done), partial, compress=3)


def _load(one: _Job) -> _Done:
    try:
        return _Done(*joblib.load(one.path))
    except (*UNREADABLE, EOFError, OSError, ImportError, pickle.UnpicklingError) as error:
        raise InvalidInputError(
            f"jobs: got {one.path} that cannot be read ({error}), expected a saved result; "
            "delete it to run its job again"
        ) from error
