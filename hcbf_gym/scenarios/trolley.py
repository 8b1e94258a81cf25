"""The scene "trolley": a conflict between a trolley, a gate behind the robot, and a lawn."""

from hcbf_gym.barriers import Disc, HalfPlane
from hcbf_gym.scenarios.references import BezierReference
from hcbf_gym.scenarios.scenario import Scenario


def scenario() -> Scenario:
    """Return a lane in which a trolley drives the robot back to a gate; only the lawn is left.

    Trolley, wall and gate are of rank 1, the lawn is of rank 2. The robot enters the lawn only when
    the gate ends its retreat.
    """
    return Scenario(
        name="trolley",
        barriers=(
            Disc("trolley", 1, center=(4.0, -0.15), radius=1.0, velocity=(-0.4, 0.0)),
            HalfPlane("gate", 1, normal=(1.0, 0.0), offset=-0.6),
            HalfPlane("wall", 1, normal=(0.0, 1.0), offset=-0.8),
            HalfPlane("lawn", 2, normal=(0.0, -1.0), offset=-0.6),
        ),
        reference=BezierReference(((0.0, 0.0), (4.5, 0.0))),
        v_max=1.0,
    )
