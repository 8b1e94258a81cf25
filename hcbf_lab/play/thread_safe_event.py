"""An event that wakes viser's senders from any thread.

Viser's threads set an `asyncio.Event` when they have messages, which asyncio does not allow. If one
sets it between a sender's check and its wait, the sender waits for ever, and the page freezes.
"""

import asyncio
import contextlib
from typing import Any

import viser


class ThreadSafeEvent(asyncio.Event):
    """An event for which tasks of one loop wait, and which every thread may set."""

    def __init__(self, loop: asyncio.AbstractEventLoop):
        super().__init__()
        self._loop_of_waiters = loop

    def set(self) -> None:
        """Let the loop wake the tasks that wait."""
        with contextlib.suppress(RuntimeError):  # the loop has ended, and no task waits
            self._loop_of_waiters.call_soon_threadsafe(super().set)


def use_thread_safe_events(server: viser.ViserServer) -> None:
    """Replace the event of the common sender, and that of each browser when it connects."""
    loop = server.get_event_loop()
    sender = server._websock_server  # pyright: ignore[reportPrivateUsage] - viser has no public one

    def replace_event(connection: Any) -> None:
        buffer = connection.get_message_buffer()
        replaced, buffer.message_event = buffer.message_event, ThreadSafeEvent(loop)
        loop.call_soon_threadsafe(replaced.set)  # wakes a task that waits for it already

    replace_event(sender)
    sender.on_client_connect(replace_event)
