"""Pictures: ranks distinguishable by anyone, regions filled, motion seen, frames cheap."""

import itertools

import gymnasium as gym
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from hcbf_gym import scenarios
from hcbf_gym.drawing import palette
from hcbf_gym.drawing.scene_artist import SceneArtist

# How dichromats see linear RGB: Machado, Oliveira and Fernandes, IEEE TVCG 15(6), 2009, table 1.
SEEN_BY = {
    "all": np.eye(3),
    "protanopes": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopes": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
}
FAR = {"kind": "disc", "name": "far", "priority": 1, "center": [-30.0, 0.0], "radius": 1.0}
TRIANGLE = {"kind": "convex-polygon", "vertices": [[0.6, -0.8], [2.2, -0.8], [1.4, 1.0]]}


def lab(color, seen):
    """CIE L*a*b* of a colour under D65."""
    srgb = np.array(to_rgb(color))
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    xyz = to_xyz @ (seen @ linear).clip(0.0, 1.0) / [0.9505, 1.0, 1.089]
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("who", SEEN_BY)
@pytest.mark.parametrize("shown", [str, palette.paler], ids=["lines", "areas"])
def test_ranks_are_distinguishable(who, shown):
    colors = [lab(shown(color), SEEN_BY[who]) for color in palette.PRIORITY_COLORS]
    apart = [np.linalg.norm(a - b) for a, b in itertools.combinations(colors, 2)]
    assert min(apart) > 20.0  # 2.3 is just noticeable


def picture_env(priority):
    scene = scenarios.make("random").to_dict() | {
        "name": "triangle",
        "barriers": [FAR, TRIANGLE | {"name": "triangle", "priority": priority}],
        "start": [0.0, 0.0],
        "reference": {"kind": "bezier", "points": [[0, 0], [3, 0]], "duration": 9, "ramp": 1.0},
    }
    return gym.make("HCBF-A1Regions-v0", scenario=scene, render_mode="rgb_array")


def share_of(frame, color):
    """The part of a picture whose hue is nearer to a rank's than to grey, in any light."""
    toward = np.array(to_rgb(color)) - np.mean(to_rgb(color))
    pixels = frame / 255 - (frame / 255).mean(axis=2, keepdims=True)
    along = pixels @ toward / np.linalg.norm(toward)
    return np.mean(along > 0.9 * np.linalg.norm(pixels, axis=2).clip(0.1))


@pytest.mark.physics
@pytest.mark.usefixtures("opengl")
def test_a_polygon_is_filled_in_its_ranks_colour():
    for priority in (1, 2):
        env = picture_env(priority)
        env.reset(seed=0)
        shares = [share_of(env.render(), palette.priority_color(p)) for p in (1, 2)]
        env.close()
        assert shares[priority - 1] > 0.03
        assert shares[2 - priority] < 0.01


def test_of_a_long_way_the_end_is_drawn():
    import mujoco  # after this package, which chooses how MuJoCo renders

    scene = mujoco.MjvScene(mujoco.MjModel.from_xml_string("<mujoco/>"), maxgeom=2000)
    artist, scenario = SceneArtist(), scenarios.make("random")
    for k in range(5000):
        artist.walk(np.array([0.1 * k, 0.0]))
    artist.draw(scene, scenario, 0.0, np.array([499.95, 0.0]), 0.0)
    assert scene.ngeom < 2000
    assert scene.geoms[scene.ngeom - 1].pos[0] == pytest.approx(499.9, abs=0.1)
