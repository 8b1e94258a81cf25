"""What wakes viser's senders.

Viser sets an `asyncio.Event` from the threads that have messages, which asyncio does not allow: set
between a sender's look at it and its wait, the event is set and wakes nobody, ever again. The page
stands still while the robot walks on. That takes a moment without messages, so it happens to
machines that are busy.
"""

import asyncio
import contextlib
from typing import Any

import viser


class Bell(asyncio.Event):
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


def hang_bells(server: viser.ViserServer) -> None:
    """Give a bell to what sends to all browsers, and to each one that connects from now on."""
    loop = server.get_event_loop()
    sender = server._websock_server  # pyright: ignore[reportPrivateUsage] - no public way to it

    def hang(connection: Any) -> None:
        buffer = connection.get_message_buffer()
        before, buffer.message_event = buffer.message_event, Bell(loop)
        loop.call_soon_threadsafe(before.set)  # who waits for it already

    hang(sender)
    sender.on_client_connect(hang)
