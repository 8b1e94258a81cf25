"""What was certified of a plant: how often rank 1 is entered at most, with how much confidence."""

from hcbf_gym.certificates.certificate import BLOCK, Certificate, Stratum, block_digests
from hcbf_gym.certificates.declared import declared, robot_of
from hcbf_gym.certificates.library import Nearest, at_least, load, nearest, shipped, table

__all__ = [
    "BLOCK",
    "Certificate",
    "Nearest",
    "Stratum",
    "at_least",
    "block_digests",
    "declared",
    "load",
    "nearest",
    "robot_of",
    "shipped",
    "table",
]
