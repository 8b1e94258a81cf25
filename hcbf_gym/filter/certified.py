"""Whether the promise was tested for a filter's plant and arguments.

* An environment *declares* its arguments by name (`Plant.declared`). What identifies a plant is
  that, and of a user's plant a hash of each of its parts as well (`certificates.declared`).
* A value was *tested* where it is in its range in `tested.json` or in a certificate.
* A plant is *covered* where all that identifies it was tested. `covered` is then
  `Coverage.COVERED`, and `Coverage.SCENE` in scenes that were not tested.
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, NamedTuple

from hcbf_gym import certificates, programs, records
from hcbf_gym.arrays import Info
from hcbf_gym.barriers import class_k
from hcbf_gym.certificates import Certificate, Judged, judge, warn_of_version
from hcbf_gym.errors import CoverageWarning, warn_caller
from hcbf_gym.filter.settings import FilterSettings, alphas_of
from hcbf_gym.models.plant import EXACT, Coverage, CoveredBy, Plant, Reader, read
from hcbf_gym.models.reduced_order import DoubleIntegrator

_FREE = ("covered", "goal", "extent", "uncertainty")
"""Fields of an environment's plant that a filter's plant may change."""


class CertificateCoverage(NamedTuple):
    """A plant's `covered` by a certificate: it follows what the environment declares at each step.

    Episodes of this very plant showed what it promises, so that no sufficient condition on its
    inputs has to hold besides.

    `declared` is the plant's own mapping, or a reader of one; None where it declares nothing.
    """

    certificate: Certificate
    identity: Mapping[str, object]  # of the plant when the filter was made
    declared: Mapping[str, object] | Reader | None

    def __call__(self, env: object, observation: object, info: Info) -> Judged:
        """Return whether the certificate covers the plant with what it declares now."""
        latest = read(self.declared, env, observation, info) or {}
        known = {**self.identity, **latest}
        return judge(known, self.certificate.plant, reason=CoveredBy.CERTIFICATE)


def certified(plant: Plant, certificate: Certificate, env: object) -> Plant:
    """Return the plant with a certificate's margins and coverage, or warn that it is of another.

    Rows then reserve the certificate's uncertainty, with the extent of the plant's own body.

    Args:
        plant: of the filter.
        certificate: which the user gave for this plant.
        env: the unwrapped environment.
    """
    identity = certificates.declared(plant, env, None, {})
    judged = certificates.judged_by(certificate, identity)
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
    coverage = CertificateCoverage(certificate, identity, plant.declared)
    return replace(plant, uncertainty=reserved, covered=judged if judged.outside else coverage)


def judge_filter(
    settings: FilterSettings,
    plant: Plant,
    differences: list[str],
    certificate: Certificate | None,
) -> Judged | None:
    """Return why a filter is not covered, with a warning; None where its plant and arguments are.

    Args:
        settings: the filter's arguments.
        plant: of the filter.
        differences: between it and the environment's own plant, see `differences_of`.
        certificate: of the plant; None where the filter was given none.
    """
    known = plant.covered.covered if isinstance(plant.covered, Judged) else plant.covered
    if isinstance(known, int) and known == Coverage.OUTSIDE:
        return None  # nothing is promised of the plant, whatever the filter's arguments are
    ranges = _tested_ranges(plant, certificate)
    comparable = _comparable(settings, plant)
    arguments = {name: comparable[name] for name in (*ranges, "alpha_gain")}
    of_plant = certificates.tested()["plant of the filter"]
    both = (
        judge({"plant": differences}, of_plant, reason=CoveredBy.PLANT),
        judge(arguments, ranges, reason=CoveredBy.FILTER),
    )
    outside = [judged for judged in both if judged.outside]
    if not outside:
        return None
    phrases = tuple(phrase for judged in outside for phrase in judged.reasons)
    warn_caller(
        f"safety filter: the promise was not tested with {', '.join(phrases)}: covered is 0",
        CoverageWarning,
    )
    return outside[0]._replace(reasons=phrases)


def _tested_ranges(plant: Plant, certificate: Certificate | None) -> dict[str, object]:
    """Return the filter's arguments that matter for a plant, each with its tested range."""
    # Where the model is exact, any margin and any α whose row U can brake is as good.
    is_exact = plant.uncertainty == EXACT and isinstance(plant.model, DoubleIntegrator)
    kind = "filter" if is_exact else "filter of a plant that is not its model"
    ranges = dict(certificates.tested()[kind])
    if certificate is not None:
        ranges["options"] = {}
        of_filter = ("program", "strict")
        ranges |= {k: certificate.family[k] for k in of_filter if k in certificate.family}
        if certificate.family["kind"] == "own":
            ranges["guidance"] = None
    return ranges


def _comparable(settings: FilterSettings, plant: Plant) -> dict[str, object]:
    """Return a filter's arguments in JSON's terms, with its α besides the other options.

    Ranges end at `alpha_gain`, the gain that α₂ has unless it is given.
    """
    options, alphas = settings.options, alphas_of(settings.options, plant)
    plain = {name: records.to_dict(alpha, class_k.KINDS) for name, alpha in alphas.items()}
    return (
        settings._asdict()
        | plain
        | {
            "program": programs.plain(settings.program),
            "on_alarm": None if settings.on_alarm == plant.on_alarm else settings.on_alarm,
            "options": {name: one for name, one in options.items() if name not in alphas},
            "alpha_gain": class_k.unless_given(plant.period, plant.gain).gain,
        }
    )


def differences_of(plant: Plant, env: Any) -> list[str]:
    """Return how a filter's plant differs from its environment's own, a phrase for each field.

    Args:
        plant: of the filter.
        env: the unwrapped environment.
    """
    found = []
    if certificates.is_of_package(plant.declared) and not certificates.is_of_package(type(env)):
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
