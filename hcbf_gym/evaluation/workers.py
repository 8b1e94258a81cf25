"""Where jobs run: in this process, in processes of this machine, or on a Ray cluster."""

import importlib
import os
import signal
import threading
import time
import warnings
from concurrent.futures import BrokenExecutor
from typing import Any, Literal

import joblib

from hcbf_gym.errors import (
    CoverageWarning,
    InvalidInputError,
    MissingDependencyError,
    choose,
    install,
)

Backend = Literal["processes", "ray"]  # of this machine, or a Ray cluster (the extra `cluster`)
IDLE_LIMIT = 86_400.0
"""How long a worker waits for a job [s]: longer than any pause between two runs of a study. The
limit of joblib, 300 s, may pass just as the next jobs are given, and then joblib warns of a worker
that stopped. Workers end with this process, see `_follow`."""


def count(backend: Backend, workers: int | None) -> int:
    """Return how many jobs run at once: the requested workers, or all CPUs of the backend.

    Raises:
        UnknownNameError: if there is no such backend.
        InvalidInputError: if `workers` is less than 1 or more than the cluster's CPUs, or if no
            cluster answers.
        MissingDependencyError: if Ray is requested and not installed.
    """
    cpus = choose("backend", backend, {"processes": joblib.cpu_count, "ray": _ray_cpus})
    if workers is not None and workers < 1:
        raise InvalidInputError(f"workers: got {workers}, expected at least 1")
    if backend == "processes":
        return workers or cpus()
    available = cpus()
    if (workers or available) > available:
        raise InvalidInputError(
            f"workers: got {workers}, expected at most the {available} CPUs of the Ray cluster"
        )
    return workers or available


def parallel(backend: Backend, workers: int) -> joblib.Parallel:
    """Return an executor that yields results as they finish; one worker is this process."""
    options: dict[str, Any] = {"pre_dispatch": "n_jobs", "batch_size": 1, "max_nbytes": None}
    if backend == "processes":
        options |= {"backend": "loky", "inner_max_num_threads": 1}
        options |= {"initializer": _follow, "initargs": (os.getpid(),)}
        options["idle_worker_timeout"] = IDLE_LIMIT
    else:
        ray_backend = importlib.import_module("ray.util.joblib.ray_backend").RayBackend()
        # Ray's class does not declare that its pool calls back, which is all that yielding needs
        ray_backend.supports_return_generator = True
        options["backend"] = ray_backend
        workers = min(workers, _ray_cpus())  # a node may have died
    return joblib.Parallel(workers, return_as="generator_unordered", **options)


def deaths(backend: Backend) -> type[Exception]:
    """Return the type of the error that a worker's death raises."""
    return BrokenExecutor if backend == "processes" else _ray().exceptions.RayError


def _follow(parent: int) -> None:
    """Let a worker ignore interrupts, which the parent handles, and end when the parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore", CoverageWarning)  # the parent has warned before work began

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.1)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _ray() -> Any:
    """Return the module `ray`, or raise an error with the line that installs it."""
    try:
        return importlib.import_module("ray")
    except ImportError as error:
        raise MissingDependencyError(
            f"backend 'ray': got no ray, expected the extra cluster: {install('cluster')}"
        ) from error


def _ray_cpus() -> int:
    """Return the number of CPUs of the Ray cluster; without one, Ray starts on this machine."""
    ray = _ray()
    if not ray.is_initialized():
        try:
            ray.init(log_to_driver=False, logging_level="ERROR")
        except (ConnectionError, RuntimeError, ValueError) as error:
            address = os.environ.get("RAY_ADDRESS", "this machine")
            reason = str(error).partition("\n")[0]
            raise InvalidInputError(
                f"backend 'ray': no cluster answers at {address}: {reason}"
            ) from error
    return int(ray.cluster_resources().get("CPU", 0))
