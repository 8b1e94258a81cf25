"""The playground beside the clock: the A1's pace, the page's updates, and whether it grows."""

import contextlib
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import viser
from websockets.sync.client import connect

from hcbf_gym.evaluation.tables import Table
from hcbf_lab.play.page import Page
from hcbf_lab.play.session import Session
from hcbf_lab.play.settings import Settings

SETTINGS = Settings(policy="human", program="lex-cbf-qp", guidance=True)
CHANGE_EVERY = 5.0
"""Time between two things that the person does [s]."""
REACH = 1.5
"""How far from the robot the stick is dragged [m]."""
PUSH = 60.0
"""[N]."""
AS_FAST_AS_IT_CAN = 1e6
FREE_RUN = 10.0
"""How long the simulation runs as fast as it can [s of the clock]."""
NAP = 15.0
"""How long a browser that reads nothing stays [s]; the page itself drops it after 40 s."""
_MEGABYTE = 1e6 if sys.platform == "darwin" else 1e3  # of what getrusage counts in


class Reader(threading.Thread):
    """A browser without a picture: it counts what it is sent.

    Attributes:
        count: of the messages so far, each an update of all that has changed.
    """

    def __init__(self, port: int):
        super().__init__(daemon=True)
        self.count, self._connection = 0, _connection(port)

    def run(self) -> None:
        """Read until the page is closed."""
        for _ in self._connection:
            self.count += 1


def doze(port: int, stop: threading.Event) -> None:
    """Connect, read nothing for a while, leave, and connect again, until told to stop.

    Args:
        port: of the page.
        stop: set when it is over.
    """
    while not stop.is_set():
        with _connection(port):
            stop.wait(NAP)


def run(quick: bool) -> dict[str, Any]:
    """Play with the page open in three places; return pace, updates and memory.

    A browser draws in software (if Chromium is installed), a reader counts what is sent, and a
    third connects again and again and never reads.

    Args:
        quick: a fifth of a minute instead of ten.
    """
    periods, period = (2, 6.0) if quick else (10, 60.0)
    session = Session(SETTINGS, "random")
    session.tick()
    page = Page(session, 0)
    stop = threading.Event()
    simulation = threading.Thread(target=session.run, args=(stop,), daemon=True)
    shown = threading.Thread(target=page.run, args=(stop, simulation), daemon=True)
    sleeper = threading.Thread(target=doze, args=(page.port, stop), daemon=True)
    with contextlib.closing(page), _browser(page.port) as browser:
        reader = Reader(page.port)
        for thread in (simulation, shown, reader, sleeper):
            thread.start()
        try:
            rows = [_play(session, period, reader, k) for k in range(periods)]
            session.post(session.set_pace, AS_FAST_AS_IT_CAN)
            free = _play(session, FREE_RUN, reader, periods)
        finally:
            stop.set()
            for thread in (simulation, shown, sleeper):
                thread.join()
    return {"browser": browser, "rows": rows, "free": free}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the table of pace, updates and memory."""
    rows = [
        (name, f"{row['pace']:.2f} x", f"{row['updates']:.0f} /s", f"{row['memory']:.0f} MB")
        for name, row in [
            *((f"period {k + 1}", row) for k, row in enumerate(figures["rows"])),
            ("as fast as it can", figures["free"]),
        ]
    ]
    header = ("on the clock", "simulated time", "updates sent", "most memory so far")
    return {"all": Table(f"the playground, drawn by {figures['browser']}", header, rows)}


def _play(session: Session, duration: float, reader: Reader, seed: int) -> dict[str, float]:
    """Steer, push and drag for some time [s of the clock]; return what was kept up."""
    rng = np.random.default_rng(seed)
    began, first, count = time.perf_counter(), session.latest.time, reader.count
    while (left := began + duration - time.perf_counter()) > 0.0:
        away = rng.uniform(-REACH, REACH, (3, 2))
        session.post(session.lead_to, session.latest.position + away[0])
        session.post(session.push, PUSH * away[1] / np.linalg.norm(away[1]))
        soft = session.scenario.barriers[-1].name
        session.post(session.move, soft, session.latest.position + away[2])
        time.sleep(min(CHANGE_EVERY, left))
    clock = time.perf_counter() - began
    return {
        "pace": (session.latest.time - first) / clock,
        "updates": (reader.count - count) / clock,
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _MEGABYTE,
    }


def _connection(port: int) -> Any:
    """Connect as a browser does; what is not read waits with the sender."""
    protocol: Any = f"viser-v{viser.__version__}"
    return connect(
        f"ws://127.0.0.1:{port}",
        subprotocols=[protocol],
        max_queue=1,
        max_size=None,
        ping_interval=None,
    )


@contextlib.contextmanager
def _browser(port: int) -> Iterator[str]:
    """Open the page in Chromium, drawn in software; yield its name, or that there is none."""
    chromium = shutil.which("chromium")
    if chromium is None:
        yield "no browser"
        return
    flags = ("--headless", "--no-sandbox", "--no-first-run", "--enable-unsafe-swiftshader")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        opened = subprocess.Popen(
            [chromium, *flags, f"--user-data-dir={profile}", "--remote-debugging-port=0",
             f"http://127.0.0.1:{port}/"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            yield "headless Chromium"
        finally:
            opened.terminate()
            opened.wait(timeout=20.0)
