"""A plant under a certificate: its margins are what rows reserve, and `covered` follows it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from hcbf_gym import certificates, programs, records
from hcbf_gym.arrays import Info
from hcbf_gym.barriers import class_k
from hcbf_gym.barriers.class_k import LogClassK
from hcbf_gym.certificates import Certificate, Judged, judge
from hcbf_gym.errors import CoverageWarning, warn_caller
from hcbf_gym.models.plant import EXACT, Coverage, CoveredBy, Plant, read
from hcbf_gym.models.reduced_order import DoubleIntegrator

_OWN = (
    "model", "input_set", "period", "state", "barriers", "to_action", "from_action", "brake",
    "max_age", "axle", "braking",
)  # fmt: skip
"""What of a plant a filter must not change, where an environment has one of its own."""


class Earned(NamedTuple):
    """`covered` of a plant whose own episodes showed it, so that no sufficient condition is needed.

    Attributes:
        certificate: that was earned.
        plant: as it declares itself.
    """

    certificate: Certificate
    plant: Plant

    def __call__(self, env: object, observation: object, info: Info) -> Judged:
        """Return what the certificate says of the plant now."""
        said = dict(read(self.plant.declared, env, observation, info))
        return judge(said, self.certificate.plant, reason=CoveredBy.CERTIFICATE)


def certified(plant: Plant, certificate: Certificate, env: object) -> Plant:
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
    judged = certificates.judged_by(certificate, certificates.declared(plant, env, None, {}))
    of_another = judged.outside and judged.covered_by == CoveredBy.ARGUMENT
    if judged.outside:
        of = "is of another plant:" if of_another else "does not know"
        warn_caller(
            f"safety filter: the certificate {certificate.name!r} {of} {'; '.join(judged.says)}: "
            "covered is 0",
            CoverageWarning,
        )
    outside = judged._replace(covered_by=CoveredBy.CERTIFICATE)
    if of_another:
        return replace(plant, covered=outside)
    reserved = plant.uncertainty if certificate.margins is None else certificate.margins
    reserved = reserved._replace(body=plant.uncertainty.body)
    covered = outside if judged.outside else Earned(certificate, plant)
    return replace(plant, uncertainty=reserved, covered=covered)


def limits(
    asked: Mapping[str, Any], plant: Plant, other: list[str], certificate: Certificate | None
) -> Judged | None:
    """Warn of a filter's plant and arguments where they were not tested; None where they were.

    On a double integrator that is its model any margin and any α whose row U can brake are as good.
    Nothing is said of plants that are not covered whatever the filter is.

    Args:
        asked: the filter's arguments by their names, see `core.FilterSettings`.
        plant: that the filter has.
        other: in what it is not the one that the environment brings, see `differs`.
        certificate: that was asked for; None for none.
    """
    known = plant.covered
    known = known.covered if isinstance(known, Judged) else known
    if isinstance(known, int) and known == Coverage.OUTSIDE:
        return None
    tested = certificates.tested()
    exact = plant.uncertainty == EXACT and isinstance(plant.model, DoubleIntegrator)
    ranges = dict(tested["filter" if exact else "filter of a plant that is not its model"])
    if certificate is not None and certificate.family.get("program") is not None:
        ranges["program"] = certificate.family["program"]
    alphas = {
        "alpha1": class_k.make(asked["options"].get("alpha1", LogClassK())),
        "alpha2": class_k.make(asked["options"].get("alpha2", 2.0)),
    }
    told = {name: records.to_dict(alpha, class_k.KINDS) for name, alpha in alphas.items()}
    all_told = {**asked, **told, "program": programs.plain(asked["program"])}
    matters = {name: all_told[name] for name in ranges}
    both = (
        judge({"plant": other}, tested["plant of the filter"], reason=CoveredBy.PLANT),
        judge(matters, ranges, reason=CoveredBy.FILTER),
    )
    outside = [one for one in both if one.outside]
    if not outside:
        return None
    says = tuple(phrase for one in outside for phrase in one.says)
    warn_caller(
        f"safety filter: the promise was not tested with {', '.join(says)}: covered is 0",
        CoverageWarning,
    )
    return outside[0]._replace(says=says)


def differs(plant: Plant, own: Plant) -> list[str]:
    """Return in what a filter's plant is not its environment's own, a phrase for each."""
    said = [
        f"another {name.replace('_', ' ')} than the environment's"
        for name in _OWN
        if records.plain(getattr(plant, name)) != records.plain(getattr(own, name))
    ]
    reserved = zip(plant.uncertainty, own.uncertainty, strict=True)
    if any(less < needed for less, needed in reserved):
        said.append("a lower uncertainty than the environment's")
    return said
