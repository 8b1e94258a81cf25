"""The controller's input: the state of the robot as one vector.

Entering compiled code costs time per argument.
"""

from hcbf_gym.arrays import Array, Mask

STATE_SIZE = 41


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

    @property
    def position(self) -> Array:
        """(3,) trunk origin in the world [m]."""
        return self.vector[..., :3]

    @property
    def quaternion(self) -> Array:
        """(4,) orientation of the trunk, w first."""
        return self.vector[..., 3:7]

    @property
    def joint_position(self) -> Array:
        """(12,) [rad]."""
        return self.vector[..., 7:19]

    @property
    def linear_velocity(self) -> Array:
        """(3,) of the trunk origin, in the world's axes [m/s]."""
        return self.vector[..., 19:22]

    @property
    def angular_velocity(self) -> Array:
        """(3,) of the trunk, in its own axes [rad/s]."""
        return self.vector[..., 22:25]

    @property
    def joint_velocity(self) -> Array:
        """(12,) [rad/s]."""
        return self.vector[..., 25:37]

    @property
    def foot_contact(self) -> Mask:
        """(4,) bool, whether the foot touches something."""
        return self.vector[..., 37:] > 0.0
