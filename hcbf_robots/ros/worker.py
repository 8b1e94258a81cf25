"""A thread for work that would delay commands, such as making barriers of a source's message."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

Job = Callable[[], None]
THREADS = "prepares"
"""The names of these threads begin with it."""


class Worker:
    """Runs jobs one after another in a thread; a newer job replaces a waiting one of its name.

    Args:
        failed: called in that thread with the name of a job and the exception that it raised.
    """

    def __init__(self, failed: Callable[[str, Exception], None]) -> None:
        self._failed = failed
        self._jobs: dict[str, Job] = {}
        self._thread = ThreadPoolExecutor(1, thread_name_prefix=THREADS)

    def put(self, name: str, job: Job) -> None:
        """Run a job soon, in the place of a waiting one of its name."""
        self._jobs[name] = job
        self._thread.submit(self._run, name)

    def close(self) -> None:
        """Finish the running job, drop the waiting ones, and end the thread."""
        self._jobs.clear()
        self._thread.shutdown(cancel_futures=True)

    def _run(self, name: str) -> None:
        job = self._jobs.pop(name, None)
        try:
            if job is not None:
                job()
        except Exception as error:  # of every class, because a future would hide it
            self._failed(name, error)
