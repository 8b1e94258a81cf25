"""The A1's file and the names in it; everything else about a robot is read from its file."""

from pathlib import Path

XML_FILE = Path(__file__).parent / "a1.xml"

TRUNK = "trunk"
LEGS = ("FR", "FL", "RR", "RL")
JOINTS = tuple(f"{leg}_{part}_joint" for leg in LEGS for part in ("hip", "thigh", "calf"))
