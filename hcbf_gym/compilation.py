"""Says so when compiled kernels are made, which takes a while the first time."""

import functools
import logging

from numba.core import event

_LOGGER = logging.getLogger("hcbf_gym")


class _Announcer(event.Listener):
    def __init__(self) -> None:
        self._announced = False

    def on_start(self, event: event.Event) -> None:
        assert event.data is not None
        module = event.data["dispatcher"].py_func.__module__
        if not self._announced and module.startswith("hcbf_gym"):
            self._announced = True
            _LOGGER.warning(
                "compiling kernels, once, for about half a minute; later starts read the cache"
            )

    def on_end(self, event: event.Event) -> None:
        pass


@functools.cache
def announce_compilation() -> None:
    """Log one line when a kernel is compiled instead of read from the cache."""
    event.register("numba:compile", _Announcer())
