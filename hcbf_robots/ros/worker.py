"""A thread beside the commands' path, which prepares the newest message of each source."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

Job = Callable[[], None]
THREADS = "prepares"
"""How the names of these threads begin."""


class Worker:
    """Runs jobs one after another; of those of one name that wait, the newest alone.

    Args:
        failed: called in this thread with the name of a job and its exception.
    """

    def __init__(self, failed: Callable[[str, Exception], None]) -> None:
        self._failed = failed
        self._jobs: dict[str, Job] = {}
        self._thread = ThreadPoolExecutor(1, thread_name_prefix=THREADS)

    def put(self, name: str, job: Job) -> None:
        """Let a job be done soon."""
        self._jobs[name] = job
        self._thread.submit(self._run, name)

    def close(self) -> None:
        """Finish the present job, and no other."""
        self._jobs.clear()
        self._thread.shutdown(cancel_futures=True)

    def _run(self, name: str) -> None:
        job = self._jobs.pop(name, None)
        try:
            if job is not None:
                job()
        except Exception as error:  # of any kind: a future would hide it
            self._failed(name, error)
