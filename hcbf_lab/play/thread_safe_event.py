"""An event that wakes viser's senders from any thread.

Viser sets an `asyncio.Event` from the threads that have messages, which asyncio does not allow: set
between a sender's check of it and its wait, the event wakes no one, ever again, and the page
freezes.
"""

import asyncio
import contextlib
from typing import Any

import viser


class ThreadSafeEvent(asyncio.Event):
    """An event that every thread may set.

    Args:
        loop: of the tasks that wait.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop):
        super().__init__()
        self._home = loop

    def set(self) -> None:
        """Wake what waits, as soon as the loop comes to it; nothing once the loop has ended."""
        with contextlib.suppress(RuntimeError):
            self._home.call_soon_threadsafe(super().set)


def use_thread_safe_events(server: viser.ViserServer) -> None:
    """Give such an event to all browsers' sender, and to each browser that connects from now on."""
    loop = server.get_event_loop()
    sender = server._websock_server  # pyright: ignore[reportPrivateUsage] - no public way to it

    def replace(connection: Any) -> None:
        buffer = connection.get_message_buffer()
        before, buffer.message_event = buffer.message_event, ThreadSafeEvent(loop)
        loop.call_soon_threadsafe(before.set)  # who waits for it already

    replace(sender)
    sender.on_client_connect(replace)
