"""Who runs calls: this process, processes of this machine, or a Ray cluster."""

import importlib
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future
from typing import Any, Literal, Protocol

import joblib
from joblib.externals.loky import ProcessPoolExecutor

from hcbf_gym.errors import (
    CoverageWarning,
    InvalidInputError,
    MissingDependencyError,
    choose,
    install,
)

Backend = Literal["processes", "ray"]
"""Processes of this machine, or a Ray cluster (the extra `cluster`)."""


class Pool(Protocol):
    """Workers, of which each runs one call at a time.

    Attributes:
        workers: how many there are.
    """

    workers: int

    def submit(self, function: Callable[..., object], *args: object) -> Future:
        """Begin a call; at most as many run as there are workers."""
        ...

    def died(self, future: Future) -> bool:
        """Return whether the worker of a finished call died before it had an answer."""
        ...

    def close(self) -> None:
        """Stop the workers, whatever they run."""
        ...


def open_pool(backend: Backend, workers: int | None) -> Pool:
    """Return workers.

    Args:
        backend: "processes" or "ray".
        workers: how many; None for the cores that this process may use, or the cluster's CPUs.
            One process is this one.

    Raises:
        UnknownNameError: if there is no such backend.
        InvalidInputError: if there are less than 1, or more than the cluster has CPUs; if no
            cluster answers where one is expected.
        MissingDependencyError: if Ray is asked for and not installed.
    """
    kind = choose("backend", backend, {"processes": Processes, "ray": RayTasks})
    if workers is not None and workers < 1:
        raise InvalidInputError(f"workers: got {workers}, expected at least 1")
    if kind is Processes:
        workers = workers or joblib.cpu_count()
        return ThisProcess() if workers == 1 else Processes(workers)
    return RayTasks(workers)


class ThisProcess:
    """One worker: the caller."""

    workers = 1

    def submit(self, function: Callable[..., object], *args: object) -> Future:
        """Call at once; return a future that is done."""
        future: Future = Future()
        try:
            future.set_result(function(*args))
        except Exception as error:
            future.set_exception(error)
        return future

    def died(self, future: Future) -> bool:
        """Return False: a caller who is there has not died."""
        return False

    def close(self) -> None:
        """Do nothing."""


_IDLE: list[ProcessPoolExecutor] = []
"""Processes that wait for the next call of any pool, since one takes seconds to start."""


class Processes:
    """Processes of this machine, each in an executor of its own, so that a death is told apart.

    Args:
        workers: how many.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._busy: dict[Future, ProcessPoolExecutor] = {}

    def submit(self, function: Callable[..., object], *args: object) -> Future:
        """Begin a call in a process that is idle, or in a new one."""
        while _IDLE:
            executor = _IDLE.pop()
            try:
                future = executor.submit(function, *args)
            except BrokenExecutor:  # it died while it was idle
                continue
            self._busy[future] = executor
            return future
        _IDLE.append(
            ProcessPoolExecutor(
                1,
                initializer=_follow,
                initargs=(os.getpid(),),
                env={"OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS", "1")},
            )
        )
        return self.submit(function, *args)

    def died(self, future: Future) -> bool:
        """Return whether the process died; one that lives is idle again."""
        executor = self._busy.pop(future)
        died = isinstance(future.exception(), BrokenExecutor)
        if died:
            executor.shutdown(kill_workers=True)
        else:
            _IDLE.append(executor)
        return died

    def close(self) -> None:
        """Kill the processes that are at work."""
        for executor in self._busy.values():
            executor.shutdown(kill_workers=True)


def _follow(parent: int) -> None:
    """Leave interrupts and coverage to the parent, and end with it, which may be killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore", CoverageWarning)  # the parent has said it before work began

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.1)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class RayTasks:
    """Tasks of one CPU each on a Ray cluster, or on this machine where there is none.

    Args:
        workers: tasks that run at once; None for the cluster's CPUs.

    Raises:
        InvalidInputError: if there are more than the cluster has CPUs, or no cluster answers.
        MissingDependencyError: if Ray is not installed.
    """

    def __init__(self, workers: int | None) -> None:
        try:
            self._ray: Any = importlib.import_module("ray")
        except ImportError as error:
            raise MissingDependencyError(
                f"backend 'ray': got no ray, expected the extra cluster: {install('cluster')}"
            ) from error
        if not self._ray.is_initialized():
            try:
                self._ray.init(log_to_driver=False, logging_level="ERROR")
            except (ConnectionError, RuntimeError, ValueError) as error:
                where = os.environ.get("RAY_ADDRESS", "this machine")
                reason = str(error).partition("\n")[0]
                raise InvalidInputError(
                    f"backend 'ray': no cluster answers at {where}: {reason}"
                ) from error
        cpus = int(self._ray.cluster_resources().get("CPU", 0))
        self.workers = cpus if workers is None else workers
        if not 1 <= self.workers <= cpus:
            raise InvalidInputError(
                f"workers: got {self.workers}, expected at most the {cpus} CPUs of the Ray cluster"
            )
        self._running: set[Future] = set()

    def submit(self, function: Callable[..., object], *args: object) -> Future:
        """Begin a task, which Ray itself does not repeat."""
        task = self._ray.remote(num_cpus=1, max_retries=0)(function)
        future = task.remote(*args).future()
        self._running.add(future)
        return future

    def died(self, future: Future) -> bool:
        """Return whether the task ended by anything but an answer or an error of its own."""
        self._running.remove(future)
        error, errors = future.exception(), self._ray.exceptions
        return isinstance(error, errors.RayError) and not isinstance(error, errors.RayTaskError)

    def close(self) -> None:
        """Stop the tasks; the connection stays for the next."""
        for future in self._running:
            self._ray.cancel(future.object_ref, force=True)  # type: ignore[attr-defined]
