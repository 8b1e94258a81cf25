"""Who steers: of several browsers that watch, one."""

import threading


class Steering:
    """Who has the controls: the first browser that touches them, until it leaves."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._holder: int | None = None

    @property
    def holder(self) -> int | None:
        """The browser that steers; None while there is none."""
        return self._holder

    def may(self, client: int) -> bool:
        """Return whether a browser steers; the first to ask does from now on."""
        with self._lock:
            if self._holder is None:
                self._holder = client
            return self._holder == client

    def take(self, client: int) -> None:
        """Give the controls to a browser."""
        with self._lock:
            self._holder = client

    def leave(self, client: int) -> bool:
        """Free the controls if this browser had them, and return whether it had."""
        with self._lock:
            had = self._holder == client
            if had:
                self._holder = None
            return had
