"""Jobs that fail, for the workers of `test_chunks`."""

import os
import signal
import time
from pathlib import Path

from hcbf_gym.errors import InvalidInputError


def third(job):
    return {"third": job / 3.0, "far": float("inf")}


def logged(job):
    """Return a number, and note that the job ran."""
    folder, number = job
    with (Path(folder) / f"{number}.ran").open("a") as file:
        file.write("x")
    return number / 3.0


def dies_once(job):
    """Kill the worker the first time, as a machine that runs out of memory does."""
    folder, number = job
    mark = Path(folder) / f"{number}.died"
    if number % 3 == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return logged(job)


def dies(job):
    if job == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return job


def raises(job):
    if job == 2:
        raise KeyError("one\ntwo")
    return job


def refuses(job):
    raise InvalidInputError("job: got one, expected none")


def sleeps(job):
    time.sleep(0.05 if job < 3 else 600.0)
    return job
