"""The page of a session: what browsers see of it, sent as often as they can take it."""

import contextlib
import io
import socket
import threading
import time

import numpy as np
import viser

from hcbf_gym.arrays import Array
from hcbf_gym.errors import HcbfError, InvalidInputError
from hcbf_lab.play import readings
from hcbf_lab.play.controls import Controls
from hcbf_lab.play.drawing import Stage
from hcbf_lab.play.plots import Plots
from hcbf_lab.play.session import Session
from hcbf_lab.play.steering import Steering
from hcbf_lab.play.thread_safe_event import use_thread_safe_events

HERE = "127.0.0.1"
FIRST_PORT = 8080
RATE = 40.0  # how often poses are sent [1/s]; words and curves come `SLOWER` times less often
SLOWER = 5
NEAREST = 0.1
"""What is nearer to the camera is not drawn [m]; ten times viser's own, so that a depth buffer can
distinguish regions that are a millimetre above each other."""
OFF_CENTRE = 1.0  # how far the robot gets from its place in the view before the camera follows [m]
PANEL = 400  # what the panel hides at the right of a window [pixels]
NARROW = 576  # up to this width viser puts the panel below the scene [pixels]


class Page:
    """A web server that shows a session and takes its commands.

    Viser retains only the newest of every value that a browser has not fetched yet, so a slow one
    delays nothing. Without a browser, time stops. It listens at this machine alone.

    Args:
        session: what is shown.
        port: the port; None takes the first free one from 8080 on, 0 any free one.

    Raises:
        InvalidInputError: if the port is taken.
    """

    def __init__(self, session: Session, port: int | None):
        check_port(port)
        with contextlib.redirect_stdout(io.StringIO()):  # viser's own banner
            self._server = viser.ViserServer(
                host=HERE,
                port=FIRST_PORT if port is None else port,
                label="hcbf play",
                verbose=False,
            )
        use_thread_safe_events(self._server)
        self.port = self._server.get_port()
        self.address = f"http://{HERE}:{self.port}/"
        self._session = session
        self.steering = Steering()
        self._server.gui.configure_theme(
            show_logo=False, show_share_button=False, control_width="large"
        )
        self._server.gui.add_html(readings.STYLE)
        self._words = self._server.gui.add_html("")
        self.controls = Controls(self._server, session, self.steering)
        self._aside: dict[int, Array] = {}
        self._server.on_client_connect(self._greet)
        self._server.on_client_disconnect(self._part)
        self._plots = Plots(self._server, self.controls.plots)
        self._stage = Stage(self._server)
        x, y = session.latest.position.tolist()
        self._server.initial_camera.position = (x - 3.0, y - 3.0, 3.5)
        self._server.initial_camera.look_at = (x, y, 0.0)
        self._server.initial_camera.near = NEAREST
        self._watched: bool | None = None
        self._revision, self._time, self._body, self._count = -1, -1.0, object(), 0

    def run(self, stop: threading.Event, alive: threading.Thread) -> None:
        """Show the session until `stop` is set, or until its thread has ended."""
        due = time.perf_counter()
        while alive.is_alive() and not stop.is_set():
            self.show()
            due = max(due + 1.0 / RATE, time.perf_counter())
            time.sleep(max(0.0, due - time.perf_counter()))

    def close(self) -> None:
        """Stop serving."""
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    def show(self) -> None:
        """Send what has changed since the last time."""
        snapshot = self._session.latest
        watched = bool(self._server.get_clients())
        if watched != self._watched:
            self._session.post(self._session.attend, watched)
            self._watched = watched
        with self._server.atomic():
            if snapshot.body is not self._body:
                self._stage.show_robot(snapshot.body)
                self._body = snapshot.body
            if snapshot.time < self._time:
                self._stage.restart()
                self._plots.restart()
            if snapshot.revision != self._revision or self.controls.pop_stale():
                self._stage.show_scene(snapshot.scenario, snapshot.time)
                self.controls.show(snapshot)
                self._show_field(snapshot.scenario if self.controls.show_field else None)
            self._revision, self._time = snapshot.revision, snapshot.time
            self._stage.move(snapshot.position, snapshot.poses, snapshot.reference, snapshot.time)
            self.controls.move_stick(snapshot)
            if self.controls.follows:
                self._follow(snapshot.position)
            if self._count % SLOWER == 0:
                self._words.content = readings.html(snapshot, self._who_steers())
                self._stage.show_path()
                self._plots.show(snapshot)
        self._count += 1

    def _greet(self, client: viser.ClientHandle) -> None:
        """Show a new browser the robot in the middle of what the panel leaves free."""
        camera, first = client.camera, self._server.initial_camera
        views = (camera.position, first.position), (camera.look_at, first.look_at)
        if not all(np.allclose(*pair, atol=1e-3) for pair in views):
            return  # a view that the browser brought stays
        aside = beside_the_panel(camera)
        self._aside[client.client_id] = aside
        camera.position = camera.position + aside

    def _part(self, client: viser.ClientHandle) -> None:
        self._aside.pop(client.client_id, None)
        self.controls.release(client.client_id)

    def _follow(self, position: Array) -> None:
        """Bring the robot back to its place in every browser's view where it has left it."""
        for client in self._server.get_clients().values():
            camera = client.camera
            shift = np.array([*(position - camera.look_at[:2]), 0.0])
            shift += self._aside.get(client.client_id, 0.0)
            if np.linalg.norm(shift) > OFF_CENTRE:
                camera.position = camera.position + shift  # what is looked at comes along

    def _show_field(self, scenario: object) -> None:
        try:
            self._stage.show_field(scenario)  # type: ignore[arg-type]
        except HcbfError as error:
            for client in self._server.get_clients().values():
                client.add_notification("no guidance field", str(error), auto_close_seconds=6.0)

    def _who_steers(self) -> str:
        watching = len(self._server.get_clients())
        holder = self.steering.holder
        who = "no one steers yet" if holder is None else f"browser {holder} steers"
        return f"{who}, {watching} connected"


def beside_the_panel(camera: viser.CameraHandle) -> Array:
    """Return how far a camera moves so that what it looks at is in the middle of the free part [m].

    Args:
        camera: of a browser; on a narrow screen the panel lies below, and nothing moves.
    """
    width, height = camera.image_width, camera.image_height
    if width <= NARROW:
        return np.zeros(3)
    ahead = camera.look_at - camera.position
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    metres = 2.0 * np.linalg.norm(ahead) * np.tan(0.5 * camera.fov) / height  # of a pixel
    return 0.5 * PANEL * metres * right / np.linalg.norm(right)


def check_port(port: int | None) -> None:
    """Refuse a port at which nothing can listen; viser would try a thousand others.

    Raises:
        InvalidInputError: if there is no such port, or it is taken.
    """
    if port is not None and not 0 <= port <= 65535:
        raise InvalidInputError(f"port: got {port}, expected 0 to 65535")
    try:
        with socket.create_server((HERE, port or 0)):
            pass
    except OSError as error:
        raise InvalidInputError(
            f"port: got {port} ({error}), expected one that is free; without --port it is chosen"
        ) from error
