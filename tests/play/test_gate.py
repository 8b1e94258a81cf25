"""Who may see a page that other machines can reach."""

import contextlib
import http.client
import socket

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from hcbf_gym.errors import InvalidInputError
from hcbf_gym.play.gate import LONGEST_HEAD, Gate, is_local
from hcbf_gym.play.page import Page
from hcbf_gym.play.session import Session
from hcbf_gym.play.settings import Settings


@pytest.fixture(scope="module")
def page():
    session = Session(Settings(model="reduced"), "paper-simulation")
    with contextlib.closing(Page(session, "0.0.0.0", 0)) as page:
        yield page


def get(page, path="/", **headers):
    """Return the status, the headers and the body that a request gets."""
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", page.port, 30.0)) as client:
        client.request("GET", path, headers=headers)
        answer = client.getresponse()
        return answer.status, answer.headers, answer.read()


def path_with_token(page):
    return page.address[page.address.index("/?") :]


def cookie(page):
    _, headers, _ = get(page, path_with_token(page))
    return headers["Set-Cookie"].partition(";")[0]


@pytest.mark.parametrize("path", ["/", "/?token=", "/?token=guessed", "/index.html"])
def test_without_the_token_there_is_no_page(page, path):
    status, _, body = get(page, path)
    assert status == 403
    assert len(body) < 100


@pytest.mark.parametrize("key", ["", "hcbf-play=guessed", "hcbf-play-{port}=guessed", "a=b; \x80"])
def test_without_the_token_there_is_no_websocket(page, key):
    headers = {"Cookie": key.format(port=page.port)}
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://127.0.0.1:{page.port}/", additional_headers=headers)
    assert refused.value.response.status_code in (400, 403)


def test_the_token_opens_page_and_websocket_and_leaves_the_address(page):
    status, headers, _ = get(page, path_with_token(page) + "&initialCameraFov=60")
    assert status == 303
    assert headers["Location"] == "/?initialCameraFov=60"
    assert "HttpOnly" in headers["Set-Cookie"]
    assert "SameSite=Lax" in headers["Set-Cookie"]
    status, _, body = get(page, headers["Location"], Cookie=cookie(page))
    assert status == 200
    assert len(body) > 100_000
    with connect(f"ws://127.0.0.1:{page.port}/", additional_headers={"Cookie": cookie(page)}):
        pass


@pytest.mark.parametrize(
    "said", [b"\r\n\r\n", b"\x00\xff\xfe\r\n\r\n", b"GET\r\n\r\n", b"x" * (2 * LONGEST_HEAD)]
)
def test_what_is_no_request_is_refused_and_others_are_served(page, said):
    with (
        contextlib.suppress(ConnectionError),
        socket.create_connection(("127.0.0.1", page.port), 30.0) as client,
    ):
        client.sendall(said)
        assert b" 200 " not in client.recv(1000)
    assert get(page, Cookie=cookie(page))[0] == 200


def test_the_page_behind_the_gate_listens_to_this_machine_alone(page):
    behind = page._server
    assert behind.get_host() == "127.0.0.1"
    assert behind.get_port() != page.port


def test_a_page_for_this_machine_needs_no_token():
    session = Session(Settings(model="reduced"), "paper-simulation")
    with contextlib.closing(Page(session, "127.0.0.1", 0)) as page:
        assert "token" not in page.address
        assert get(page)[0] == 200


def test_a_gate_needs_a_free_port():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InvalidInputError, match="expected one that is free"):
            Gate("127.0.0.1", [port], 1)


@pytest.mark.parametrize(
    ("host", "local"),
    [("127.0.0.1", True), ("localhost", True), ("0.0.0.0", False), ("", False), ("::", False)],
)
def test_only_a_loopback_address_counts_as_this_machine(host, local):
    assert is_local(host) == local
