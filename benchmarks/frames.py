"""How much of the processor's time a picture takes, beside a bare picture of the same size.

``python -m benchmarks.frames`` prints the median of five rounds, as a ratio within one run: what
the software renderer takes depends on the machine, and on what else wants it.
"""

import time
from collections.abc import Callable

import gymnasium as gym
import numpy as np
import tyro

from hcbf_gym.drawing.rendering import chase_camera
from hcbf_gym.envs.a1_regions import A1RegionsEnv

ROUNDS = 5
FRAMES = 40


def seconds_each(render: Callable[[], object], step: Callable[[], object]) -> float:
    """Seconds of processor time that one picture takes, of all threads: a median over ``FRAMES``.

    Args:
        render: draws one picture.
        step: what happens between two pictures; its time does not count.
    """
    times = []
    for _ in range(FRAMES):
        step()
        start = time.process_time()
        render()
        times.append(time.process_time() - start)
    return float(np.median(times))


def main(scenario: str = "random-clutter") -> None:
    """Print what a picture takes, what a bare one takes, and their ratio.

    Args:
        scenario: the scene that is drawn.
    """
    import mujoco  # after this package, which chooses how MuJoCo renders

    env = gym.make("HCBF-A1Regions-v0", scenario=scenario, render_mode="rgb_array")
    env.reset(seed=1)
    frame = np.asarray(env.render())
    a1 = env.unwrapped
    assert isinstance(a1, A1RegionsEnv)
    bare = mujoco.Renderer(a1.simulation.model, *frame.shape[:2])

    def step() -> None:
        env.step(np.array([0.5, 0.0]))

    def draw() -> None:
        bare.update_scene(a1.simulation.data, camera=chase_camera(a1.simulation.data))
        bare.render()

    pairs = [(seconds_each(env.render, step), seconds_each(draw, step)) for _ in range(ROUNDS)]
    bare.close()
    env.close()
    ours, theirs = np.median(pairs, axis=0)
    ratio = np.median([a / b for a, b in pairs])
    print(f"{ours * 1e3:.1f} ms a picture, {theirs * 1e3:.1f} ms a bare one: × {ratio:.2f}")


if __name__ == "__main__":
    tyro.cli(main)
