"""Ports, files, who steers and what wakes senders: what needs a page, but no browser."""

import asyncio
import contextlib
import socket
import threading

import pytest
import viser
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from hcbf_gym.errors import InvalidInputError
from hcbf_lab.play import command
from hcbf_lab.play.page import FIRST_PORT, Page
from hcbf_lab.play.session import Session
from hcbf_lab.play.settings import Settings
from hcbf_lab.play.steering import Steering
from hcbf_lab.play.thread_safe_event import ThreadSafeEvent


@pytest.fixture(scope="module")
def session():
    return Session(Settings(model="reduced"), "paper-simulation")


@pytest.fixture
def taken():
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield listening.getsockname()[1]


def test_two_pages_find_a_port_each(session):
    with (
        contextlib.closing(Page(session, None)) as one,
        contextlib.closing(Page(session, None)) as other,
    ):
        assert FIRST_PORT <= one.port < other.port
        for page in (one, other):
            socket.create_connection(("127.0.0.1", page.port), timeout=10.0).close()


def test_a_sender_wakes_though_its_event_is_set_while_it_goes_to_sleep(monkeypatch):
    async def wait():
        loop = asyncio.get_running_loop()
        event = ThreadSafeEvent(loop)

        def ring():  # asyncio calls it between its look at the event and its wait
            other = threading.Thread(target=event.set)
            other.start()
            other.join()
            return loop

        monkeypatch.setattr(event, "_get_loop", ring)
        await asyncio.wait_for(event.wait(), timeout=10.0)

    asyncio.run(wait())


def test_all_senders_of_a_page_have_thread_safe_events(session):
    with contextlib.closing(Page(session, 0)) as page:
        senders = [page._server._websock_server.get_message_buffer()]
        page._server._websock_server.on_client_connect(
            lambda connection: senders.append(connection.get_message_buffer())
        )
        gone = threading.Event()
        page._server._websock_server.on_client_disconnect(lambda connection: gone.set())
        version = [Subprotocol(f"viser-v{viser.__version__}")]
        with connect(f"ws://127.0.0.1:{page.port}", max_size=None, subprotocols=version) as browser:
            browser.recv(timeout=10.0)
        assert gone.wait(10.0)  # or its transport would be closed with the page alone
        assert len(senders) == 2
        assert all(isinstance(sender.message_event, ThreadSafeEvent) for sender in senders)


def test_a_port_that_is_taken_is_refused_when_requested(session, taken):
    with pytest.raises(InvalidInputError, match=f"port: got {taken} .*free"):
        Page(session, taken)


def test_the_command_prints_where_the_page_is_when_its_usual_port_is_taken(
    session, monkeypatch, capsys, taken
):
    monkeypatch.setattr(command, "FIRST_PORT", taken)
    monkeypatch.setattr("hcbf_lab.play.page.FIRST_PORT", taken)
    monkeypatch.setattr(Page, "run", lambda *_: None)
    command.main(command.Args(settings=Settings(model="reduced"), scenario="paper-simulation"))
    printed = capsys.readouterr().out
    assert f"Port {taken} is taken." in printed
    assert f"http://127.0.0.1:{taken}/" not in printed


def test_the_first_who_touches_steers_until_it_leaves_or_another_takes_over():
    steering = Steering()
    assert steering.may(1)
    assert not steering.may(2)
    assert not steering.leave(2)
    steering.take(2)
    assert not steering.may(1)
    assert steering.leave(2)
    assert steering.holder is None
    assert steering.may(1)


def test_the_stick_goes_back_when_the_browser_that_steers_leaves(session):
    with contextlib.closing(Page(session, None)) as page:
        session.post(session.change, policy="human")
        session.post(session.steer, (1.0, 0.0))
        session.post(session.lead_to, (3.0, 3.0))
        for _ in range(5):
            session.tick()
        page.steering.take(7)
        page.controls.release(8)  # one that only watched
        session.tick()
        moving = session.latest.velocity.copy()
        page.controls.release(7)
        for _ in range(200):
            session.tick()
        assert (abs(moving) > 0.0).any()
        assert session.latest.velocity == pytest.approx([0.0, 0.0], abs=0.02)
