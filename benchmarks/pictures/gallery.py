"""Film the loops of the site: robots in each kind of scene, twice as fast, as small WebP files.

Each loop ends with a line: how near the robot came to rank 1, and the size of the file.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from hcbf_gym import wrappers
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import choose
from hcbf_gym.evaluation.attacked import policy_of
from hcbf_gym.evaluation.episode import samples

STEPS = 10  # Control steps between two pictures
SPEED = 2.0  # Of the loop, relative to the robot
SIZE = (400, 300)  # Of a picture [pixels]
QUALITY = 35  # Of the WebP file, of 100
WALKER = "hcbf_robots:HCBF-WalkerRegions-v0"


class Loop(NamedTuple):
    """One film."""

    scenario: str  # its name
    seed: int  # of the environment and of the attack
    policy: str  # "pd", or the name of an attack of `evaluation.attacks`
    seconds: float  # how long it lasts at most [s]
    filter_options: Mapping[str, Any] | None  # arguments of `SafetyFilter`; None for no filter
    env_options: Mapping[str, Any] = {}  # further arguments of the environment
    env: str = "HCBF-A1Regions-v0"


def _attacked(robot: str, seed: int, attack: str = "edge") -> Loop:
    """Return the film of a walker under attack."""
    options = {"robot": robot, "body": "footprint"}
    return Loop("random", seed, attack, 14.0, LEX, options, WALKER)


LEX: dict[str, Any] = {"program": "lex-cbf-qp"}
H: dict[str, Any] = {"program": "h-cbf-qp", "delta_gamma": 1.3}
GUIDED = LEX | {"guidance": "geodesic"}
CART = {"robot": "cart", "body": "footprint"}
LOOPS = {  # The loops of the site by name
    "attack": Loop("random", 1, "edge", 14.0, LEX, {"body": "footprint"}),
    "unfiltered": Loop("paper-simulation", 0, "pd", 18.0, None),
    "paper-simulation": Loop("paper-simulation", 0, "pd", 18.0, H | {"gamma0": 5.0}),
    "paper-experiment": Loop("paper-experiment", 0, "pd", 18.0, H | {"gamma0": 0.5}),
    "random-clutter": Loop("random-clutter", 1, "pd", 18.0, GUIDED),
    "random-traps": Loop("random-traps", 2, "pd", 20.0, GUIDED),
    "random-moving": Loop("random-moving", 5, "pd", 14.0, LEX),
    "rough": Loop("random", 7, "pd", 14.0, LEX, {"terrain": "rough"}),
    "cart": _attacked("cart", 1),
    "holonomic-cart": _attacked("holonomic-cart", 1),
    "map-flat": Loop("map-flat", 2, "edge", 20.0, GUIDED, {"body": "footprint"}),
    "map-office": Loop("map-office", 1, "nearest", 24.0, GUIDED, CART, WALKER),
}
FOREIGN = {  # The loops of robots that are not the project's own: their contracts read `$HCBF_DATA`
    name: _attacked(f"tests/robots/contracts/{name}.json", 1)
    for name in ("go1", "berkeley_humanoid")
}


@dataclass(frozen=True)
class Args:
    """Which loops to film."""

    loops: tuple[str, ...] = field(default_factory=lambda: tuple(LOOPS))
    """Their names; of robots that are not the project's own only by name."""
    size: tuple[int, int] = SIZE
    """Of a picture [pixels]."""
    output: Path = Path("docs/images/gallery")
    """Folder for the files."""


def main(args: Args) -> None:
    """Film the loops one after the other."""
    chosen = {name: choose("loop", name, LOOPS | FOREIGN) for name in args.loops}
    args.output.mkdir(parents=True, exist_ok=True)
    for name, loop in chosen.items():
        pictures, least = film(loop, args.size)
        path = args.output / f"{name}.webp"
        save(path, pictures)
        size = path.stat().st_size / 1024
        print(f"{name}: {len(pictures)} pictures, least h of rank 1 {least:+.3f} m, {size:.0f} KiB")


def film(loop: Loop, size: tuple[int, int] = SIZE) -> tuple[list[Image.Image], float]:
    """Return the pictures of a loop, and the least h of its strict regions and walls [m]."""
    options: Any = {"scenario": loop.scenario, "render_mode": "rgb_array"} | dict(loop.env_options)
    env: gym.Env = gym.make(loop.env, **options)
    if loop.filter_options is not None:
        env = wrappers.SafetyFilter(env, **loop.filter_options)
    inner: Any = env.unwrapped
    pictures, least = [], np.inf
    try:
        walk = samples(env, policy_of(loop.policy, env, loop.seed), loop.seed)
        next(walk)
        strict = [k for k, b in enumerate(inner.barriers) if b.priority == 1 and b.reads_position]
        for step in range(round(loop.seconds / CONTROL_DT)):
            sample = next(walk)
            info = sample.info
            least = min(least, _height(info, strict, "min_"))
            if step % STEPS == 0:
                now = _height(info, strict)
                near = f"distance to rank 1: {now:+.2f} m", "#b2182b" if now < 0.0 else "#222222"
                clock = f"{inner.time:4.1f} s, {SPEED:.0f} x", "#222222"
                frame = np.asarray(env.render())
                pictures.append(captioned(frame, size, 14, (6, *near), (-6, *clock)))
            if sample.over:
                break
    finally:
        env.close()
    return pictures, least


def save(
    path: Path, pictures: list[Image.Image], steps: int = STEPS, quality: int = QUALITY
) -> None:
    """Write pictures that are some control steps apart as a WebP file, played without end."""
    pause = round(1000 * steps * CONTROL_DT / SPEED)  # [ms]
    pictures[0].save(
        path,
        save_all=True,
        append_images=pictures[1:],
        duration=[*[pause] * (len(pictures) - 1), 1500],
        loop=0,
        quality=quality,
        method=4,
    )


def _height(info: dict[str, Any], strict: list[int], least: str = "") -> float:
    """Return the least of the strict h [m], of the whole robot where that must stay outside."""
    heights = info.get(f"{least}body_h", info[f"{least}h"])
    return float(np.asarray(heights)[strict].min())


def captioned(
    frame: NDArray[np.uint8], size: tuple[int, int], letters: int, *texts: tuple[int, str, str]
) -> Image.Image:
    """Return a frame of a size [pixels] over texts (x, text, colour); x < 0 is from the right."""
    picture = Image.new("RGB", (size[0], size[1] + letters + letters // 2), "white")
    picture.paste(Image.fromarray(frame).resize(size, Image.Resampling.LANCZOS))
    draw, font = ImageDraw.Draw(picture), ImageFont.load_default(size=letters)
    for x, text, color in texts:
        at = (x % size[0], size[1] + 3)
        draw.text(at, text, font=font, fill=color, anchor="ra" if x < 0 else None)
    return picture
