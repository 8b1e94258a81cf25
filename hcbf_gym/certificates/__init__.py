"""What was certified of a plant: how often rank 1 is entered at most, with how much confidence."""

from hcbf_gym.certificates.certificate import Certificate, first_seed
from hcbf_gym.certificates.declared import declared, robot_of
from hcbf_gym.certificates.judge import Judged, judge
from hcbf_gym.certificates.library import (
    Nearest,
    at_least,
    covered_table,
    load,
    nearest,
    shipped,
    speak,
    stale,
    stale_since,
    table,
    tested,
)
from hcbf_gym.certificates.parts import BLOCK, Block, Shown, Stratum

__all__ = [
    "BLOCK",
    "Block",
    "Certificate",
    "Judged",
    "Nearest",
    "Shown",
    "Stratum",
    "at_least",
    "covered_table",
    "declared",
    "first_seed",
    "judge",
    "load",
    "nearest",
    "robot_of",
    "shipped",
    "speak",
    "stale",
    "stale_since",
    "table",
    "tested",
]
