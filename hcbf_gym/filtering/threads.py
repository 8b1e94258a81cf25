"""Parts of a batch on several cores at once: compiled calls that let go of the interpreter."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any


class Threads:
    """Runs a compiled function on several parts at once; a copy has threads of its own.

    Args:
        count: of threads, this one included.
    """

    def __init__(self, count: int):
        self.count = count
        self._others: ThreadPoolExecutor | None = None

    def run(self, call: Callable[[Any], int], parts: Sequence[Any]) -> list[int]:
        """Return what the function says of each part; the first one runs here."""
        if self._others is None:
            self._others = ThreadPoolExecutor(self.count - 1, thread_name_prefix="hcbf-filter")
        others = [self._others.submit(call, part) for part in parts[1:]]
        return [call(parts[0]), *(other.result() for other in others)]

    def __getstate__(self) -> dict[str, object]:
        return {"count": self.count, "_others": None}
