"""What was certified of a plant: how often rank 1 is entered at most, with how much confidence."""

from hcbf_gym.certificates.certificate import Certificate, first_seed
from hcbf_gym.certificates.declared import declared, robot_of
from hcbf_gym.certificates.judge import Judged, judge
from hcbf_gym.certificates.library import (
    NearestCertificate,
    at_least,
    file_of,
    judged_by,
    load,
    nearest,
    shipped,
    stale,
    stale_since,
    tested,
)
from hcbf_gym.certificates.parts import BLOCK, Block, Shown, Stratum

__all__ = [
    "BLOCK",
    "Block",
    "Certificate",
    "Judged",
    "NearestCertificate",
    "Shown",
    "Stratum",
    "at_least",
    "declared",
    "file_of",
    "first_seed",
    "judge",
    "judged_by",
    "load",
    "nearest",
    "robot_of",
    "shipped",
    "stale",
    "stale_since",
    "tested",
]
