"""Records that the compiled controller and Python share; fields as in `core/include/hcbf/`."""

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hcbf_gym.arrays import Records


def _fields(*fields: tuple[Any, ...]) -> np.dtype[np.void]:
    """Return a type whose records lie as the compiler lays out a struct."""
    return np.dtype(list(fields), align=True)


GAIT = _fields(
    ("period", "f8"), ("duty", "f8"), ("offsets", "f8", 4), ("rests", "?"), ("max_speed", "f8")
)
LEGS = _fields(("hip", "f8", (4, 3)), ("offset", "f8", 4), ("thigh", "f8"), ("calf", "f8"))
BODIES = _fields(
    ("mass", "f8", 13),
    ("com", "f8", (13, 3)),
    ("inertia", "f8", (13, 3, 3)),
    ("armature", "f8", 12),
    ("damping", "f8", 12),
    ("dry_friction", "f8", 12),
)
REFERENCE = _fields(
    ("position", "f8", 2),
    ("velocity", "f8", 2),
    ("acceleration", "f8", 2),
    ("yaw", "f8"),
    ("yaw_rate", "f8"),
    ("yaw_acceleration", "f8"),
    ("turning", "?"),
)
TARGETS = _fields(("stance", "?", 4), ("motion", "f8", (4, 3, 3)), ("foothold", "f8", (4, 2)))
"""What each foot shall do in the world: whether it carries, the rows position [m], velocity [m/s]
and acceleration [m/s²] of its motion, and where it shall land, or stands [m]."""

SETTINGS = _fields(
    ("timestep", "f8"),  # [s]
    ("friction", "f8"),  # µ of the friction pyramid
    ("stall_torque", "f8", 12),  # of the joints at rest [N·m]
    ("no_load_speed", "f8", 12),  # of the joints [rad/s]
    ("height", "f8"),  # of the trunk above the ground [m]
    ("max_speed", "f8"),  # cap on the reference's speed [m/s]
    ("follow_velocity", "?"),  # whether the heading does
    ("foot_radius", "f8"),  # [m]
    ("gait", GAIT),
    ("legs", LEGS),
    ("nominal", "f8", (4, 2)),  # footholds at rest in the trunk's axes [m]
    ("bodies", BODIES),
)
MEMORY = _fields(
    ("reference", REFERENCE),
    ("targets", TARGETS),
    ("clock", "f8"),  # of the gait [s]
    ("ground", "f8"),  # estimated height of the ground [m]
    ("lift", "f8"),  # learnt acceleration upwards that holds the trunk's height [m/s²]
)
WORKSPACE = _fields(
    ("H", "f8", (12, 12)),
    ("f", "f8", 12),
    ("A", "f8", (28, 12)),  # the first 12 rows are the torques
    ("lower", "f8", 40),
    ("upper", "f8", 40),
    ("torque_offset", "f8", 12),  # τ = A[:12] z + torque_offset [N·m]
    ("z", "f8", 12),
    ("feedforward", "f8", 12),  # τ of the latest solution [N·m]
    ("feedback", "f8", 12),  # of the joint impedance [N·m]
    ("limits", "f8", (2, 12)),  # least and largest torque of each joint [N·m]
    ("torque", "f8", 12),  # feedforward and feedback within the limits [N·m]
)


def attributes(array: Records) -> np.record:
    """Return the first record of an array as a view whose fields are its attributes."""
    record: np.record = array.view((np.record, array.dtype))[0]
    return record


def as_bytes(array: Records) -> NDArray[np.uint8]:
    """Return the bytes of a structured array as compiled code takes it; a view."""
    return array.view(np.uint8)


def packed(fields: tuple[object, ...], dtype: DTypeLike) -> NDArray[np.uint8]:
    """Return the bytes of one record with these fields."""
    return np.array([tuple(fields)], dtype=dtype).view(np.uint8)
