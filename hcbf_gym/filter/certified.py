"""Decides whether the promise was tested for a filter's plant and arguments.

* An environment *declares* its arguments by name (`Plant.declared`). They identify its plant; a
  user's plant is also identified by a hash of each of its parts (`certificates.declared`).
* A value was *tested* if it is in its range in `tested.json` or in a certificate.
* A plant is *covered* if all values that identify it were tested. `covered` is then
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

_CHANGEABLE_FIELDS = ("covered", "goal", "extent", "uncertainty")
"""The fields in which a filter's plant may differ from the environment's plant."""


class CertificateCoverage(NamedTuple):
    """A reader for `Plant.covered`: compares the declared values with a certificate at each step.

    No sufficient condition on the inputs has to hold besides, because episodes of this very plant
    have shown that it satisfies rank 1.
    """

    certificate: Certificate
    identity: Mapping[str, object]  # the identity of the plant when the filter was made
    declared: Mapping[str, object] | Reader | None  # the plant's field; None if it has none

    def __call__(self, env: object, observation: object, info: Info) -> Judged:
        """Return whether the certificate covers the plant with its present declared values."""
        latest = read(self.declared, env, observation, info) or {}
        identity = {**self.identity, **latest}
        return judge(identity, self.certificate.plant, reason=CoveredBy.CERTIFICATE)


def certified(plant: Plant, certificate: Certificate, env: object) -> Plant:
    """Return the plant with a certificate's margins and coverage.

    Rows then reserve the certificate's uncertainty, with the extent of the plant's own body. If the
    certificate is of another plant, a warning states the differences, and nothing is covered.

    Args:
        plant: the filter's plant.
        certificate: the certificate that the user gave for this plant.
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
    margins = plant.uncertainty if certificate.margins is None else certificate.margins
    margins = margins._replace(body=plant.uncertainty.body)
    coverage = CertificateCoverage(certificate, identity, plant.declared)
    return replace(plant, uncertainty=margins, covered=judged if judged.outside else coverage)


def judge_filter(
    settings: FilterSettings,
    plant: Plant,
    differences: list[str],
    certificate: Certificate | None,
) -> Judged | None:
    """Warn of values with which the promise was not tested, and return them.

    Args:
        settings: the filter's arguments.
        plant: the filter's plant.
        differences: how it differs from the environment's own plant, see `differences_of`.
        certificate: the plant's certificate; None if the filter was given none.

    Returns:
        Why the filter is not covered; None if its plant and its arguments were tested.
    """
    covered = plant.covered.covered if isinstance(plant.covered, Judged) else plant.covered
    if isinstance(covered, int) and covered == Coverage.OUTSIDE:
        return None  # nothing is promised for the plant, whatever the filter's arguments are
    ranges = _tested_ranges(plant, certificate)
    values = _comparable(settings, plant)
    arguments = {name: values[name] for name in (*ranges, "alpha_gain")}
    plant_ranges = certificates.tested()["plant of the filter"]
    judgements = (
        judge({"plant": differences}, plant_ranges, reason=CoveredBy.PLANT),
        judge(arguments, ranges, reason=CoveredBy.FILTER),
    )
    outside = [judged for judged in judgements if judged.outside]
    if not outside:
        return None
    phrases = tuple(phrase for judged in outside for phrase in judged.reasons)
    warn_caller(
        f"safety filter: the promise was not tested with {', '.join(phrases)}: covered is 0",
        CoverageWarning,
    )
    return outside[0]._replace(reasons=phrases)


def _tested_ranges(plant: Plant, certificate: Certificate | None) -> dict[str, object]:
    """Return the tested range of each argument of the filter that matters for a plant."""
    # if the model is exact, any margin is as good, and any α whose row U can brake
    is_exact = plant.uncertainty == EXACT and isinstance(plant.model, DoubleIntegrator)
    section = "filter" if is_exact else "filter of a plant that is not its model"
    ranges = dict(certificates.tested()[section])
    if certificate is not None:
        ranges["options"] = {}
        for name in ("program", "strict"):
            if name in certificate.family:
                ranges[name] = certificate.family[name]
        if certificate.family["kind"] == "own":
            ranges["guidance"] = None
    return ranges


def _comparable(settings: FilterSettings, plant: Plant) -> dict[str, object]:
    """Return a filter's arguments in JSON's terms, each α apart from the other options.

    Ranges end at `alpha_gain`, the gain of α₂ if it is not given.
    """
    alphas = alphas_of(settings.options, plant)
    alphas_as_json = {k: records.to_dict(alpha, class_k.KINDS) for k, alpha in alphas.items()}
    return {
        **settings._asdict(),
        **alphas_as_json,
        "program": programs.plain(settings.program),
        "on_alarm": None if settings.on_alarm == plant.on_alarm else settings.on_alarm,
        "options": {name: x for name, x in settings.options.items() if name not in alphas},
        "alpha_gain": class_k.unless_given(plant.period, plant.gain).gain,
    }


def differences_of(plant: Plant, env: Any) -> list[str]:
    """Return in phrases how a filter's plant differs from that of its unwrapped environment."""
    phrases = []
    if certificates.is_of_package(plant.declared) and not certificates.is_of_package(type(env)):
        phrases.append("another environment than the package's")
    own = getattr(env, "plant", None)
    if not isinstance(own, Plant):
        return phrases
    for name in (field.name for field in fields(plant)):
        if name in _CHANGEABLE_FIELDS:
            continue
        if not certificates.same(getattr(plant, name), getattr(own, name)):
            phrases.append(f"another {name.replace('_', ' ')} than the environment's")
    reserved = zip(plant.uncertainty, own.uncertainty, strict=True)
    if any(mine < required for mine, required in reserved):
        phrases.append("a lower uncertainty than the environment's")
    return phrases
