"""The door of a page that other machines can reach: who comes in shows a token.

It stands between them and the page, which listens at this machine alone: what shows no token is
answered here, and nothing of it gets to the page.
"""

import asyncio
import contextlib
import hmac
import ipaddress
import secrets
import socket
import threading
from collections.abc import Iterable
from http.client import HTTPException, parse_headers
from http.cookies import CookieError, SimpleCookie
from io import BytesIO
from urllib.parse import parse_qsl, urlencode, urlsplit

from hcbf_gym.errors import InvalidInputError

TOKEN = "token"
"""The name of the token in the address that the command prints."""
LONGEST_HEAD = 16 * 1024
"""Of a request that is read before it is refused [bytes]."""
PATIENCE = 10.0
"""How long a request may take to say what it wants [s]."""
_HERE = "127.0.0.1"
_REFUSED = b"hcbf play: open the address with the token that the command printed.\n"


class Gate:
    """Lets those in who know the token: in the address at first, then in a cookie.

    Args:
        host: the address to listen at.
        ports: those to try, one after the other.
        page: the port of this machine at which the page listens.

    Attributes:
        port: the port that it is.
        token: what opens it, another one for each gate.

    Raises:
        InvalidInputError: if none of the ports is free.
    """

    def __init__(self, host: str, ports: Iterable[int], page: int):
        self.token = secrets.token_urlsafe(16)
        self._page = page
        self._loop = asyncio.new_event_loop()
        try:
            self._server = self._loop.run_until_complete(self._listen(host, ports))
        except BaseException:
            self._loop.close()
            raise
        self.port: int = self._server.sockets[0].getsockname()[1]
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    @property
    def cookie(self) -> str:
        """The cookie's name; browsers share cookies between the ports of a machine."""
        return f"hcbf-play-{self.port}"

    def close(self) -> None:
        """Let nobody in any more."""
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result(PATIENCE)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(PATIENCE)
        self._loop.close()

    async def _listen(self, host: str, ports: Iterable[int]) -> asyncio.Server:
        for port in ports:
            with contextlib.suppress(OSError):
                return await asyncio.start_server(self._meet, host, port, limit=LONGEST_HEAD)
        raise InvalidInputError(f"port: got {ports}, expected one that is free")

    async def _end(self) -> None:
        self._server.close()
        guests = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in guests:
            task.cancel()
        await asyncio.gather(*guests, return_exceptions=True)

    async def _meet(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer who shows no token; pass everything on for who does, both ways."""
        try:
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), PATIENCE)
            answer = self.answer(head)
            if answer is None:
                inside, outside = await asyncio.open_connection(_HERE, self._page)
                outside.write(head)
                await asyncio.gather(_pour(reader, outside), _pour(inside, writer))
            else:
                writer.write(answer)
                await writer.drain()
        except (OSError, EOFError, asyncio.LimitOverrunError):
            pass  # a guest that says nothing, too much or goes away is none
        finally:
            writer.close()

    def answer(self, head: bytes) -> bytes | None:
        """Return what a request gets instead of the page; None lets it in.

        Args:
            head: its line and headers, up to the empty line.
        """
        try:
            line, _, rest = head.partition(b"\r\n")
            target = urlsplit(line.decode("ascii").split(" ")[1])
            asked = parse_qsl(target.query)
            cookies = SimpleCookie(parse_headers(BytesIO(rest)).get("Cookie", ""))
        except (ValueError, IndexError, HTTPException, CookieError):
            return _response("400 Bad Request", "", b"hcbf play: this is no request.\n")
        if self._is_right(dict(asked).get(TOKEN, "")):
            kept = urlencode([pair for pair in asked if pair[0] != TOKEN])
            cookie = f"{self.cookie}={self.token}; Path=/; HttpOnly; SameSite=Lax"
            return _response("303 See Other", f"Location: /?{kept}\r\nSet-Cookie: {cookie}\r\n")
        shown = cookies.get(self.cookie)
        if shown is not None and self._is_right(shown.value):
            return None
        return _response("403 Forbidden", "", _REFUSED)

    def _is_right(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self.token.encode())


def is_local(host: str) -> bool:
    """Return whether only this machine can reach what listens at an address."""
    try:
        found = socket.getaddrinfo(host, None)
    except OSError:
        return False
    return all(ipaddress.ip_address(address[4][0]).is_loopback for address in found)


def _response(status: str, headers: str, body: bytes = b"") -> bytes:
    head = (
        f"HTTP/1.1 {status}\r\n{headers}Content-Type: text/plain; charset=utf-8\r\n"
        f"Content-Length: {len(body)}\r\nCache-Control: no-store\r\nConnection: close\r\n\r\n"
    )
    return head.encode() + body


async def _pour(source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
    """Hand on what comes, as fast as it is taken, until there is no more."""
    try:
        while data := await source.read(1 << 16):
            sink.write(data)
            await sink.drain()
    finally:
        sink.close()
