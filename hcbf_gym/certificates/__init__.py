"""What was certified of a plant: how often rank 1 is entered at most, with how much confidence."""

from hcbf_gym.certificates.certificate import Certificate, first_seed
from hcbf_gym.certificates.declared import declared, robot_of
from hcbf_gym.certificates.library import (
    Nearest,
    at_least,
    load,
    nearest,
    shipped,
    stale,
    stale_shipped,
    stale_since,
    table,
)
from hcbf_gym.certificates.parts import BLOCK, Block, Shown, Stratum

__all__ = [
    "BLOCK",
    "Block",
    "Certificate",
    "Nearest",
    "Shown",
    "Stratum",
    "at_least",
    "declared",
    "first_seed",
    "load",
    "nearest",
    "robot_of",
    "shipped",
    "stale",
    "stale_shipped",
    "stale_since",
    "table",
]
