"""Families of random scenes: a function that fills the arrays of one scene, and its name."""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym import certificates, sources
from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, shown
from hcbf_gym.scenarios.floor import Floor
from hcbf_gym.scenarios.hooks import NO_HOOKS, Hooks
from hcbf_gym.scenarios.references import PointReference
from hcbf_gym.scenarios.scenario import Scenario
from hcbf_gym.scenarios.scene import ASPECT, HALF_PLANE, RADIUS, SHAPE, Scene, X, Y, barrier

V_MAX = 1.0
"""Strict cap on the speed [m/s] of the shipped families, low enough for the A1 to follow."""

_TRIED = range(8)
"""Seeds on which `draw_many` is compared with `draw`."""


Draw = Callable[[np.random.Generator, Scene], None]
DrawMany = Callable[[Sequence[np.random.Generator], Scene], None]


@dataclass(frozen=True)
class Family:
    """Random scenes of one kind; see `register`."""

    name: str
    draw: Draw
    shapes: int
    v_max: float | None = V_MAX
    draw_many: DrawMany | None = None
    floor: Callable[[], Floor] | None = None
    hooks: Hooks = NO_HOOKS
    redraw: Callable[[np.random.Generator, Array], None] | None = None

    def drawn(self, generators: Sequence[np.random.Generator]) -> Scene:
        """Return the N scenes that the generators decide.

        Raises:
            InvalidInputError: if a scene is not filled, or a number of it is out of range.
        """
        scenes = Scene.unfilled(len(generators), self.shapes)
        if self.draw_many is not None:
            self.draw_many(generators, scenes)
        else:
            for i, generator in enumerate(generators):
                self.draw(generator, scenes.one(i))
        self._check(scenes)
        return scenes

    def check_many(self) -> None:
        """Refuse a `draw_many` that fails, or fills other scenes than `draw`."""
        try:
            many = self.drawn([np.random.default_rng(seed) for seed in _TRIED])
        except InvalidInputError:
            raise
        except Exception as error:  # of the user's function
            raise InvalidInputError(
                f"family {self.name!r}: draw_many: got {error!r}, expected it to fill N scenes"
            ) from error
        for i, seed in enumerate(_TRIED):
            single = Scene.unfilled(self.shapes)
            self.draw(np.random.default_rng(seed), single)
            for name, a, b in zip(Scene._fields, single, many.one(i), strict=True):
                if a.tobytes() != b.tobytes():
                    raise InvalidInputError(
                        f"family {self.name!r}: got other {name} from draw_many than from draw "
                        f"with the generator of seed {seed}, expected them equal bit for bit"
                    )

    def _check(self, scenes: Scene) -> None:
        """Refuse scenes (N, …) that are not filled or out of range."""
        for name, array in zip(Scene._fields, scenes, strict=True):
            if not np.isfinite(array).all():
                raise InvalidInputError(
                    f"family {self.name!r}: got {shown(array)} for the {name}, expected finite "
                    "numbers; draw(generator, scene) must fill all of them"
                )
        shapes, ranks = scenes.shapes, scenes.ranks
        code, radius, aspect = shapes[..., SHAPE], shapes[..., RADIUS], shapes[..., ASPECT]
        is_wall, known = code == HALF_PLANE, (code == np.floor(code)) & (code >= HALF_PLANE)
        length = np.hypot(shapes[..., X], shapes[..., Y])
        rests = (scenes.velocities == 0.0).all(axis=-1)
        sound = np.where(
            is_wall, rests & (np.abs(length - 1.0) < 1e-9), (radius > 0.0) & (aspect > 0.0)
        )
        bad = ~(known & (code <= 8) & sound)
        if bad.any():
            raise InvalidInputError(
                f"family {self.name!r}: got the shape {shapes[bad][0].tolist()}, expected a code "
                f"from {HALF_PLANE} to 8 with a positive radius, or a half plane's unit normal and "
                "no velocity"
            )
        if self.floor is None:
            last = ranks.max(axis=1, initial=0)
            every = np.arange(1, last.max(initial=0) + 1)
            present = (ranks[:, None] == every[:, None]).any(axis=2) | (every > last[:, None])
            if not (present.all() and (ranks >= 1).all()):
                worst = ranks[(ranks < 1).any(axis=1) | ~present.all(axis=1)][0]
                raise InvalidInputError(
                    f"family {self.name!r}: got the ranks {worst.tolist()}, expected 1, 2, … "
                    "without a gap"
                )

    def scenario(self, scene: Scene) -> Scenario:
        """Return one of its scenes as a `Scenario`."""
        walls, barriers = 0, []
        for k, row in enumerate(scene.shapes.tolist()):
            is_wall = row[SHAPE] == HALF_PLANE
            walls += is_wall
            name = f"wall {walls}" if is_wall else f"region {k + 1 - walls}"
            velocity = scene.velocities[k].tolist()
            barriers.append(barrier(name, int(scene.ranks[k]), row, velocity))
        return Scenario(
            name=self.name,
            barriers=tuple(barriers),
            reference=PointReference(tuple(scene.goal.tolist())),
            start=tuple(scene.start.tolist()),
            task="reach",
            v_max=self.v_max,
            map=None if self.floor is None else self.floor(),
        )

    @property
    def identity(self) -> str:
        """Its name in certificates, with a hash of the user's files."""
        return certificates.robot_of(self.name, self.files) if self.files else self.name

    @cached_property
    def files(self) -> list[Path]:
        """The user's files that decide its scenes; none for a shipped one."""
        file = inspect.getsourcefile(_function(self.draw))
        return [] if file is None or not Path(file).is_file() else sources.of_user(Path(file))

    def is_from_where(self, other: "Family") -> bool:
        """Return whether another family's function is this one, or a newer version of it."""
        one, another = _function(self.draw), _function(other.draw)
        return (one.__module__, one.__qualname__) == (another.__module__, another.__qualname__)


def _function(draw: Any) -> Any:
    """Return the function that a partial one calls, or the class of an object that is called."""
    if isinstance(draw, partial):
        return _function(draw.func)
    return draw if hasattr(draw, "__qualname__") else type(draw)
