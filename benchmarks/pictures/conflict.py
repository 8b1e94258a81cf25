"""Film a conflict of two ranks, and draw the one of `docs/programs.md`: pool and lawn.

A sprinkler of rank 2 sweeps over the place at which a robot rests. Behind it is a pool of rank 1.
The robot steps aside up to the pool; there rank 2 is relaxed, so that rank 1 holds.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from PIL import Image

from benchmarks.pictures import canvas
from benchmarks.pictures.canvas import plt
from benchmarks.pictures.gallery import captioned, save
from hcbf_gym import policies, wrappers
from hcbf_gym.drawing.palette import priority_color
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation.episode import samples

SCENE: dict[str, Any] = {
    "name": "pool and sprinkler",
    "barriers": [
        {
            "kind": "convex-polygon",
            "name": "pool",
            "priority": 1,
            "vertices": [[-1.6, -2.6], [1.6, -2.6], [1.6, -1.15], [-1.6, -1.15]],
        },
        {
            "kind": "capsule",
            "name": "sprinkler",
            "priority": 2,
            "start": [-1.3, 2.1],
            "end": [1.3, 2.1],
            "radius": 0.3,
            "velocity": [0.0, -0.3],
        },
    ],
    "reference": {"kind": "point", "goal": [0.0, 0.0]},
    "v_max": 1.0,
}
SECONDS = 15.0
STEPS = 8  # Control steps between two pictures
SIZE = (720, 480)  # Of a picture [pixels]
LARGEST = 2_000_000  # Of the film [bytes]


@dataclass(frozen=True)
class Args:
    """Where film and picture go."""

    output: Path = Path("docs/images")
    """Folder for conflict.webp and pool_and_lawn.png."""
    film: bool = True
    """Whether the film is made; it needs OpenGL and a minute."""


def main(args: Args) -> None:
    """Draw the picture, then film."""
    draw(args.output / "pool_and_lawn.png")
    path, pictures = args.output / "conflict.webp", film() if args.film else []
    for quality in range(90, 24, -5) if pictures else ():
        save(path, pictures, STEPS, quality)
        if path.stat().st_size <= LARGEST:
            print(f"{path}: {len(pictures)} pictures, quality {quality}")
            break


def film() -> list[Image.Image]:
    """Return the pictures; print what each rank had at the least."""
    env: gym.Env = gym.make("HCBF-A1Regions-v0", scenario=SCENE, body="footprint")
    env = wrappers.SafetyFilter(env, "lex-cbf-qp")
    inner: Any = env.unwrapped
    pictures, least, paid = [], np.full(2, np.inf), 0
    walk = samples(env, policies.PDTracker.for_env(env), 0)
    next(walk)
    model, data = inner.drive.simulation.model, inner.drive.simulation.data
    model.vis.global_.offwidth, model.vis.global_.offheight = SIZE
    model.vis.quality.numslices, model.vis.quality.offsamples = 56, 8
    renderer = mujoco.Renderer(model, SIZE[1], SIZE[0], max_geom=2000)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = 0.0, -0.25, 0.15
    camera.distance, camera.azimuth, camera.elevation = 3.7, 115.0, -36.0
    place = data.xpos[1, :2].copy()
    for step in range(round(SECONDS / CONTROL_DT)):
        sample = next(walk)
        h = np.asarray(sample.info["body_h"])[:2]
        relaxed = sample.info["safety_filter"]["slack"][1] > 1e-6 or h[1] < 0.0
        least, paid = np.minimum(least, h), paid + relaxed
        if step % STEPS == 0:
            renderer.update_scene(data, camera=camera)
            forward = data.xmat[1].reshape(3, 3)[:, 0]
            yaw = float(np.arctan2(forward[1], forward[0]))
            place = data.xpos[1, :2].copy()
            inner.artist.draw(renderer.scene, inner.scenario, inner.time, place, yaw)
            pool = f"pool, rank 1: {h[0]:+.2f} m, holds", priority_color(1)
            sprinkler = f"sprinkler, rank 2: {h[1]:+.2f} m, {'relaxed' if relaxed else 'holds'}"
            texts = (8, *pool), (330, sprinkler, "#8a5a00")
            pictures.append(captioned(renderer.render(), SIZE, 20, *texts))
        if sample.over:
            break
    env.close()
    print(f"least h: pool {least[0]:+.3f} m, sprinkler {least[1]:+.3f} m", end="; ")
    print(f"rank 2 relaxed for {paid * CONTROL_DT:.1f} s; the robot ends at {place.round(2)}")
    return pictures


def draw(path: Path) -> None:
    """Draw pool, lawn and robot, and beside them the inputs that each rank permits."""
    red, orange = priority_color(1), priority_color(2)
    figure, (ground, inputs) = plt.subplots(1, 2, figsize=(8.8, 3.3), layout="constrained")
    ground.axvspan(-0.6, 2.0, color=orange, alpha=0.25)
    ground.axvspan(1.0, 3.0, color=red, alpha=0.35)
    ground.plot(0.5, 0.0, "o", color="0.15", markersize=11)
    ground.annotate("robot", (0.5, 0.0), (0.5, -0.35), ha="center")
    ground.annotate(
        "", (0.5, 0.45), (0.5, 0.05), arrowprops={"arrowstyle": "->", "color": "0.4", "lw": 2}
    )
    ground.text(0.55, 0.47, "u*", color="0.4")
    ground.text(-0.5, 0.8, "lawn, rank 2: leave it", color="#8a5a00")
    ground.text(1.08, -0.85, "pool, rank 1: do not enter", color=red)
    ground.set(xlim=(-0.6, 3.0), ylim=(-1.0, 1.0), xlabel="x [m]", ylabel="y [m]")
    ground.set_title("The shortest path off the lawn leads through the pool", fontsize=10)

    inputs.axvspan(1.0, 5.0, color=red, alpha=0.25)
    inputs.axvspan(-1.0, 3.0, color=orange, alpha=0.18)
    inputs.axvline(1.0, color=red, linewidth=2)
    inputs.axvline(3.0, color=orange, linewidth=2)
    inputs.plot(0.0, 0.5, "o", color="0.4", markersize=9)
    inputs.annotate("u*", (0.0, 0.5), (-0.1, 0.75), color="0.4", ha="right")
    inputs.plot(1.0, 0.5, "*", color="#009e73", markersize=18)
    inputs.annotate("u: rank 1 holds,\nrank 2 lacks 2 m/s²", (1.0, 0.5), (1.15, -0.9))
    inputs.annotate(
        "", (3.0, 0.5), (1.15, 0.5), arrowprops={"arrowstyle": "<->", "color": "#8a5a00"}
    )
    inputs.text(0.95, 1.55, "pool permits", color=red, ha="right")
    inputs.text(3.05, 1.55, "lawn requires", color="#8a5a00")
    inputs.set(xlim=(-1.0, 5.0), ylim=(-1.2, 2.0), xlabel="$u_x$ [m/s²]", ylabel="$u_y$ [m/s²]")
    inputs.set_title("No input meets both rows", fontsize=10)
    canvas.save(figure, path, 110)
