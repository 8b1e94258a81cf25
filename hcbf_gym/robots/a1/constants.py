"""Facts of the Unitree A1 that both the plant and the controller rely on."""

from pathlib import Path

import numpy as np

XML_FILE = Path(__file__).parent / "a1.xml"

TRUNK = "trunk"
LEGS = ("FR", "FL", "RR", "RL")
JOINTS = tuple(f"{leg}_{part}_joint" for leg in LEGS for part in ("hip", "thigh", "calf"))

CALF_LENGTH = 0.2  # [m] knee to the centre of the foot's sphere
FOOT_RADIUS = 0.02  # [m]
TORQUE_LIMIT = 33.5  # [N·m] every joint, Unitree's a1.urdf

HOME_HEIGHT = 0.27  # [m] trunk origin above the ground
HOME_JOINTS = np.tile([0.0, 0.9, -1.8], 4)  # [rad] feet on the ground at HOME_HEIGHT
HOME_JOINTS.setflags(write=False)
