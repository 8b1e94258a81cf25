"""What was certified of a plant: how often rank 1 is entered at most, with how much confidence."""

from hcbf_gym.certificates.certificate import BLOCK, Certificate, Stratum, block_digests
from hcbf_gym.certificates.declared import declared
from hcbf_gym.certificates.library import Nearest, load, nearest, shipped, table

__all__ = [
    "BLOCK",
    "Certificate",
    "Nearest",
    "Stratum",
    "block_digests",
    "declared",
    "load",
    "nearest",
    "shipped",
    "table",
]
