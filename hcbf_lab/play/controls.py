"""What a person can touch on the page; everything becomes a command of the session."""

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
from hcbf_lab.play.settings import BODIES, model_names, policy_names, program_names
from hcbf_lab.play.steering import Steering


class Event(Protocol):
    """A touch, as viser reports it."""

    @property
    def client(self) -> viser.ClientHandle | None:
        """The browser that it came from; None where the page itself changed."""


E = TypeVar("E", bound=Event)
Handle = TypeVar("Handle", bound=viser.GuiInputHandle)
Act = Callable[[E], None]

STICK_STEP = 0.25
"""What one stroke of a key adds to the stick [m/s]."""
DRAG_PERIOD = 0.1
"""The least time between two edits of a drag [s]."""
KEYS = {"W": (0.0, 1.0), "S": (0.0, -1.0), "A": (-1.0, 0.0), "D": (1.0, 0.0)}
LEAST_RANKS = 5
"""How many ranks can be chosen from; more where a scene has more."""
NO_REGION = "none"
WIDEST_MARGIN = 0.3
"""That can be chosen instead of the derived one [m]."""


class Controls:
    """The buttons, sliders and handles of a page, which command a session."""

    def __init__(self, server: viser.ViserServer, session: Session, steering: Steering):
        self._server, self._session, self._steering = server, session, steering
        self._stale, self._last_drag, self._held = True, 0.0, False
        self.show_field = False
        gui = server.gui
        self._run_bar(gui)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Drive"):
            self._drive(gui)
        with tabs.add_tab("Filter"):
            self._filter(gui)
        with tabs.add_tab("Scene"):
            self._scene(gui)
        self.plots = tabs.add_tab("Plots")
        self._handles(server.scene)

    @property
    def follows(self) -> bool:
        """Whether cameras follow the robot."""
        return self._follow.value

    def stale(self) -> bool:
        """Return whether the page shows old values, once."""
        stale = self._stale
        self._stale = False
        return stale

    def left(self, client: int) -> None:
        """Let the stick go if the browser that left was the one that steers."""
        if self._steering.leave(client):
            self._held = False
            self._post(self._session.lead_to, None)
            self._set_stick(0.0, 0.0)

    def follow(self, snapshot: Snapshot) -> None:
        """Hold the stick on the robot while it is not dragged."""
        self._stick.visible = snapshot.settings.policy == "human"
        if not self._held:
            self._stick.position = (*snapshot.position.tolist(), 0.5)

    def agree(self, snapshot: Snapshot) -> None:
        """Show what is chosen and how the scene is."""
        settings, scene = snapshot.settings, snapshot.scenario
        if settings.policy not in self._policy.options:  # one of the user's own
            self._policy.options = (*self._policy.options, settings.policy)
        if settings.model not in self._model.options:  # a contract's path
            self._model.options = (*self._model.options, settings.model)
        self._policy.value, self._program.value = settings.policy, settings.program
        self._returns.value = settings.returns
        self._model.value, self._guidance.value = settings.model, settings.guidance
        self._gamma0.value, self._delta_gamma.value = settings.gamma0, settings.delta_gamma
        self._body.value = settings.body
        self._derived.value = settings.margin is None
        self._margin.visible = settings.margin is not None
        if settings.margin is not None:
            self._margin.value = settings.margin
        self._seed.value = settings.seed
        self._pause.value = not snapshot.running
        known = scenarios.names()
        self._scene_name.options = known if scene.name in known else [*known, scene.name]
        self._scene_name.value = scene.name
        self._agree_on_region(scene, snapshot.time)

    def _agree_on_region(self, scene: Scenario, t: float) -> None:
        """Show the region that is chosen, if there is one."""
        names = tuple(editing.names(scene))
        self._region.options = names or (NO_REGION,)
        for part in (self._place, self._size, self._rank):
            part.disabled = not names
        self._gizmo.visible = bool(names)
        if not names:
            return
        chosen = editing.region(scene, self._region.value)
        size = editing.size(chosen)
        ranks = max(LEAST_RANKS, *(barrier.priority for barrier in scene.barriers))
        self._rank.options = tuple(map(str, range(1, ranks + 1)))
        self._rank.value = str(chosen.priority)
        self._size.disabled = size is None
        if size is not None:
            self._size.value = size
        x, y = editing.position(chosen, t).tolist()
        self._place.value = (round(x, 3), round(y, 3))
        self._gizmo.position = (x, y, 0.1)

    def _if_steering(self, act: Act[E]) -> Act[E]:
        """Return a callback that obeys the browser that steers, and notifies the others."""

        def callback(event: E) -> None:
            if event.client is None:
                return
            if self._steering.may(event.client.client_id):
                act(event)
                return
            self._stale = True
            self._notify(event.client, "Somebody else steers. Press “take the controls”.")

        return callback

    def _notify(self, client: viser.ClientHandle, body: str) -> None:
        client.add_notification("hcbf play", body, auto_close_seconds=4.0)

    def _post(self, command: Callable[..., None], *arguments: object, **named: object) -> None:
        self._session.post(command, *arguments, **named)

    def _on_value(self, handle: Handle, command: Callable[..., None]) -> Handle:
        """Send a handle's new value to a command."""
        handle.on_update(self._if_steering(lambda event: self._post(command, event.target.value)))
        return handle

    def _on_choice(self, handle: Handle, field: str) -> Handle:
        """Send a handle's new value as a field of the settings."""
        change = self._session.change
        handle.on_update(
            self._if_steering(lambda event: self._post(change, **{field: event.target.value}))
        )
        return handle

    def _on_click(self, handle: viser.GuiButtonHandle, act: Act[viser.GuiEvent]) -> None:
        handle.on_click(self._if_steering(act))

    def _run_bar(self, gui: viser.GuiApi) -> None:
        session = self._session
        with gui.add_folder("Run"):
            self._pause = self._on_value(gui.add_checkbox("pause", False), session.pause)
            buttons = gui.add_button_group("", ("step", "restart", "take the controls"))
            buttons.on_click(self._on_button)
            pace = gui.add_slider("pace", min=0.1, max=2.0, step=0.1, initial_value=1.0)
            self._on_value(pace, session.set_pace)
            self._follow = gui.add_checkbox("follow the robot", True)
            returns = gui.add_checkbox("return after the goal", True)
            self._returns = self._on_choice(returns, "returns")
            seed = gui.add_number("seed", 0, min=0, max=10**6, step=1)
            self._seed = self._on_choice(seed, "seed")

    def _on_button(self, event: viser.GuiEvent) -> None:
        if event.client is None:
            return
        if event.target.value == "take the controls":
            self._steering.take(event.client.client_id)
            self._notify(event.client, "You steer.")
            return
        commands = {"step": self._session.step_once, "restart": self._session.restart}
        self._if_steering(lambda _: self._post(commands[event.target.value]))(event)

    def _drive(self, gui: viser.GuiApi) -> None:
        session = self._session
        self._policy = self._on_choice(gui.add_dropdown("policy", policy_names()), "policy")
        stick: dict[str, Any] = {"min": -1.0, "max": 1.0, "step": 0.05, "initial_value": 0.0}
        self._east = gui.add_slider("east [m/s]", **stick)
        self._north = gui.add_slider("north [m/s]", **stick)
        for slider in (self._east, self._north):
            slider.on_update(self._if_steering(lambda _: self._steer()))
        stop = gui.add_button("stop (X)", icon=viser.Icon.HAND_STOP)
        self._on_click(stop, lambda _: self._set_stick(0.0, 0.0))
        for key, (east, north) in KEYS.items():
            command = gui.add_command(f"stick {key}", hotkey=key)  # type: ignore[arg-type]
            command.on_trigger(self._if_steering(self._nudge(east, north)))
        halt = gui.add_command("stick: stop", hotkey="X")
        halt.on_trigger(self._if_steering(lambda _: self._set_stick(0.0, 0.0)))
        gui.add_markdown("Keys W A S D X or the sliders take over; as *human*, drag the handle.")
        gui.add_markdown("A click on the floor is the goal, where the scene has one.")
        force = gui.add_vector2("push [N]", (60.0, 0.0), min=(-500, -500), max=(500, 500), step=10)
        push = gui.add_button("push the trunk", icon=viser.Icon.HAND_FINGER)
        self._on_click(push, lambda _: self._post(session.push, force.value))

    def _nudge(self, east: float, north: float) -> Act[viser.CommandEvent]:
        def act(event: viser.CommandEvent) -> None:
            x, y = self._east.value + STICK_STEP * east, self._north.value + STICK_STEP * north
            self._set_stick(max(-1.0, min(1.0, x)), max(-1.0, min(1.0, y)))

        return act

    def _set_stick(self, east: float, north: float) -> None:
        self._east.value, self._north.value = east, north
        self._steer()

    def _steer(self) -> None:
        self._post(self._session.steer, (self._east.value, self._north.value))

    def _filter(self, gui: viser.GuiApi) -> None:
        program = gui.add_dropdown("program", program_names(), initial_value="lex-cbf-qp")
        self._program = self._on_choice(program, "program")
        self._guidance = self._on_choice(gui.add_checkbox("guidance", True), "guidance")
        field = gui.add_checkbox("show the field", False)
        field.on_update(self._if_steering(self._toggle_field))
        self._derived = gui.add_checkbox("margin derived", True, hint="else it is chosen")
        self._margin = gui.add_slider(
            "margin [m]", min=0.0, max=WIDEST_MARGIN, step=0.01, initial_value=0.05, visible=False
        )
        for part in (self._derived, self._margin):
            part.on_update(self._if_steering(lambda _: self._set_margin()))
        gamma0 = gui.add_slider("γ₀", min=0.0, max=20.0, step=0.05, initial_value=5.0)
        self._gamma0 = self._on_choice(gamma0, "gamma0")
        delta = gui.add_slider("Δγ", min=0.0, max=5.0, step=0.1, initial_value=1.3)
        self._delta_gamma = self._on_choice(delta, "delta_gamma")

    def _toggle_field(self, event: viser.GuiEvent) -> None:
        self.show_field = event.target.value
        self._stale = True

    def _set_margin(self) -> None:
        chosen = None if self._derived.value else self._margin.value
        self._post(self._session.change, margin=chosen)

    def _scene(self, gui: viser.GuiApi) -> None:
        session = self._session
        self._model = self._on_choice(gui.add_dropdown("robot", model_names()), "model")
        self._body = self._on_choice(gui.add_dropdown("what stays outside", tuple(BODIES)), "body")
        scene = gui.add_dropdown("scene", scenarios.names())
        self._scene_name: Any = self._on_value(scene, session.choose_scene)
        self._region: Any = gui.add_dropdown("region", (NO_REGION,))
        self._region.on_update(self._look_at_another)
        self._place = gui.add_vector2("place [m]", (0.0, 0.0), step=0.05)
        self._place.on_update(self._if_steering(self._edit(session.move)))
        self._size = gui.add_slider("size [m]", min=0.0, max=8.0, step=0.05, initial_value=1.0)
        self._size.on_update(self._if_steering(self._edit(session.resize)))
        self._rank: Any = gui.add_dropdown("rank", ("1",))
        self._rank.on_update(self._if_steering(self._set_rank))
        save = gui.add_button("save the scene", icon=viser.Icon.DOWNLOAD)
        save.on_click(self._save)
        load = gui.add_upload_button(
            "load a scene", icon=viser.Icon.UPLOAD, mime_type="application/json"
        )
        load.on_upload(
            self._if_steering(lambda e: self._post(session.load_scene, e.target.value.content))
        )

    def _edit(self, command: Callable[..., None]) -> Act[viser.GuiEvent]:
        return lambda event: self._post(command, self._region.value, event.target.value)

    def _set_rank(self, event: viser.GuiEvent) -> None:
        self._post(self._session.rank, self._region.value, int(event.target.value))

    def _look_at_another(self, event: viser.GuiEvent) -> None:
        self._stale = True

    def _save(self, event: viser.GuiEvent) -> None:
        client = event.client
        assert client is not None  # a click is a browser's
        try:
            content = editing.to_json(self._session.latest.scenario)
        except HcbfError as error:
            self._notify(client, str(error))
            return
        client.send_file_download("scene.json", content, save_immediately=True)

    def _handles(self, scene: viser.SceneApi) -> None:
        flat: dict[str, Any] = {"active_axes": (True, True, False), "disable_rotations": True}
        self._gizmo = scene.add_transform_controls("/region", scale=0.6, depth_test=False, **flat)
        self._gizmo.on_update(self._if_steering(self._drag_region))
        self._stick = scene.add_transform_controls(
            "/stick", scale=0.35, depth_test=False, visible=False, **flat
        )
        self._stick.on_update(self._if_steering(self._drag_stick))
        scene.on_click()(self._if_steering(self._click))

    def _click(self, event: viser.SceneClickEvent) -> None:
        """Take the point of the floor that was clicked for the goal."""
        x, y, z = event.ray_origin
        along_x, along_y, down = event.ray_direction
        if down < 0.0:
            far = -z / down
            self._post(self._session.go_to, (x + far * along_x, y + far * along_y))

    def _drag_region(self, event: viser.TransformControlsEvent) -> None:
        now = time.monotonic()
        if event.phase != "end" and now - self._last_drag < DRAG_PERIOD:
            return
        self._last_drag = now
        x, y, _ = event.target.position
        self._post(self._session.move, self._region.value, (float(x), float(y)))

    def _drag_stick(self, event: viser.TransformControlsEvent) -> None:
        self._held = event.phase != "end"
        x, y, _ = event.target.position
        self._post(self._session.lead_to, (float(x), float(y)) if self._held else None)
