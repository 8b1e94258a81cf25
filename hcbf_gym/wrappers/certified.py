"""A plant under a certificate: its margins are what rows reserve, and `covered` follows it."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from hcbf_gym import certificates
from hcbf_gym.certificates import Certificate
from hcbf_gym.errors import CoverageWarning
from hcbf_gym.models.plant import Coverage, Plant, read


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
    if differs:
        warnings.warn(
            f"safety filter: the certificate {certificate.name!r} is of another plant: "
            f"{'; '.join(differs)}: covered is 0",
            CoverageWarning,
            stacklevel=4,
        )
        return replace(plant, covered=Coverage.OUTSIDE)

    def covered(env: Any, observation: Any, info: dict[str, Any]) -> Any:
        said = dict(read(plant.declared, env, observation, info))
        scenes = said.get("scene")
        if not isinstance(scenes, list):
            return certificate.covers(said)
        known = {scene: certificate.covers(said | {"scene": scene}) for scene in set(scenes)}
        return np.array([known[scene] for scene in scenes])

    reserved = plant.uncertainty if certificate.margins is None else certificate.margins
    body = plant.uncertainty.body
    return replace(plant, uncertainty=reserved._replace(body=body), covered=covered)
