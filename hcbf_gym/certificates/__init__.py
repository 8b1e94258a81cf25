"""Certificates: bounds, with their confidence, on the probability that a plant enters rank 1."""

from hcbf_gym.certificates.certificate import Certificate, first_seed
from hcbf_gym.certificates.declared import declared, identified, is_of_package, robot_of, same
from hcbf_gym.certificates.judge import Judged, judge
from hcbf_gym.certificates.library import (
    NearestCertificate,
    at_least,
    file_of,
    judged_by,
    load,
    nearest,
    of_another_version,
    shipped,
    tested,
    warn_of_version,
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
    "identified",
    "is_of_package",
    "judge",
    "judged_by",
    "load",
    "nearest",
    "of_another_version",
    "robot_of",
    "same",
    "shipped",
    "tested",
    "warn_of_version",
]
