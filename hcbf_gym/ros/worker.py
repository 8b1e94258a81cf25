"""One thread beside the commands' path, which prepares the newest of each source."""

import threading
from collections.abc import Callable


class Worker:
    """Runs jobs one after another; a job that waits gives way to a newer one of its name."""

    def __init__(self) -> None:
        self._jobs: dict[str, Callable[[], None]] = {}
        self._news = threading.Condition()
        self._ends = False
        self._thread = threading.Thread(target=self._run, name="prepares", daemon=True)
        self._thread.start()

    def put(self, name: str, job: Callable[[], None]) -> None:
        """Let a job be done soon; it handles its own errors."""
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
                job = self._jobs.pop(next(iter(self._jobs)))
            job()
