"""The robot's state as one vector, the input of the controller.

It is one vector because every argument of a call of compiled code takes time.
"""

from typing import Any

from hcbf_gym.arrays import Array, Mask

STATE_SIZE = 41


def _part(start: int, end: int, doc: str) -> Any:
    """Return a property that is a view of some entries of the vector."""
    return property(lambda self: self.vector[..., start:end], doc=doc)


class RobotState:
    """The robot's state, measured or estimated.

    Joints and feet are ordered FR, FL, RR, RL; the joints of a leg abad, hip, knee. The attributes
    are views of `vector`, along its last axis; the contacts are a copy.

    Attributes:
        vector: (41,) MuJoCo's qpos (19,) and qvel (18,) of the robot, then the contacts as 0 or 1.
    """

    __slots__ = ("vector",)

    def __init__(self, vector: Array) -> None:
        self.vector = vector

    position = _part(0, 3, "(3,) trunk origin in the world [m].")
    quaternion = _part(3, 7, "(4,) orientation of the trunk, w first.")
    joint_position = _part(7, 19, "(12,) [rad].")
    linear_velocity = _part(19, 22, "(3,) of the trunk origin, in the world's axes [m/s].")
    angular_velocity = _part(22, 25, "(3,) of the trunk, in its own axes [rad/s].")
    joint_velocity = _part(25, 37, "(12,) [rad/s].")

    @property
    def foot_contact(self) -> Mask:
        """(4,) whether each foot is in contact."""
        return self.vector[..., 37:] > 0.0
