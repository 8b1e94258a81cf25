"""A function over many jobs, by processes or on a Ray cluster, so that no finished job is lost.

Each result is saved as soon as its job has finished. A job whose worker or node died runs again,
and the same call, made again, runs the missing jobs. `docs/cluster.md` describes Ray clusters.

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
from hcbf_gym.errors import HcbfError, InvalidInputError, JobError, in_words, warn_caller
from hcbf_gym.evaluation import workers as backends
from hcbf_gym.evaluation.workers import Backend
from hcbf_gym.opened import MISSING, content
from hcbf_gym.records import make_folder, whole
from hcbf_gym.sources import of_user, sources_hash

PRINTED_EVERY = 15.0  # [s] between two lines of progress, where no terminal shows a bar
COMPUTING = ("numpy", "scipy", "mujoco", "gymnasium")  # their versions decide an episode's bits
ATTEMPTS = 5  # a job is given up after its worker has died so often
REPEATED = 10  # one of so many saved jobs is repeated
_NO_JOB = -1  # in the place of a job's number

J = TypeVar("J")
R = TypeVar("R")


@dataclass(frozen=True)
class Runs:
    """Where the jobs of a study run, and where their results are saved."""

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
        """Yield (number of the job, its result): first saved results, the others as they finish.

        The workers wait for the next call, and stop if the iteration ends early. A result is saved,
        bit for bit, in a file whose name is a hash of the work: the function with its file, the
        packages' sources, the files and the plant that it reads, the versions in `versions`, and
        the job. The file also holds a hash of every file that the job opened, see `opened`. A saved
        result is valid while these files are the same. So files of several machines may be put into
        one folder.

        Args:
            function: job → result; it, the jobs and the results can be pickled.
            jobs: the arguments of the function, one for each call.
            title: the title of a progress bar; None for no bar.
            reads: the user's files that decide the results: scenes, contracts, policies.
            plant: the identity of the user's plant, see `own_environment.plant_hash`; "" for none.
            repeat: whether one in `REPEATED` saved jobs runs again and is compared. If a result
                differs, all saved jobs run again, with a warning.

        Raises:
            InvalidInputError: if the function or a job cannot be pickled, or a file that decides
                the results changes while they are computed.
            HcbfError: as `workers.count` does.
            JobError: if the function raises an error that is not of this package, or the workers of
                one job died `ATTEMPTS` times.
        """
        hashes = {str(file): content(str(file)) for file in reads}
        work = _Work(function, hashes, self.backend, self.check())
        numbered = [_Job(number, argument, None) for number, argument in enumerate(jobs)]
        if self.folder is not None:
            identity = f"{sources_of(function, reads)} {_hash(function)} {versions()} {plant}"
            numbered = [
                job._replace(path=self.folder / f"{key(identity, job.argument)}.job")
                for job in numbered
            ]
        return _complete(work, self.folder, numbered, repeat, None if self.quiet else title)


def in_order(runs: Iterator[tuple[int, R]]) -> list[R]:
    """Return all results of `Runs.over`, in the order of the jobs."""
    results = dict(runs)
    return [results[number] for number in range(len(results))]


def versions() -> dict[str, str]:
    """Return name → version of the packages, the interpreter and the machine type that compute."""
    packages = {name: importlib.metadata.version(name) for name in COMPUTING}
    platforms = {"python": platform.python_version(), "machine": platform.machine()}
    return {"hcbf-gym": version.release()} | packages | platforms


def sources_of(function: Callable[..., object], reads: Sequence[Path] = ()) -> str:
    """Return a hash of this package's sources, of the file of a user's function, and of files."""
    inner: Any = function
    while isinstance(inner, functools.partial):
        inner = inner.func
    try:
        own = of_user(Path(inspect.getfile(inner)))
    except TypeError:  # built in
        own = []
    return sources_hash([*own, *reads])


def key(identity: str, job: object) -> str:
    """Return the name of the file of a job's result, without its ending."""
    return hashlib.sha256(f"{identity}\n{_hash(job)}".encode()).hexdigest()[:20]


def _hash(value: object) -> str:
    """Return a hash of a value's pickle, which is the same in all processes."""
    try:
        return str(joblib.hash(value, hash_name="sha1"))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InvalidInputError(
            f"jobs: got {reprlib.repr(value)}, expected what can be pickled ({error})"
        ) from error


class _Job(NamedTuple):
    """A job, by its number, the function's argument, and the file of its result if it is saved."""

    number: int
    argument: Any
    path: Path | None

    def __str__(self) -> str:
        return f"job {self.number}, {reprlib.repr(self.argument)}"


class _Work(NamedTuple):
    """The function of all jobs, path → hash of the files that it reads, and its workers."""

    function: Callable[..., Any]
    hashes: Mapping[str, str]
    backend: Backend
    workers: int


class _Result(NamedTuple):
    """The content of a job's file: a value, and path → hash of the files that the job opened."""

    value: Any
    hashes: dict[str, str]


def _complete(
    work: _Work, folder: Path | None, jobs: Sequence[_Job], repeat: bool, title: str | None
) -> Iterator[tuple[int, Any]]:
    """Yield the saved results that are valid, then run the other jobs and yield theirs."""
    saved: list[_Job] = []
    if folder is not None:
        make_folder(folder)
        saved = _valid_jobs(work, jobs, repeat)
    for job in saved:
        yield job.number, _load(job).value
    columns = (*Progress.get_default_columns(), MofNCompleteColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(
        *columns,
        console=console,
        disable=title is None or console.is_jupyter,  # rich warns there without ipywidgets
        speed_estimate_period=3600.0,  # also of jobs that take minutes
    ) as progress:
        bar = progress.add_task(title or "", total=len(jobs), completed=len(saved))
        prints = title is not None and not progress.console.is_terminal
        printed = time.monotonic()
        saved_numbers = {job.number for job in saved}
        missing = [job for job in jobs if job.number not in saved_numbers]
        for number, result in _run(work, missing):
            progress.advance(bar)
            if prints and time.monotonic() - printed > PRINTED_EVERY:
                printed, task = time.monotonic(), progress.tasks[bar]
                progress.print(f"{title}: {task.completed:g} of {task.total:g}")
            yield number, result.value


def _valid_jobs(work: _Work, jobs: Sequence[_Job], repeat: bool) -> list[_Job]:
    """Return the jobs with a valid saved result, and delete the files of other results."""
    valid: list[_Job] = []
    sample: dict[int, tuple[_Job, Any]] = {}  # number → one in `REPEATED` of the jobs, its value
    for job in jobs:
        if job.path is None or not job.path.exists():
            continue
        result = _load(job)
        if _changed_files(work, result):
            job.path.unlink()
            continue
        if len(valid) % REPEATED == 0:
            sample[job.number] = job, result.value
        valid.append(job)
    repeated = [job._replace(path=None) for job, _ in sample.values()] if repeat else []
    for number, result in _run(work, repeated):
        job, saved_value = sample[number]
        if not same(saved_value, result.value):
            warn_caller(
                f"{job}: {job.path} holds another result than the job gives now: all saved jobs "
                "run again"
            )
            for other in valid:
                assert other.path is not None
                other.path.unlink(missing_ok=True)
            return []
    return valid


def _changed_files(work: _Work, result: _Result) -> list[str]:
    """Return the files that decided a result and are not the same any more."""
    hashes = {**work.hashes, **result.hashes}
    return [name for name, old_hash in hashes.items() if content(name) != old_hash]


def _run(work: _Work, jobs: Sequence[_Job]) -> Iterator[tuple[int, _Result]]:
    """Run jobs, and yield each as it finishes; those whose worker dies run again.

    joblib does not report which job killed its worker, and stops the others. So a death counts for
    each job that ran, and the last attempt of a job is alone. A job that dies then is given up,
    and a second one ends the run.
    """
    waiting = {job.number: job for job in jobs}
    deaths: Counter[int] = Counter()
    given_up: list[Exception] = []
    while waiting and len(given_up) < 2:
        together = [job for job in waiting.values() if deaths[job.number] < ATTEMPTS - 1]
        begun: list[_Job] = []
        failures: list[Exception] = []
        calls = _calls(work, together or list(waiting.values())[:1], begun, failures)
        results: Any = None
        try:
            results = backends.parallel(work.backend, work.workers)(calls)
            for number, result in results:
                if isinstance(result, _Result):
                    _save(work, waiting.pop(number), result)
                    yield number, result
                else:
                    failures.append(result)  # raised when the jobs beside it have ended
        except backends.deaths(work.backend) as error:
            deaths[_NO_JOB] += not begun  # a node died where workers were to start
            if deaths[_NO_JOB] == ATTEMPTS:
                raise
            for job in [job for job in begun if job.number in waiting]:
                if job.path is not None and job.path.exists():  # saved before the death
                    yield job.number, _load(waiting.pop(job.number))
                    continue
                deaths[job.number] += 1
                if deaths[job.number] == ATTEMPTS:
                    event = f"its worker died {ATTEMPTS} times, and the last time of"
                    given_up.append(_failure(job, event, error))
                    del waiting[job.number]
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
    """Yield the calls of jobs for joblib, and add each job to `begun`, until one has failed."""
    for job in jobs:
        if failures:
            return
        begun.append(job)
        yield joblib.delayed(_call)(work, job)


def _call(work: _Work, job: _Job) -> tuple[int, _Result | Exception]:
    """Run a job in a worker and save its result; return its number with the result or the error."""
    try:
        with opened.recorded() as hashes:
            value = work.function(job.argument)
        result = _Result(value, hashes)
        changed = _changed_files(work, result)
        edited = [file for file in changed if MISSING not in (hashes.get(file), content(file))]
        if edited:
            raise InvalidInputError(
                f"{job}: {', '.join(edited)} changed after it was read, expected it "
                "to stay; give the command again, in a new process"
            )
        _save(work, job, result)
    except Exception as error:  # of the function, or of the disk
        return job.number, _failure(job, "got", error)
    return job.number, result


def _failure(job: _Job, event: str, error: Exception) -> Exception:
    """Return an error of this package as it is, and others as a `JobError` that names the job."""
    if isinstance(error, HcbfError):
        return error
    reason = in_words(error).strip().partition("\n")[0]
    failure = JobError(f"{job}: {event} {reason}")
    failure.__cause__ = error
    return failure


def _save(work: _Work, job: _Job, result: _Result) -> None:
    """Save a result, unless it is saved, the folder is gone, or a file that decided it changed."""
    path = job.path
    if path is None or path.exists() or not path.parent.is_dir() or _changed_files(work, result):
        return
    with whole(path) as partial:
        joblib.dump(tuple(result), partial, compress=3)


def _load(job: _Job) -> _Result:
    """Read the saved result of a job."""
    try:
        return _Result(*joblib.load(job.path))
    except Exception as error:  # a damaged pickle may raise any
        raise InvalidInputError(
            f"jobs: got {job.path} that cannot be read ({error}), expected a saved result; "
            "delete it to run its job again"
        ) from error
