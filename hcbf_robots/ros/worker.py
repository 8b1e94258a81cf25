"""A thread beside the commands' path, which prepares the newest of each source."""

import threading
from collections.abc import Callable

Job = Callable[[], None]


class Worker:
    """Runs jobs one after another; a job that waits gives way to a newer one of its name.

    Args:
        failed: called in this thread with the name of a job and what it raised.
    """

    def __init__(self, failed: Callable[[str, Exception], None]) -> None:
        self._failed = failed
        self._jobs: dict[str, Job] = {}
        self._news = threading.Condition()
        self._ends = False
        self._thread = threading.Thread(target=self._run, name="prepares", daemon=True)
        self._thread.start()

    def put(self, name: str, job: Job) -> None:
        """Let a job be done soon."""
        with self._news:
            self._jobs[name] = job
            self._news.notify()

    def close(self) -> None:
        """Finish the job at hand, and no other."""
        with self._news:
            self._ends = True
            self._news.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._jobs or self._ends)
                if self._ends:
                    return
                name = next(iter(self._jobs))
                job = self._jobs.pop(name)
            try:
                job()
            except Exception as error:  # whatever it is: a thread that ends would say nothing
                self._failed(name, error)
