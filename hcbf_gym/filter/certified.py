"""Decides whether a filter is covered: whether the promise was tested for its plant and arguments.

The words of coverage, here and in `hcbf_gym.certificates`:

* promise: the plant does not enter a region of rank 1, see ``docs/guarantees.md``;
* declared values: the arguments of an environment by their names, from `Plant.declared`;
* identity: all that certificates compare: the declared values, and of a user's plant a hash of
  each of its parts, from `certificates.declared`;
* range: the values of one argument that were tested, in a certificate or in `tested.json`;
* verdict: the result of comparing values with ranges: a `Coverage`, or a `Judged` with its reasons;
* covered: the verdict `Coverage.COVERED`. `Plant.covered` is a fixed verdict, or a reader of one.

>>> ranges = {"v_max": {"to": 1.0, "unit": "m/s"}, "scene": "random"}
>>> judge({"v_max": 0.8, "scene": "random"}, ranges).covered
<Coverage.COVERED: 1>
>>> judge({"v_max": 0.8, "scene": "a scene of yours"}, ranges).covered
<Coverage.SCENE: 2>
>>> judge({"v_max": 2.0, "scene": "random"}, ranges).reasons
('v_max 2.0 (tested: at most 1 m/s)',)
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, NamedTuple

from hcbf_gym import certificates, programs, records
from hcbf_gym.arrays import Info
from hcbf_gym.barriers import class_k
from hcbf_gym.certificates import Certificate, Judged, judge, warn_of_version
from hcbf_gym.errors import CoverageWarning, in_words, warn_caller
from hcbf_gym.filter.settings import FilterSettings, alphas_of
from hcbf_gym.models.plant import EXACT, Coverage, CoveredBy, Plant, Reader, read
from hcbf_gym.models.reduced_order import DoubleIntegrator

_CHANGEABLE_FIELDS = ("covered", "goal", "extent", "uncertainty")
"""The fields in which a filter's plant may differ from the environment's plant."""


class CertificateCoverage(NamedTuple):
    """A reader for `Plant.covered`: it compares the plant's present identity with a certificate.

    The check of U does not overrule its verdict (see `EpisodeCoverage.check_scenes`), because
    episodes of this very plant have shown that U satisfies rank 1.
    """

    certificate: Certificate
    identity: Mapping[str, object]  # the identity of the plant when the filter was made
    declared: Mapping[str, object] | Reader | None  # the plant's field; None if it has none

    def __call__(self, env: object, observation: object, info: Info) -> Judged:
        """Return whether the certificate covers the plant with its present declared values."""
        latest = read(self.declared, env, observation, info)
        try:
            identity = {**self.identity, **(latest or {})}
            return judge(identity, self.certificate.plant, reason=CoveredBy.CERTIFICATE)
        except Exception as error:  # a user's own values may raise anything when they are read
            reasons = (f"declared: unreadable ({in_words(error)})",)
            return Judged(Coverage.OUTSIDE, CoveredBy.CERTIFICATE, reasons)


def with_certificate(plant: Plant, certificate: Certificate, env: object) -> Plant:
    """Return the plant with the coverage and the margins of a certificate.

    Rows then reserve the certificate's uncertainty, with the extent of the plant's own body. If the
    certificate is of another plant, a warning states the differences, and nothing is covered.

    Args:
        plant: the filter's plant.
        certificate: the certificate that the user gave for this plant.
        env: the unwrapped environment.
    """
    identity = certificates.declared(plant, env, None, {})
    verdict = certificates.judged_by(certificate, identity)
    if verdict.outside and verdict.covered_by != CoveredBy.VERSION:
        return _outside_of_certificate(plant, certificate, verdict)
    margins = plant.uncertainty if certificate.margins is None else certificate.margins
    margins = margins._replace(body=plant.uncertainty.body)
    if verdict.outside:
        warn_of_version(verdict.reasons[0])
        return replace(plant, uncertainty=margins, covered=verdict)
    reader = CertificateCoverage(certificate, identity, plant.declared)
    return replace(plant, uncertainty=margins, covered=reader)


def _outside_of_certificate(plant: Plant, certificate: Certificate, verdict: Judged) -> Plant:
    """Warn that the certificate is of another plant; return the plant, which is never covered."""
    warn_caller(
        f"safety filter: the certificate {certificate.name!r} is of another plant: "
        f"{'; '.join(verdict.reasons)}: covered is 0",
        CoverageWarning,
    )
    return replace(plant, covered=verdict._replace(covered_by=CoveredBy.CERTIFICATE))


def judge_filter(
    settings: FilterSettings,
    plant: Plant,
    differences: list[str],
    certificate: Certificate | None,
) -> Judged | None:
    """Warn of values with which the promise was not tested, and return the verdict on the filter.

    It is None if the filter's plant and arguments were tested, so that `Plant.covered` decides.

    Args:
        settings: the filter's arguments.
        plant: the filter's plant.
        differences: how it differs from the environment's own plant, see `differences_of`.
        certificate: the plant's certificate; None if the filter was given none.
    """
    if _is_never_covered(plant):
        return None  # nothing is promised, whatever the filter's arguments are
    ranges = _tested_ranges(plant, certificate)
    values = _arguments_as_json(settings, plant)
    arguments = {name: values[name] for name in (*ranges, "alpha_gain")}
    plant_ranges = certificates.tested()["plant of the filter"]
    verdicts = (
        judge({"plant": differences}, plant_ranges, reason=CoveredBy.PLANT),
        judge(arguments, ranges, reason=CoveredBy.FILTER),
    )
    outside = [verdict for verdict in verdicts if verdict.outside]
    if not outside:
        return None
    phrases = tuple(phrase for verdict in outside for phrase in verdict.reasons)
    warn_caller(
        f"safety filter: the promise was not tested with {', '.join(phrases)}: covered is 0",
        CoverageWarning,
    )
    return outside[0]._replace(reasons=phrases)


def _is_never_covered(plant: Plant) -> bool:
    """Return whether the plant has the fixed verdict OUTSIDE; a reader may return another one."""
    verdict = plant.covered
    coverage = verdict.covered if isinstance(verdict, Judged) else verdict
    return isinstance(coverage, int) and coverage == Coverage.OUTSIDE


def _tested_ranges(plant: Plant, certificate: Certificate | None) -> dict[str, object]:
    """Return the tested range in JSON of each argument of the filter that matters for a plant."""
    # An exact planar model needs no margin. Any α suits it, because `EpisodeCoverage.check_scenes`
    # ends the coverage in scenes whose rows U cannot satisfy.
    is_exact = plant.uncertainty == EXACT and isinstance(plant.model, DoubleIntegrator)
    section = "filter" if is_exact else "filter of a plant that is not its model"
    ranges = dict(certificates.tested()[section])
    if certificate is not None:
        ranges["options"] = {}  # no certificate is earned with other options of a program
        for name in ("program", "strict"):
            if name in certificate.family:
                ranges[name] = certificate.family[name]
        if certificate.family["kind"] == "own":
            ranges["guidance"] = None
    return ranges


def _arguments_as_json(settings: FilterSettings, plant: Plant) -> dict[str, object]:
    """Return a filter's arguments in JSON's terms, each α apart from the other options.

    `alpha_gain` is no argument: ranges end at it. It is the gain of α₂ if none is given.
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
