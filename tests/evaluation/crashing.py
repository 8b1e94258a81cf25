"""Jobs that fail, for the workers of `test_jobs`."""

import contextlib
import os
import signal
import subprocess
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
    """Kill the worker of job 3 once the others are saved, as a machine out of memory does."""
    folder, number = job
    mark = Path(folder) / "died"
    if number == 3 and not mark.exists():
        while len(list(Path(folder).glob("saved/[!.]*.job"))) < 3:
            time.sleep(0.01)
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


def lagged(job):
    """Return a number that a file decides, and another one where that is there."""
    file, k = job
    bonus = 0.0
    with contextlib.suppress(FileNotFoundError):
        bonus = float((Path(file).parent / "bonus").read_text())
    return k + float(Path(file).read_text()) + bonus


def changes_it(file):
    """Read a file, of which another process makes another one meanwhile."""
    read = float(Path(file).read_text())
    subprocess.run(["sh", "-c", 'echo 2.0 > "$0"', file], check=True)
    return read


def cached(job):
    """Read a file that an earlier call may have written."""
    file, k = job
    try:
        found = float(Path(file).read_text())
    except FileNotFoundError:
        found = 0.0
    Path(file).write_text("1.0")
    return k + 0.0 * found
