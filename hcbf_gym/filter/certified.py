"""A plant under a certificate: its margins are what rows reserve, and `covered` follows it."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, NamedTuple

from hcbf_gym import certificates, programs, records
from hcbf_gym.arrays import Info
from hcbf_gym.barriers import class_k
from hcbf_gym.certificates import Certificate, Judged, judge, warn_of_version
from hcbf_gym.errors import CoverageWarning, warn_caller
from hcbf_gym.filter.settings import alpha2_of, alphas_of
from hcbf_gym.models.plant import EXACT, Coverage, CoveredBy, Plant, Reader, read
from hcbf_gym.models.reduced_order import DoubleIntegrator

_FREE = ("covered", "goal", "extent", "uncertainty")
"""What of an environment's plant a filter may change."""


class Earned(NamedTuple):
    """`covered` of a plant whose own episodes showed it, so that no sufficient condition is needed.

    Attributes:
        certificate: that was earned.
        stated: what identified the plant when the filter was made.
        declared: a mapping or a reader, of the plant; None for none.
    """

    certificate: Certificate
    stated: Mapping[str, object]
    declared: Mapping[str, object] | Reader | None

    def __call__(self, env: object, observation: object, info: Info) -> Judged:
        """Return what the certificate covers of the plant now."""
        now = read(self.declared, env, observation, info) or {}
        return judge(
            dict(self.stated) | dict(now), self.certificate.plant, reason=CoveredBy.CERTIFICATE
        )


def certified(plant: Plant, certificate: Certificate, env: object) -> Plant:
    """Return the plant with a certificate's margins; warn where that is of another plant.

    The reach of the body stays the plant's.

    Args:
        plant: that a filter has.
        certificate: of it.
        env: unwrapped.
    """
    stated = certificates.declared(plant, env, None, {})
    judged = certificates.judged_by(certificate, stated)
    if judged.outside and judged.covered_by == CoveredBy.ARGUMENT:
        warn_caller(
            f"safety filter: the certificate {certificate.name!r} is of another plant: "
            f"{'; '.join(judged.reasons)}: covered is 0",
            CoverageWarning,
        )
        return replace(plant, covered=judged._replace(covered_by=CoveredBy.CERTIFICATE))
    if judged.outside:
        warn_of_version(judged.reasons[0])
    reserved = plant.uncertainty if certificate.margins is None else certificate.margins
    reserved = reserved._replace(body=plant.uncertainty.body)
    covered = judged if judged.outside else Earned(certificate, stated, plant.declared)
    return replace(plant, uncertainty=reserved, covered=covered)


def limits(
    asked: Mapping[str, Any], plant: Plant, other: list[str], certificate: Certificate | None
) -> Judged | None:
    """Warn of a filter's plant and arguments where they were not tested; None where they were.

    On a double integrator that is its model any margin and any α whose row U can brake are as good.

    Args:
        asked: the filter's arguments by their names, see `FilterSettings`.
        plant: that the filter has.
        other: in what it is not the one that the environment brings, see `differs`.
        certificate: of the plant; None for none.
    """
    known = plant.covered
    known = known.covered if isinstance(known, Judged) else known
    if isinstance(known, int) and known == Coverage.OUTSIDE:
        return None
    tested = certificates.tested()
    exact = plant.uncertainty == EXACT and isinstance(plant.model, DoubleIntegrator)
    ranges = dict(tested["filter" if exact else "filter of a plant that is not its model"])
    if certificate is not None:
        ranges["options"] = {}
        if certificate.family.get("program") is not None:
            ranges["program"] = certificate.family["program"]
        if certificate.family["kind"] == "own":
            ranges["guidance"] = None
    alphas = alphas_of(asked["options"], plant)
    plain: dict[str, Any] = {n: records.to_dict(one, class_k.KINDS) for n, one in alphas.items()}
    plain |= {
        "program": programs.plain(asked["program"]),
        "on_alarm": None if asked["on_alarm"] == plant.on_alarm else asked["on_alarm"],
        "options": {name: one for name, one in asked["options"].items() if name not in alphas},
    }
    matters = {name: {**asked, **plain}[name] for name in ranges}
    matters["alpha_gain"] = alpha2_of(plant).gain
    both = (
        judge({"plant": other}, tested["plant of the filter"], reason=CoveredBy.PLANT),
        judge(matters, ranges, reason=CoveredBy.FILTER),
    )
    outside = [one for one in both if one.outside]
    if not outside:
        return None
    phrases = tuple(phrase for one in outside for phrase in one.reasons)
    warn_caller(
        f"safety filter: the promise was not tested with {', '.join(phrases)}: covered is 0",
        CoverageWarning,
    )
    return outside[0]._replace(reasons=phrases)


def differs(plant: Plant, env: Any) -> list[str]:
    """Return in what a filter's plant is not its environment's own, a phrase for each.

    Args:
        plant: that the filter has.
        env: unwrapped.
    """
    found = []
    ours = certificates.is_of_package(type(env))
    if certificates.is_of_package(plant.declared) and not ours:
        found.append("another environment than the package's")
    own = getattr(env, "plant", None)
    if not isinstance(own, Plant):
        return found
    found += [
        f"another {field.name.replace('_', ' ')} than the environment's"
        for field in fields(plant)
        if field.name not in _FREE
        and not certificates.same(getattr(plant, field.name), getattr(own, field.name))
    ]
    reserved = zip(plant.uncertainty, own.uncertainty, strict=True)
    if any(less < needed for less, needed in reserved):
        found.append("a lower uncertainty than the environment's")
    return found
