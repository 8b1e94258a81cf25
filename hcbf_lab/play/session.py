"""The simulation of the playground, which takes commands and makes a `Snapshot` of every tick.

It does not depend on a page. Every thread may post commands, which wait for the next tick.
"""

import queue
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from hcbf_gym import scenarios
from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import HcbfError, InvalidInputError, SafetyWarning, finite_array, finite_float
from hcbf_gym.programs import FilterStatus
from hcbf_gym.scenarios import Scenario
from hcbf_gym.scenarios.references import PointReference
from hcbf_lab.play import editing, report
from hcbf_lab.play.report import Snapshot
from hcbf_lab.play.settings import HUMAN, Arrangement, Human, Settings, arrange

Source = str | Path | Mapping[str, object] | Scenario

PUSH_TIME = 0.2  # the duration of a push [s]
MAX_PUSH = 500.0  # the greatest force of a push [N]
MAX_DELAY = 0.1  # that a slow machine catches up [s of the clock]; beyond it, time runs slower
REST_TICKS = 50  # for which a robot stays at its goal before it returns
COURSE_OVERTIME = 5.0  # after the end of a course until it begins again without the robot [s]
CONFLICT_PERIOD = 10  # ticks from one conflict report to the next


class Session:
    """A scene, a robot, a filter and a policy, which run until they are stopped.

    Attributes:
        latest: the record of the last tick, a new object after each.

    Raises:
        HcbfError: if no environment can be made from settings and scene.
    """

    def __init__(self, settings: Settings, scenario: Source = "random"):
        self._commands: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._source: Source = scenario
        self._pace = 1.0
        self._running, self._is_watched = True, True  # time advances while both are true
        self._extra_steps = 0  # that advance time nevertheless
        self._clock: deque[tuple[float, int]] = deque([(time.perf_counter(), 0)], maxlen=50)
        self._ticks, self._revision, self._messages, self._message = 0, 0, 0, ""
        self._start(settings, self._draw(scenario, settings.seed))
        self.latest = self._record()

    @property
    def environment(self) -> gym.Env:
        """The environment, with its filter if there is one."""
        return self._arrangement.env

    def post(self, command: Callable[..., None], *arguments: object, **named: object) -> None:
        """Queue a command for the next tick. Every thread may call this."""
        self._commands.put(partial(command, *arguments, **named))

    def run(self, stop: threading.Event) -> None:
        """Tick at the chosen pace until `stop` is set, or more slowly if a tick takes longer."""
        due = time.perf_counter()
        while not stop.is_set():
            self.tick()
            now = time.perf_counter()
            due = max(due + CONTROL_DT / self._pace, now - MAX_DELAY)
            time.sleep(max(0.0, due - now))

    def tick(self) -> None:
        """Carry out the queued commands, step once if time advances, and make a record."""
        while not self._commands.empty():
            self._message = ""
            try:
                self._commands.get()()
            except HcbfError as error:
                self._revision += 1  # the page has to show the old choices again
                self._show(str(error))
        if (self._running and self._is_watched) or self._extra_steps:
            self._extra_steps = max(0, self._extra_steps - 1)
            self._advance()
        self._clock.append((time.perf_counter(), self._ticks))
        self.latest = self._record()

    def change(self, **choices: Any) -> None:
        """Change fields of `Settings`, while the robot continues from its state.

        Another model or body begins at the start. Another seed draws a new random scene.

        Raises:
            HcbfError: if a choice is refused; then everything stays the same.
        """
        settings = replace(self.settings, **choices)
        if "seed" in choices:
            self._start(settings, self._draw(self._source, settings.seed, self.scenario))
        elif (settings.model, settings.body) != (self.settings.model, self.settings.body):
            self._start(settings, self.scenario)
        else:
            self._join(arrange(settings, self.scenario, self._arrangement.inner), settings)

    def choose_scene(self, scenario: Source) -> None:
        """Begin in another scene, of any type that environments take."""
        self._start(self.settings, self._draw(scenario, self.settings.seed))
        self._source = scenario

    def load_scene(self, content: bytes) -> None:
        """Begin in the scene of a JSON file with this content."""
        self.choose_scene(editing.from_json(content))
        self._show(f"The scene {self.scenario.name!r} was loaded.")

    def restart(self) -> None:
        """Begin the present scene again, with the same seed."""
        scene = self.scenario
        if isinstance(scene.reference, PointReference):  # the robot may be returning to the start
            scene = replace(scene, reference=PointReference(self._goal))
        self._start(self.settings, scene)

    def attend(self, watched: bool) -> None:
        """Let time advance only while a browser watches; restart then if the robot had arrived."""
        if watched and not self._is_watched and self._info["is_success"]:
            self.restart()
        self._is_watched = watched

    def move(self, region: str, to: Sequence[float]) -> None:
        """Move a region to a position (2,) [m]."""
        self._edit(editing.move(self.scenario, region, to, self._arrangement.inner.time))

    def resize(self, region: str, size: float) -> None:
        """Give a region another size [m]."""
        self._edit(editing.resize(self.scenario, region, size))

    def rank(self, region: str, priority: int) -> None:
        """Give a region another rank."""
        self._edit(editing.rank(self.scenario, region, priority))

    def go_to(self, goal: Sequence[float]) -> None:
        """Give the scene another goal (2,) [m]."""
        if not isinstance(self.scenario.reference, PointReference):
            raise InvalidInputError(
                f"goal: the scene {self.scenario.name!r} has a course to follow, expected a goal"
            )
        x, y = finite_array("goal", goal, (2,)).tolist()
        self._edit(replace(self.scenario, reference=PointReference((x, y))))
        self._goal = (x, y)
        self._show(f"The goal is at {x:.2f}, {y:.2f} m.")

    def steer(self, velocity: Sequence[float]) -> None:
        """Set the velocity (2,) of the person's stick [m/s]; if it is not zero, they steer."""
        requested = finite_array("stick", velocity, (2,))
        if requested.any() and self.settings.policy != HUMAN:
            self.change(policy=HUMAN)
            self._show("You steer: W A S D and X, or choose another policy to let it go.")
        self._human.velocity = requested
        self._human.target = None

    def lead_to(self, target: Sequence[float] | None) -> None:
        """Set the point (2,) to which the person leads the robot [m]; None for no point."""
        self._human.target = None if target is None else finite_array("stick", target, (2,))

    def push(self, force: Sequence[float]) -> None:
        """Push the trunk with a horizontal force (2,) [N], for `PUSH_TIME`."""
        horizontal = finite_array("push", force, (2,))
        if not hasattr(self._arrangement.inner, "simulation"):
            raise InvalidInputError(
                "push: got the reduced-order model, expected a robot, which has a body"
            )
        if np.linalg.norm(horizontal) > MAX_PUSH:
            raise InvalidInputError(f"push: got {horizontal} N, expected at most {MAX_PUSH:g} N")
        self._arrangement.inner.simulation.push(np.array([*horizontal, 0.0]))
        self._push_ticks = round(PUSH_TIME / CONTROL_DT)
        self._reset_least_h()

    def pause(self, paused: bool) -> None:
        """Stop time, or let it advance."""
        self._running = not paused

    def step_once(self) -> None:
        """Take one step and stop."""
        self._running, self._extra_steps = False, 1

    def set_pace(self, pace: float) -> None:
        """Set the number of simulated seconds in a second of the clock."""
        self._pace = finite_float("pace", pace, minimum=0.0, exclusive=True)

    def _draw(self, source: Source, seed: int, fixed: Scenario | None = None) -> Scenario:
        """Return the scene of a source; `fixed` replaces a scene that no seed changes."""
        if fixed is not None and not scenarios.is_random(source):
            return fixed
        return scenarios.make(source, np.random.default_rng(seed))

    def _start(self, settings: Settings, scenario: Scenario) -> None:
        """Begin an episode in a new environment."""
        arrangement = arrange(settings, scenario)
        observation, info = arrangement.env.reset(seed=settings.seed)
        self._arrangement, self.settings, self.scenario = arrangement, settings, scenario
        self._observation, self._info = observation, info
        space: Any = arrangement.inner.action_space
        self._human = Human(space.low.astype(np.float64), space.high.astype(np.float64))
        barriers = arrangement.inner.barriers
        self._is_region = np.array([barrier.reads_position for barrier in barriers])
        self._push_ticks, self._conflict, self._ticks_at_goal = 0, "", 0
        x, y = scenario.goal.tolist()
        self._goal = (x, y)
        self._revision += 1
        self._reset_least_h()

    def _join(self, arrangement: Arrangement, settings: Settings) -> None:
        """Continue the episode with another filter or policy."""
        if arrangement.env is not arrangement.inner:
            filtered: Any = arrangement.env
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SafetyWarning)  # the page shows what is wrong
                filtered.join(self._observation, self._info)
        else:
            self._info.pop("safety_filter", None)
        self._arrangement, self.settings = arrangement, settings
        self._conflict = ""
        self._revision += 1

    def _edit(self, scenario: Scenario) -> None:
        """Continue in an edited scene, but in the old one if the filter refuses the edited one.

        Raises:
            HcbfError: if the filter refuses the edited scene, or finds no path in it.
        """
        self._arrangement.inner.change_scene(scenario)
        try:
            self._join(arrange(self.settings, scenario, self._arrangement.inner), self.settings)
            filtered: Any = self._arrangement.env
            if filtered is not self._arrangement.inner and filtered.lost:
                raise InvalidInputError(filtered.lost)
        except HcbfError:
            self._arrangement.inner.change_scene(self.scenario)
            self._join(
                arrange(self.settings, self.scenario, self._arrangement.inner), self.settings
            )
            raise
        self.scenario = scenario
        self._reset_least_h()

    def _advance(self) -> None:
        """Step the environment once, and update the state that the records show."""
        inner = self._arrangement.inner
        x = inner.estimate.x.copy()
        policy = self._arrangement.policy
        action = self._human.act(x) if policy is None else policy(self._observation, self._info)
        self._observation, _, _, _, self._info = self._arrangement.env.step(
            np.asarray(action, dtype=np.float64)
        )
        self._ticks += 1
        if self._push_ticks:
            self._push_ticks -= 1
            if not self._push_ticks:
                inner.simulation.push(np.zeros(3))
            self._reset_least_h()
        self._least_h = np.minimum(self._least_h, self._h("min_"))
        if self._info.get("fallen", 0.0):
            self._running = False
            self._show("The robot fell. Restart to go on.")
        self._handle_arrival(is_steered=policy is None)
        reported = self._info.get("safety_filter")
        if reported is None or not reported["slack"].any():
            self._conflict = ""
        elif self._ticks % CONFLICT_PERIOD == 0 or not self._conflict:
            filtered: Any = self._arrangement.env
            self._conflict = report.conflict(filtered.conflict(), inner.barriers, x)

    def _handle_arrival(self, *, is_steered: bool) -> None:
        """Show that the robot is at its goal, and let it return after a rest.

        A course begins again if it has ended without the robot. A person decides that alone.
        """
        if not self._info["is_success"]:
            self._ticks_at_goal = 0
            reference = self.scenario.reference
            is_late = self._arrangement.inner.time > reference.duration + COURSE_OVERTIME
            if is_late and not is_steered and not isinstance(reference, PointReference):
                self.restart()
                self._show("The course had ended; here it begins again.")
            return
        self._ticks_at_goal += 1
        if self._ticks_at_goal == 1:
            self._show(f"Arrived after {self._arrangement.inner.time:.1f} s.")
        if self._ticks_at_goal == REST_TICKS and not is_steered and self.settings.returns:
            self._return()

    def _return(self) -> None:
        """Exchange goal and start; restart instead if there is a course to follow, or no path."""
        scene = self.scenario
        if not isinstance(scene.reference, PointReference):
            self.restart()
            return
        to_start = np.allclose(scene.goal, self._goal)
        new_goal = scene.start if to_start else self._goal
        try:
            self._edit(replace(scene, reference=PointReference(new_goal)))
        except HcbfError:
            self.restart()
            return
        self._ticks_at_goal = 0
        self._show(f"Arrived; now {'back to the start' if to_start else 'to the goal again'}.")

    def _reset_least_h(self) -> None:
        """Let the least h's of the records begin now."""
        self._least_h = self._h().copy()

    def _h(self, prefix: str = "") -> Array:
        """Return h (m,) of the body, or of a point; "min_" gives the least in the last step."""
        body_h = self._info.get(f"{prefix}body_h")
        return self._info[f"{prefix}h"] if body_h is None else body_h

    def _show(self, message: str) -> None:
        """Set the message that the page shows."""
        self._message = message
        self._messages += 1

    def _record(self) -> Snapshot:
        """Return the record of the present tick."""
        inner = self._arrangement.inner
        is_region = self._is_region
        priority = inner.barrier_set.priority[0]
        h = self._h()
        h_by_rank = report.by_rank(h[is_region], priority[is_region], np.min)
        slack_by_rank = dict.fromkeys(h_by_rank, 0.0)
        status, reason, intervention = report.UNFILTERED, int(Reason.NONE), 0.0
        details: dict[str, str] = {}
        filter_report = self._info.get("safety_filter")
        if filter_report is not None:
            m = len(priority)
            slack_by_rank = report.by_rank(filter_report["slack"][:m], priority, np.max)
            status = FilterStatus(int(filter_report["status"])).name
            reason = int(filter_report["reason"])
            intervention = float(filter_report["intervention"])
            margin = float(filter_report["margin"][:m][is_region].max(initial=0.0))
            details = report.details(filter_report, margin, self.settings.margin is None)
        x = inner.truth
        reference_time = min(inner.time, inner.scenario.reference.duration)
        simulation = getattr(inner, "simulation", None)
        data = None if simulation is None else simulation.data
        return Snapshot(
            time=float(inner.time),
            pace=self._measured_pace(),
            running=self._running,
            position=x[:2],
            velocity=x[2:],
            reference=inner.scenario.reference(reference_time)[0],
            body=None if simulation is None else simulation.model,
            poses=None if data is None else np.hstack([data.xpos, data.xquat]),
            h=h_by_rank,
            least=report.by_rank(self._least_h[is_region], priority[is_region], np.min),
            slack=slack_by_rank,
            speed_margin=None if is_region.all() else float(h[~is_region].min()),
            intervention=intervention,
            status=status,
            sentence=report.sentence(status, slack_by_rank, h_by_rank, intervention, reason),
            conflict=self._conflict,
            details=details,
            settings=self.settings,
            scenario=self.scenario,
            revision=self._revision,
            message=self._message,
            messages=self._messages,
        )

    def _measured_pace(self) -> float:
        """Return the simulated seconds in a second of the clock, over the last 50 records."""
        (start, first_tick), (now, last_tick) = self._clock[0], self._clock[-1]
        return CONTROL_DT * (last_tick - first_tick) / (now - start) if now > start else 0.0
