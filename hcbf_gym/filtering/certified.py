"""A plant under a certificate: its margins are what rows reserve, and `covered` follows it."""

import warnings
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import certificates
from hcbf_gym.certificates import Certificate
from hcbf_gym.errors import CoverageWarning
from hcbf_gym.models.plant import Coverage, Plant, read


class Earned(NamedTuple):
    """`covered` of a plant whose own episodes showed it, so that no sufficient condition is needed.

    Attributes:
        certificate: that was earned.
        plant: as it declares itself.
    """

    certificate: Certificate
    plant: Plant

    def __call__(self, env: Any, observation: Any, info: dict[str, Any]) -> Any:
        """Return a `Coverage`, or (N,) of a vector environment."""
        said = dict(read(self.plant.declared, env, observation, info))
        scenes = said.get("scene")
        if not isinstance(scenes, list):
            return self.certificate.covers(said)
        known = {scene: self.certificate.covers(said | {"scene": scene}) for scene in set(scenes)}
        return np.array([known[scene] for scene in scenes])


def certified(plant: Plant, certificate: Certificate, env: Any) -> Plant:
    """Return the plant as a certificate speaks of it; warn where it speaks of another one.

    Margins that follow from a law of the plant's own stay the plant's, and so does what its
    body reaches.

    Args:
        plant: that a filter has.
        certificate: of it.
        env: unwrapped.
    """
    if plant.declared is None or not callable(plant.declared):
        said = certificates.declared(plant, env, None, {})
        plant = replace(plant, declared=said)  # once: files are read for it
    differs = certificate.differs(certificates.declared(plant, env, None, {}))
    stale = certificates.stale(certificate)
    if differs or stale:
        of = f"is of another plant: {'; '.join(differs)}" if differs else f"does not know {stale}"
        warnings.warn(
            f"safety filter: the certificate {certificate.name!r} {of}: covered is 0",
            CoverageWarning,
            stacklevel=4,
        )
    if differs:
        return replace(plant, covered=Coverage.OUTSIDE)
    reserved = plant.uncertainty if certificate.margins is None else certificate.margins
    reserved = reserved._replace(body=plant.uncertainty.body)
    covered = Coverage.OUTSIDE if stale else Earned(certificate, plant)
    return replace(plant, uncertainty=reserved, covered=covered)
