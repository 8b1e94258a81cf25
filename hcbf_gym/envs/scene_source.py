"""The scene of an environment's next episode."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hcbf_gym import records, scenarios
from hcbf_gym.errors import InvalidInputError, check_options, choose, shown
from hcbf_gym.scenarios import Hooks, Scenario, ScenarioLike, Scene
from hcbf_gym.scenarios.family import NO_HOOKS
from hcbf_gym.scenarios.scene import HALF_PLANE, SHAPE, X, Y

OPTIONS = ("scenario", "start")
"""The keys of ``reset(options=…)``: another scene, and where to start in it, for one episode."""


class SceneSource:
    """An environment's own scene, a random one for each episode, or that of a reset's options.

    Args:
        source: the environment's argument `scenario`.
        intentions: "known", or "hidden" where the family redraws velocities within an episode.

    Attributes:
        own: the scene that fixes task, inputs, boxes and number of barriers for good.
        drawn: the family of the episodes' scenes; None for always the same scene.
        scene: the one that `next` drew last; None where options gave it.
        hidden: whether the family redraws velocities within an episode.

    Raises:
        InvalidInputError: if intentions are hidden and the family has no `redraw`.
    """

    def __init__(self, source: ScenarioLike, intentions: str = "known"):
        self.source = source
        self.drawn = scenarios.family_of(source)
        self.own = scenarios.make(source, np.random.default_rng(0))
        self.scene: Scene | None = None
        self.hidden = choose("intentions", intentions, {"known": False, "hidden": True})
        self._redraw = None if self.drawn is None else self.drawn.redraw
        if self.hidden and self._redraw is None:
            raise InvalidInputError(
                f"intentions: got 'hidden' with the scenario {shown(source)}, expected a family "
                'that is registered with redraw=…, such as "random-crossing"'
            )

    def check(self, options: Mapping[str, object] | None) -> Mapping[str, Any]:
        """Return the options of a reset, as a mapping.

        Raises:
            InvalidInputError: if an option is unknown or malformed, or the scene does not fit the
                environment.
        """
        if options is None:
            return {}
        records.check_mapping("reset: options", options)
        check_options("reset: options", options, OPTIONS)
        if not options:
            return {}
        got = _alike(self.next(np.random.default_rng(0), options))
        own = _alike(self.own)
        if got != own:
            raise InvalidInputError(
                f"reset: options: scenario: got {got}, expected the environment's {own}"
            )
        return options

    def next(self, rng: np.random.Generator, options: Mapping[str, Any]) -> Scenario:
        """Return the scene of the next episode, for options from `check`."""
        scene, self.scene = self.own, None
        if not options and self.drawn is not None:
            self.scene = self.drawn.drawn([rng]).one(0)
            return self.drawn.scenario(self.scene)
        if "scenario" in options or self.drawn is not None:
            scene = scenarios.make(options.get("scenario", self.source), rng)
        return replace(scene, start=options["start"]) if "start" in options else scene

    def redrawn(self, scene: object, t: float, rng: np.random.Generator) -> bool:
        """Let hidden intentions change a drawn scene at time t [s]; return whether they did.

        Every shape continues from where it is then.
        """
        if not (self.hidden and self._redraw and isinstance(scene, Scene)):
            return False
        before = scene.velocities.copy()
        self._redraw(rng, scene.velocities)
        if not np.isfinite(scene.velocities).all():
            raise InvalidInputError(
                f"redraw: got {shown(scene.velocities)}, expected finite velocities"
            )
        scene.velocities[scene.shapes[:, SHAPE] == HALF_PLANE] = 0.0
        slower = before - scene.velocities  # a shape's position is that at time 0
        scene.shapes[:, [X, Y]] += t * slower
        return bool(slower.any())

    def family(self, options: Mapping[str, Any]) -> str | None:
        """Return the family of an episode's scene, for options from `check`; None for no family."""
        source = options.get("scenario", self.source)
        drawn = scenarios.family_of(source) if "scenario" in options else self.drawn
        if drawn is None or "start" in options:
            return None
        return str(source) if isinstance(source, Mapping) else drawn.identity

    def scenario(self, scene: Scene | Scenario) -> Scenario:
        """Return a scene that was drawn from the environment's own family as a `Scenario`."""
        if isinstance(scene, Scenario):
            return scene
        assert self.drawn is not None  # no other scenes are drawn
        return self.drawn.scenario(scene)

    @property
    def hooks(self) -> Hooks:
        """Observation, reward and costs of the environment's own family."""
        return NO_HOOKS if self.drawn is None else self.drawn.hooks


def _alike(scene: Scenario) -> dict[str, object]:
    """Return the properties that spaces, filter and physics depend on."""
    return {
        "task": scene.task,
        "input_set": scene.input_set.to_dict(),
        "barriers": len(scene.conditions),
        "v_max": scene.v_max,
        "obstacles": list(scene.obstacles),
    }
