"""The controls of the page, which post commands to the session."""

import time
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import viser

from hcbf_gym import scenarios
from hcbf_gym.errors import HcbfError
from hcbf_gym.scenarios import Scenario
from hcbf_lab.play import editing
from hcbf_lab.play.report import Snapshot
from hcbf_lab.play.session import Session
from hcbf_lab.play.settings import BODIES, HUMAN, model_names, policy_names, program_names
from hcbf_lab.play.steering import Steering


class Event(Protocol):
    """An event of one of viser's handles."""

    @property
    def client(self) -> viser.ClientHandle | None:
        """The browser that it came from; None if the program changed the handle."""


E = TypeVar("E", bound=Event)
Handle = TypeVar("Handle", bound=viser.GuiInputHandle)
Callback = Callable[[E], None]

STICK_STEP = 0.25  # the change of the stick's velocity by one stroke of a key [m/s]
DRAG_PERIOD = 0.1  # the least time between two edits by one drag [s]
KEYS = {"W": (0.0, 1.0), "S": (0.0, -1.0), "A": (-1.0, 0.0), "D": (1.0, 0.0)}
"""The direction (east, north) of each key."""
MIN_RANK_CHOICES = 5  # the ranks from which one can choose, or more if the scene has more
NO_REGION = "none"
GREATEST_MARGIN = 0.3  # that can be chosen instead of the derived one [m]


class Controls:
    """The buttons, sliders and handles of a page, which only the browser that steers may use.

    Attributes:
        show_field: whether the guidance field is drawn.
        plots: the tab for the plots.
    """

    def __init__(self, server: viser.ViserServer, session: Session, steering: Steering):
        self._session, self._post, self._steering = session, session.post, steering
        self._is_stale = True  # whether the page may show other values than the session has
        self._last_drag_time, self._stick_is_held = 0.0, False
        self.show_field = False
        self._settings_handles: dict[str, Any] = {}  # by the field of `Settings`
        gui = server.gui
        self._add_run_bar(gui)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Drive"):
            self._fill_drive_tab(gui)
        with tabs.add_tab("Filter"):
            self._fill_filter_tab(gui)
        with tabs.add_tab("Scene"):
            self._fill_scene_tab(gui)
        self.plots = tabs.add_tab("Plots")
        self._add_handles_in_scene(server.scene)

    @property
    def follows(self) -> bool:
        """Whether cameras follow the robot."""
        return self._follow.value

    def pop_stale(self) -> bool:
        """Return whether the page has to show the session's values again, and reset that."""
        is_stale = self._is_stale
        self._is_stale = False
        return is_stale

    def release(self, client: int) -> None:
        """Release the stick if a browser that has left was the one that steered."""
        if self._steering.leave(client):
            self._stick_is_held = False
            self._post(self._session.lead_to, None)
            self._set_stick(0.0, 0.0)

    def move_stick(self, snapshot: Snapshot) -> None:
        """Move the stick's handle to the robot unless somebody drags it."""
        self._stick.visible = snapshot.settings.policy == HUMAN
        if not self._stick_is_held:
            self._stick.position = (*snapshot.position.tolist(), 0.5)

    def show(self, snapshot: Snapshot) -> None:
        """Show the settings and the scene of the session."""
        settings, scene = snapshot.settings, snapshot.scenario
        for field, handle in self._settings_handles.items():
            value = getattr(settings, field)
            if field in ("policy", "model") and value not in handle.options:  # the user's own
                handle.options = (*handle.options, value)
            handle.value = value
        self._derived.value = settings.margin is None
        self._margin.visible = settings.margin is not None
        if settings.margin is not None:
            self._margin.value = settings.margin
        self._pause.value = not snapshot.running
        known = scenarios.names()
        self._scene_name.options = known if scene.name in known else [*known, scene.name]
        self._scene_name.value = scene.name
        self._show_region(scene, snapshot.time)

    def _show_region(self, scene: Scenario, t: float) -> None:
        """Show place, size and rank of the region that is chosen, at time t [s]."""
        names = tuple(editing.names(scene))
        self._region.options = names or (NO_REGION,)
        for handle in (self._place, self._size, self._rank):
            handle.disabled = not names
        self._gizmo.visible = bool(names)
        if not names:
            return
        chosen = editing.region(scene, self._region.value)
        size = editing.size(chosen)
        ranks = max(MIN_RANK_CHOICES, *(barrier.priority for barrier in scene.barriers))
        self._rank.options = tuple(map(str, range(1, ranks + 1)))
        self._rank.value = str(chosen.priority)
        self._size.disabled = size is None
        if size is not None:
            self._size.value = size
        x, y = editing.position(chosen, t).tolist()
        self._place.value = (round(x, 3), round(y, 3))
        self._gizmo.position = (x, y, 0.1)

    def _if_steering(self, callback: Callback[E]) -> Callback[E]:
        """Return the callback for the browser that steers; it notifies any other one instead."""

        def guarded(event: E) -> None:
            if event.client is None:
                return
            if self._steering.may(event.client.client_id):
                callback(event)
                return
            self._is_stale = True
            self._notify(event.client, "Somebody else steers. Press “take the controls”.")

        return guarded

    def _notify(self, client: viser.ClientHandle, body: str) -> None:
        client.add_notification("hcbf play", body, auto_close_seconds=4.0)

    def _post_value(self, handle: Handle, command: Callable[..., None]) -> Handle:
        """Let a handle post every new value to a command; return the handle."""
        handle.on_update(self._if_steering(lambda event: self._post(command, event.target.value)))
        return handle

    def _bind_setting(self, handle: viser.GuiInputHandle, field: str) -> None:
        """Let a handle change and show a field of `Settings`."""
        change = self._session.change
        handle.on_update(
            self._if_steering(lambda event: self._post(change, **{field: event.target.value}))
        )
        self._settings_handles[field] = handle

    def _add_run_bar(self, gui: viser.GuiApi) -> None:
        """Add the controls of time, which stay above the tabs."""
        session = self._session
        with gui.add_folder("Run"):
            self._pause = self._post_value(gui.add_checkbox("pause", False), session.pause)
            buttons = gui.add_button_group("", ("step", "restart", "take the controls"))
            buttons.on_click(self._on_button)
            pace = gui.add_slider("pace", min=0.1, max=2.0, step=0.1, initial_value=1.0)
            self._post_value(pace, session.set_pace)
            self._follow = gui.add_checkbox("follow the robot", True)
            self._bind_setting(gui.add_checkbox("return after the goal", True), "returns")
            self._bind_setting(gui.add_number("seed", 0, min=0, max=10**6, step=1), "seed")

    def _on_button(self, event: viser.GuiEvent) -> None:
        """Carry out a button of the run bar; every browser may take the controls."""
        if event.client is None:
            return
        if event.target.value == "take the controls":
            self._steering.take(event.client.client_id)
            self._notify(event.client, "You steer.")
            return
        commands = {"step": self._session.step_once, "restart": self._session.restart}
        self._if_steering(lambda _: self._post(commands[event.target.value]))(event)

    def _fill_drive_tab(self, gui: viser.GuiApi) -> None:
        session = self._session
        self._bind_setting(gui.add_dropdown("policy", policy_names()), "policy")
        stick: dict[str, Any] = {"min": -1.0, "max": 1.0, "step": 0.05, "initial_value": 0.0}
        self._east = gui.add_slider("east [m/s]", **stick)
        self._north = gui.add_slider("north [m/s]", **stick)
        for slider in (self._east, self._north):
            slider.on_update(self._if_steering(lambda _: self._steer()))
        stop = gui.add_button("stop (X)", icon=viser.Icon.HAND_STOP)
        stop.on_click(self._if_steering(lambda _: self._set_stick(0.0, 0.0)))
        for key, (east, north) in KEYS.items():
            command = gui.add_command(f"stick {key}", hotkey=key)  # type: ignore[arg-type]
            command.on_trigger(self._if_steering(self._nudge(east, north)))
        halt = gui.add_command("stick: stop", hotkey="X")
        halt.on_trigger(self._if_steering(lambda _: self._set_stick(0.0, 0.0)))
        gui.add_markdown("Keys W A S D X or the sliders take over; as *human*, drag the handle.")
        gui.add_markdown("A click on the floor is the goal, where the scene has one.")
        force = gui.add_vector2("push [N]", (60.0, 0.0), min=(-500, -500), max=(500, 500), step=10)
        push = gui.add_button("push the trunk", icon=viser.Icon.HAND_FINGER)
        push.on_click(self._if_steering(lambda _: self._post(session.push, force.value)))

    def _nudge(self, east: float, north: float) -> Callback[viser.CommandEvent]:
        """Return a callback that moves the stick by `STICK_STEP` in a direction (east, north)."""

        def callback(event: viser.CommandEvent) -> None:
            x, y = self._east.value + STICK_STEP * east, self._north.value + STICK_STEP * north
            self._set_stick(max(-1.0, min(1.0, x)), max(-1.0, min(1.0, y)))

        return callback

    def _set_stick(self, east: float, north: float) -> None:
        """Set the sliders of the stick to a velocity [m/s], and steer."""
        self._east.value, self._north.value = east, north
        self._steer()

    def _steer(self) -> None:
        self._post(self._session.steer, (self._east.value, self._north.value))

    def _fill_filter_tab(self, gui: viser.GuiApi) -> None:
        program = gui.add_dropdown("program", program_names(), initial_value="lex-cbf-qp")
        self._bind_setting(program, "program")
        self._bind_setting(gui.add_checkbox("guidance", True), "guidance")
        field = gui.add_checkbox("show the field", False)
        field.on_update(self._if_steering(self._toggle_field))
        self._derived = gui.add_checkbox("margin derived", True, hint="else it is chosen")
        self._margin = gui.add_slider(
            "margin [m]", min=0.0, max=GREATEST_MARGIN, step=0.01, initial_value=0.05, visible=False
        )
        for handle in (self._derived, self._margin):
            handle.on_update(self._if_steering(lambda _: self._set_margin()))
        gamma0 = gui.add_slider("γ₀", min=0.0, max=20.0, step=0.05, initial_value=5.0)
        self._bind_setting(gamma0, "gamma0")
        delta_gamma = gui.add_slider("Δγ", min=0.0, max=5.0, step=0.1, initial_value=1.3)
        self._bind_setting(delta_gamma, "delta_gamma")

    def _toggle_field(self, event: viser.GuiEvent) -> None:
        self.show_field = event.target.value
        self._is_stale = True

    def _set_margin(self) -> None:
        """Post the margin of the slider, or None for the derived one."""
        margin = None if self._derived.value else self._margin.value
        self._post(self._session.change, margin=margin)

    def _fill_scene_tab(self, gui: viser.GuiApi) -> None:
        session = self._session
        self._bind_setting(gui.add_dropdown("robot", model_names()), "model")
        self._bind_setting(gui.add_dropdown("what stays outside", BODIES), "body")
        scene = gui.add_dropdown("scene", scenarios.names())
        self._scene_name: Any = self._post_value(scene, session.choose_scene)
        self._region: Any = gui.add_dropdown("region", (NO_REGION,))
        self._region.on_update(self._on_region_chosen)
        self._place = gui.add_vector2("place [m]", (0.0, 0.0), step=0.05)
        self._place.on_update(self._if_steering(self._edit_region(session.move)))
        self._size = gui.add_slider("size [m]", min=0.0, max=8.0, step=0.05, initial_value=1.0)
        self._size.on_update(self._if_steering(self._edit_region(session.resize)))
        self._rank: Any = gui.add_dropdown("rank", ("1",))
        self._rank.on_update(self._if_steering(self._edit_region(session.rank, int)))
        save = gui.add_button("save the scene", icon=viser.Icon.DOWNLOAD)
        save.on_click(self._save)
        upload: dict[str, Any] = {"icon": viser.Icon.UPLOAD, "mime_type": "application/json"}
        load = gui.add_upload_button("load a scene", **upload)
        load.on_upload(self._if_steering(self._load))

    def _edit_region(
        self, command: Callable[..., None], convert: Callable[[Any], Any] = lambda value: value
    ) -> Callback[viser.GuiEvent]:
        """Return a callback that posts a handle's converted value for the chosen region."""
        return lambda event: self._post(command, self._region.value, convert(event.target.value))

    def _on_region_chosen(self, event: viser.GuiEvent) -> None:
        """Show another region; every browser may choose one."""
        self._is_stale = True

    def _load(self, event: viser.GuiEvent) -> None:
        self._post(self._session.load_scene, event.target.value.content)

    def _save(self, event: viser.GuiEvent) -> None:
        """Send the scene to the browser as a JSON file."""
        client = event.client
        assert client is not None  # only a browser clicks
        try:
            content = editing.to_json(self._session.latest.scenario)
        except HcbfError as error:
            self._notify(client, str(error))
            return
        client.send_file_download("scene.json", content, save_immediately=True)

    def _add_handles_in_scene(self, scene: viser.SceneApi) -> None:
        """Add the handles that drag the chosen region and the robot, and the click on the floor."""
        planar: dict[str, Any] = {"active_axes": (True, True, False), "disable_rotations": True}
        self._gizmo = scene.add_transform_controls("/region", scale=0.6, depth_test=False, **planar)
        self._gizmo.on_update(self._if_steering(self._drag_region))
        self._stick = scene.add_transform_controls(
            "/stick", scale=0.35, depth_test=False, visible=False, **planar
        )
        self._stick.on_update(self._if_steering(self._drag_stick))
        scene.on_click()(self._if_steering(self._set_goal))

    def _set_goal(self, event: viser.SceneClickEvent) -> None:
        """Set the goal to the point where the ray of a click meets the floor, z = 0."""
        x, y, z = event.ray_origin
        ray_x, ray_y, ray_z = event.ray_direction
        if ray_z < 0.0:
            scale = -z / ray_z
            self._post(self._session.go_to, (x + scale * ray_x, y + scale * ray_y))

    def _drag_region(self, event: viser.TransformControlsEvent) -> None:
        """Move the chosen region to its handle, at most once in `DRAG_PERIOD` during a drag."""
        now = time.monotonic()
        if event.phase != "end" and now - self._last_drag_time < DRAG_PERIOD:
            return
        self._last_drag_time = now
        x, y, _ = event.target.position
        self._post(self._session.move, self._region.value, (float(x), float(y)))

    def _drag_stick(self, event: viser.TransformControlsEvent) -> None:
        """Lead the robot to the stick's handle until the drag ends."""
        self._stick_is_held = event.phase != "end"
        x, y, _ = event.target.position
        self._post(self._session.lead_to, (float(x), float(y)) if self._stick_is_held else None)
