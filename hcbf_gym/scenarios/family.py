"""Family: random scenes of one kind, drawn by a function that fills the arrays of a scene."""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym import certificates, sources
from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, in_words
from hcbf_gym.scenarios.floor import Floor
from hcbf_gym.scenarios.hooks import NO_HOOKS, Hooks
from hcbf_gym.scenarios.references import PointReference
from hcbf_gym.scenarios.scenario import Scenario
from hcbf_gym.scenarios.scene import Scene, barriers_of, check_filled, check_ranks, check_shapes

V_MAX = 1.0
"""Strict cap on the speed [m/s] of the shipped families, low enough for the A1 to follow."""

_COMPARED_SEEDS = range(8)  # on which `draw_many` is compared with `draw`

Draw = Callable[[np.random.Generator, Scene], None]
"""Fills the arrays of one scene, at the beginning of an episode."""
DrawMany = Callable[[Sequence[np.random.Generator], Scene], None]
"""Fills the arrays of N scenes, each from its generator."""
Redraw = Callable[[np.random.Generator, Array], None]
"""Overwrites the velocities (m, 2) [m/s] of a scene's shapes, within an episode."""


@dataclass(frozen=True)
class Family:
    """Random scenes of one kind, which share number of shapes, cap on the speed, map and hooks.

    `hcbf_gym.scenarios.register` documents its arguments and checks them.
    """

    name: str
    draw: Draw
    shapes: int  # the number of shapes of each scene
    v_max: float | None = V_MAX
    draw_many: DrawMany | None = None  # a faster `draw` for N scenes, equal bit for bit
    floor: Callable[[], Floor] | None = None  # returns the map on which the shapes are
    hooks: Hooks = NO_HOOKS  # the family's own observation, reward and costs
    redraw: Redraw | None = None  # None where velocities never change

    def draw_scenes(self, generators: Sequence[np.random.Generator]) -> Scene:
        """Return N scenes, each drawn with one of the N generators.

        Raises:
            InvalidInputError: if a scene is not filled, or one of its numbers is out of range.
        """
        scenes = Scene.unfilled(len(generators), self.shapes)
        if self.draw_many is not None:
            self.draw_many(generators, scenes)
        else:
            for i, generator in enumerate(generators):
                self.draw(generator, scenes.one(i))
        check_filled(self.name, scenes)
        check_shapes(self.name, scenes)
        if self.floor is None:  # else the map has ranks, too
            check_ranks(self.name, scenes.ranks)
        return scenes

    def check_draw_many(self) -> None:
        """Refuse a `draw_many` that fails, or fills other scenes than `draw`."""
        try:
            many = self.draw_scenes([np.random.default_rng(seed) for seed in _COMPARED_SEEDS])
        except InvalidInputError:
            raise
        except Exception as error:  # of the user's function
            raise InvalidInputError(
                f"family {self.name!r}: draw_many: got {in_words(error)}, expected it to "
                "fill N scenes"
            ) from error
        for i, seed in enumerate(_COMPARED_SEEDS):
            single = Scene.unfilled(self.shapes)
            self.draw(np.random.default_rng(seed), single)
            for name, alone, among_many in zip(Scene._fields, single, many.one(i), strict=True):
                if alone.tobytes() != among_many.tobytes():
                    raise InvalidInputError(
                        f"family {self.name!r}: got other {name} from draw_many than from draw "
                        f"with the generator of seed {seed}, expected them equal bit for bit"
                    )

    def scenario(self, scene: Scene) -> Scenario:
        """Return one of its scenes as a `Scenario`."""
        return Scenario(
            name=self.name,
            barriers=barriers_of(scene),
            reference=PointReference(tuple(scene.goal.tolist())),
            start=tuple(scene.start.tolist()),
            task="reach",
            v_max=self.v_max,
            map=None if self.floor is None else self.floor(),
        )

    @property
    def identity(self) -> str:
        """The family's name in certificates, with a hash of the user's files."""
        return certificates.robot_of(self.name, self.files) if self.files else self.name

    @cached_property
    def files(self) -> list[Path]:
        """The user's files that decide the scenes; none for a shipped family."""
        file = inspect.getsourcefile(_function(self.draw))
        return [] if file is None or not Path(file).is_file() else sources.of_user(Path(file))

    def is_redefinition_of(self, other: "Family") -> bool:
        """Return whether both have the same `draw`, by its module and name.

        So a file that is loaded again may register its families again.
        """
        new, old = _function(self.draw), _function(other.draw)
        return (new.__module__, new.__qualname__) == (old.__module__, old.__qualname__)


def _function(draw: Any) -> Any:
    """Return a function, the one inside of a `partial`, or the class of any other callable."""
    if isinstance(draw, partial):
        return _function(draw.func)
    return draw if hasattr(draw, "__qualname__") else type(draw)
