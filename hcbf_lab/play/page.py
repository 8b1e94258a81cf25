"""The page of a session: a web server that shows it in browsers and takes their commands."""

import contextlib
import io
import socket
import threading
import time

import numpy as np
import viser

from hcbf_gym.arrays import Array
from hcbf_gym.errors import HcbfError, InvalidInputError
from hcbf_gym.scenarios import Scenario
from hcbf_lab.play import readings
from hcbf_lab.play.controls import Controls
from hcbf_lab.play.drawing import Stage
from hcbf_lab.play.plots import Plots
from hcbf_lab.play.session import Session
from hcbf_lab.play.steering import Steering
from hcbf_lab.play.thread_safe_event import use_thread_safe_events

HERE = "127.0.0.1"
FIRST_PORT = 8080
RATE = 40.0  # updates of the poses [1/s]
POSES_PER_TEXT = 5  # updates of the poses from one update of texts and plots to the next
NEAR_PLANE = 0.1
"""The distance from the camera at which drawing begins [m]. It is ten times viser's own, so that
the depth buffer distinguishes regions that are a millimetre above each other."""
MAX_SHIFT = 1.0  # of the robot in the view, beyond which the camera follows [m]
PANEL_WIDTH = 400  # at the right of a window [pixels]
NARROW_WIDTH = 576  # of a window, up to which viser puts the panel below the scene [pixels]


class Page:
    """A web server on this machine that shows a session and takes its commands.

    Of every value that a browser has not fetched yet, viser retains only the newest, so that a slow
    browser delays nothing. Without a browser, time stops.

    Args:
        session: to show.
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
        self._panel_shifts: dict[int, Array] = {}  # of the cameras, by browser
        self._server.on_client_connect(self._on_connect)
        self._server.on_client_disconnect(self._on_disconnect)
        self._plots = Plots(self._server, self.controls.plots)
        self._stage = Stage(self._server)
        x, y = session.latest.position.tolist()
        self._server.initial_camera.position = (x - 3.0, y - 3.0, 3.5)
        self._server.initial_camera.look_at = (x, y, 0.0)
        self._server.initial_camera.near = NEAR_PLANE
        self._watched: bool | None = None
        # of the snapshot that was shown last
        self._revision, self._time, self._body = -1, -1.0, object()
        self._updates = 0

    def run(self, stop: threading.Event, simulation: threading.Thread) -> None:
        """Show the session until `stop` is set, or until the thread that runs it has ended."""
        due = time.perf_counter()
        while simulation.is_alive() and not stop.is_set():
            self.show()
            due = max(due + 1.0 / RATE, time.perf_counter())
            time.sleep(max(0.0, due - time.perf_counter()))

    def close(self) -> None:
        """Stop serving."""
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    def show(self) -> None:
        """Send the changes since the last call to the browsers."""
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
            if self._updates % POSES_PER_TEXT == 0:
                self._words.content = readings.html(snapshot, self._steering_in_words())
                self._stage.show_path()
                self._plots.show(snapshot)
        self._updates += 1

    def _on_connect(self, client: viser.ClientHandle) -> None:
        """Centre the robot beside the panel in a browser whose view is still the initial one."""
        camera, initial = client.camera, self._server.initial_camera
        view = np.array([camera.position, camera.look_at])
        if np.allclose(view, [initial.position, initial.look_at], atol=1e-3):
            shift = panel_shift(camera)
            self._panel_shifts[client.client_id] = shift
            camera.position = camera.position + shift

    def _on_disconnect(self, client: viser.ClientHandle) -> None:
        """Forget a browser, and free the controls if it steered."""
        self._panel_shifts.pop(client.client_id, None)
        self.controls.release(client.client_id)

    def _follow(self, position: Array) -> None:
        """Move the cameras from whose view the robot at a position (2,) [m] has moved away."""
        for client in self._server.get_clients().values():
            camera = client.camera
            shift = np.array([*(position - camera.look_at[:2]), 0.0])
            shift += self._panel_shifts.get(client.client_id, 0.0)
            if np.linalg.norm(shift) > MAX_SHIFT:
                camera.position = camera.position + shift  # viser moves `look_at` with it

    def _show_field(self, scenario: Scenario | None) -> None:
        """Draw the guidance field, or notify all browsers that there is none."""
        try:
            self._stage.show_field(scenario)
        except HcbfError as error:
            for client in self._server.get_clients().values():
                client.add_notification("no guidance field", str(error), auto_close_seconds=6.0)

    def _steering_in_words(self) -> str:
        """Return which browser steers, and the number of browsers."""
        holder = self.steering.holder
        steers = "no one steers yet" if holder is None else f"browser {holder} steers"
        return f"{steers}, {len(self._server.get_clients())} connected"


def panel_shift(camera: viser.CameraHandle) -> Array:
    """Return the shift (3,) of a camera that centres its target beside the panel [m].

    In a narrow window the panel is below the scene, and the shift is zero.
    """
    if camera.image_width <= NARROW_WIDTH:
        return np.zeros(3)
    ahead = camera.look_at - camera.position
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    view_height = 2.0 * np.linalg.norm(ahead) * np.tan(0.5 * camera.fov)  # at the target [m]
    metres_per_pixel = view_height / camera.image_height
    return 0.5 * PANEL_WIDTH * metres_per_pixel * right / np.linalg.norm(right)


def check_port(port: int | None) -> None:
    """Refuse a port at which nothing can listen, because viser would try a thousand others.

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
