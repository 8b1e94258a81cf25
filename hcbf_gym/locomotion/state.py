"""What the controller is told about the robot: the way in, and nothing else."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class RobotState(NamedTuple):
    """The estimate of the robot's state that sensors and an estimator would give.

    Joints and feet are ordered FR, FL, RR, RL; the joints of a leg abad, hip, knee.

    Attributes:
        position: (3,) trunk origin in the world [m].
        quaternion: (4,) orientation of the trunk, w first.
        linear_velocity: (3,) of the trunk origin, in the world's axes [m/s].
        angular_velocity: (3,) of the trunk, in its own axes [rad/s].
        joint_position: (12,) [rad].
        joint_velocity: (12,) [rad/s].
        foot_contact: (4,) bool, whether the foot touches something.
    """

    position: Array
    quaternion: Array
    linear_velocity: Array
    angular_velocity: Array
    joint_position: Array
    joint_velocity: Array
    foot_contact: NDArray[np.bool_]
