"""The paper's scenes (section IV), with the corrections that its figures require."""

from dataclasses import replace

import numpy as np

from hcbf_gym.barriers import Barrier, Disc, HalfPlane
from hcbf_gym.scenarios.references import BezierReference
from hcbf_gym.scenarios.scenario import BoxObstacle, Scenario

EAST_WALL = HalfPlane("h1 east wall", 1, normal=(-1.0, 0.0), offset=-0.2)
"""h₁ = 0.2 − p_x has the sign that the figures require; the printed one forbids the goal."""

EAST_WALL_AS_PRINTED = HalfPlane("h1 east wall", 1, normal=(1.0, 0.0), offset=-0.2)
"""h₁ = p_x + 0.2, as printed."""

SOUTH_WALL = HalfPlane("h2 south wall", 1, normal=(0.0, 1.0), offset=-0.2)
"""h₂ = p_y + 0.2."""


def simulation() -> Scenario:
    """Return section IV-A with the corrected sign of h₁: h₁, h₂, h₃ strict, h₄ relaxed."""
    return Scenario(
        name="paper-simulation",
        barriers=(
            EAST_WALL,
            SOUTH_WALL,
            Disc("h3 region 1", 1, center=(-1.0, 5.5), radius=4.0),
            Disc("h4 region 2", 2, center=(-1.0, 4.5), radius=5.0),
        ),
        reference=BezierReference(((0.0, 0.0), (-12.0, 10.0))),
    )


def simulation_as_printed() -> Scenario:
    """Return section IV-A with the printed sign of h₁, which forbids the goal."""
    scenario = simulation()
    return replace(
        scenario,
        name="paper-simulation-as-printed",
        barriers=(EAST_WALL_AS_PRINTED, *scenario.barriers[1:]),
    )


def four_levels() -> Scenario:
    """Return section IV-A with one priority per barrier, for the programs of section III-D."""
    scenario = simulation()
    ranked: tuple[Barrier, ...] = tuple(
        replace(barrier, priority=k) for k, barrier in enumerate(scenario.barriers, start=1)
    )
    return replace(scenario, name="paper-four-levels", barriers=ranked)


def experiment() -> Scenario:
    """Return section IV-C: heavy boxes inside region 1, a light box at region 2's centre.

    The paper states only "a continuous trajectory". This one goes through the corridor between
    region 1 and the east wall.
    """
    region1 = Disc("h3 region 1", 1, center=(-1.7, 1.5), radius=1.7)
    region2 = Disc("h4 region 2", 2, center=(-0.35, 1.8), radius=1.34)
    return Scenario(
        name="paper-experiment",
        barriers=(EAST_WALL, SOUTH_WALL, region1, region2),
        reference=BezierReference(((0.0, 0.0), (0.0, 2.5), (-0.2, 4.0), (-4.0, 3.34))),
        obstacles=(
            BoxObstacle("region 2 box", center=region2.center, size=(0.4, 0.4, 0.3), mass=1.0),
            *_ring_of_boxes(region1, gap=region2),
        ),
    )


def experiment_straight() -> Scenario:
    """Return section IV-C on a straight reference, on which CBF-QPs deadlock before region 1."""
    return replace(
        experiment(),
        name="paper-experiment-straight",
        reference=BezierReference(((0.0, 0.0), (-4.0, 3.34))),
    )


def _ring_of_boxes(region: Disc, gap: Disc) -> tuple[BoxObstacle, ...]:
    """Return heavy boxes in a ring, their faces half a robot's width inside a region's edge.

    They leave a gap towards the light box at the other region's centre.
    """
    center = np.array(region.center)
    side = 0.4
    radius = region.radius - 0.35 - side / 2
    toward_gap = np.array(gap.center) - center
    gap_angle = float(np.arctan2(toward_gap[1], toward_gap[0]))
    angles = gap_angle + np.linspace(np.pi / 6, 2 * np.pi - np.pi / 6, 11)
    return tuple(
        BoxObstacle(
            f"region 1 box {k}",
            center=tuple(center + radius * np.array([np.cos(angle), np.sin(angle)])),
            size=(side, side, 0.5),
            yaw=float(angle),
        )
        for k, angle in enumerate(angles)
    )
