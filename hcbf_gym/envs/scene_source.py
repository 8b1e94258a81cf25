"""The source of the scenes in which an environment's episodes take place."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hcbf_gym import records, scenarios
from hcbf_gym.errors import InvalidInputError, check_options, choose, shown
from hcbf_gym.scenarios import Hooks, Scenario, ScenarioLike, Scene
from hcbf_gym.scenarios.hooks import NO_HOOKS
from hcbf_gym.scenarios.scene import HALF_PLANE, SHAPE, X, Y

OPTIONS = ("scenario", "start")  # keys of ``reset(options=…)``, for one episode


class SceneSource:
    """Chooses each episode's scene: the own one, a random one, or the one of a reset's options.

    Args:
        source: the environment's argument `scenario`.
        intentions: "known", or "hidden" where the family redraws velocities within an episode.

    Attributes:
        own_scene: the scene that fixes task, inputs, boxes and number of barriers of all episodes.
        random_family: the family that draws a scene for each episode; None for always the same one.
        drawn_scene: the arrays that `next` drew last; None where options gave the scene.
        hidden: whether the family redraws velocities within an episode.

    Raises:
        InvalidInputError: if intentions are hidden and the family has no `redraw`.
    """

    def __init__(self, source: ScenarioLike, intentions: str = "known"):
        self._source = source
        self.random_family = scenarios.family_of(source)
        self.own_scene = scenarios.make(source, np.random.default_rng(0))
        self.drawn_scene: Scene | None = None
        self.hidden = choose("intentions", intentions, {"known": False, "hidden": True})
        self._redraw = None if self.random_family is None else self.random_family.redraw
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
        given = _fixed_properties(self.next(np.random.default_rng(0), options))
        own = _fixed_properties(self.own_scene)
        if given != own:
            raise InvalidInputError(
                f"reset: options: scenario: got {given}, expected the environment's {own}"
            )
        return options

    def next(self, rng: np.random.Generator, options: Mapping[str, Any]) -> Scenario:
        """Return the scene of the next episode, for options from `check`."""
        self.drawn_scene = None
        family, scene = self.random_family, self.own_scene
        if family is not None and not options:
            self.drawn_scene = family.draw_scenes([rng]).one(0)
            return family.scenario(self.drawn_scene)
        if "scenario" in options or family is not None:
            scene = scenarios.make(options.get("scenario", self._source), rng)
        return replace(scene, start=options["start"]) if "start" in options else scene

    def redraw_velocities(self, scene: object, t: float, rng: np.random.Generator) -> bool:
        """Let hidden intentions change a drawn scene at time t [s]; return whether they did.

        Every shape continues from its position at that time.
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
        # a scene has positions p at time 0: p + t v = p' + t v' holds for p' = p + t (v − v')
        slowed_by = before - scene.velocities
        scene.shapes[:, [X, Y]] += t * slowed_by
        return bool(slowed_by.any())

    def family_name(self, options: Mapping[str, Any]) -> str | None:
        """Return the name of the family that draws an episode's scene, for options from `check`.

        Certificates compare it. It is None where no family draws the scene and its start.
        """
        if "start" in options:
            return None
        source, family = self._source, self.random_family
        if "scenario" in options:
            source = options["scenario"]
            family = scenarios.family_of(source)
        if family is None:
            return None
        return str(source) if isinstance(source, Mapping) else family.identity

    def scenario(self, scene: Scene | Scenario) -> Scenario:
        """Return a scene that was drawn from the environment's own family as a `Scenario`."""
        if isinstance(scene, Scenario):
            return scene
        assert self.random_family is not None  # no other scenes are drawn
        return self.random_family.scenario(scene)

    @property
    def hooks(self) -> Hooks:
        """Observation, reward and costs of the environment's own family."""
        return NO_HOOKS if self.random_family is None else self.random_family.hooks


def _fixed_properties(scene: Scenario) -> dict[str, object]:
    """Return the properties of a scene that spaces, filter and physics depend on."""
    return {
        "task": scene.task,
        "input_set": scene.input_set.to_dict(),
        "barriers": len(scene.conditions),
        "v_max": scene.v_max,
        "obstacles": list(scene.obstacles),
    }
