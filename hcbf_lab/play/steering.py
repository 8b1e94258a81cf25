"""The control of a session by one of the browsers that show it."""

import threading


class Steering:
    """The number of the browser that steers, which every thread may read and change."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._holder: int | None = None

    @property
    def holder(self) -> int | None:
        """The browser that steers; None for no browser."""
        return self._holder

    def may(self, client: int) -> bool:
        """Return whether a browser steers; if no one does, it steers from now on."""
        with self._lock:
            if self._holder is None:
                self._holder = client
            return self._holder == client

    def take(self, client: int) -> None:
        """Let a browser steer instead of any other."""
        with self._lock:
            self._holder = client

    def leave(self, client: int) -> bool:
        """Return whether a browser that leaves steered; then no one steers."""
        with self._lock:
            steered = self._holder == client
            if steered:
                self._holder = None
            return steered
