"""The page of a certificate: its bound, the episodes that were drawn, and its limits."""

from collections.abc import Mapping

from hcbf_gym.certificates import Certificate
from hcbf_gym.certificates.certificate import CALIBRATED
from hcbf_gym.certificates.parts import PRESSED
from hcbf_gym.certificates.sequential import running_bound
from hcbf_gym.evaluation.tables import Table

LIMITS = (
    "Of an attacker, a scene or a start that is not drawn as below, nothing: a policy that was "
    "trained against this plant may enter more often than the mixture of these.",
    "Of one scene or one policy alone, only the bound of that line below.",
    "Of a real robot, nothing: the plant is the simulated one, and its files are hashed.",
    "Of a second episode after an alarm, and of what happens while the filter brakes, nothing "
    "beyond what these episodes held.",
    "Of tries that are not declared: several on fresh seeds share the doubt by `--try`; one alone "
    "may be looked at, stopped and continued at no price.",
)
"""The limits of every certificate, a sentence for each."""


def page(certificate: Certificate) -> str:
    """Return the page of a certificate in Markdown."""
    c = certificate
    bounds = ", ".join(f"{bound:.3g} of {name}" for name, bound in c.weightings.items())
    computed_with = ", ".join(f"{name} {version}" for name, version in c.versions.items())
    declared = [(name, _declaration(value)) for name, value in c.plant.items()]
    return "\n".join([
        f"# Certificate: {c.name}",
        "",
        f"**P(enter) ≤ {c.bound:.3g}** for the next episode, with a confidence of "
        f"{c.confidence:.1%}: "
        f"{c.entered} of {c.episodes:,} fresh episodes entered rank 1, the first that were enough: "
        f"e = {c.e_value:.4g} ({_try(c)}). The least h was {c.least_h:+.4g}; the robot "
        f"fell in {c.falls}, and the filter raised an alarm in {c.alarms}.",
        "",
        _stakes(c),
        "",
        f"Bounds for every weighting of its families: {bounds}.",
        "",
        "## What was certified",
        *(f"- {sentence}" for sentence in c.words),
        f"- {_margins(c)}",
        f"- Seeds {c.first_seed} to {c.first_seed + c.episodes - 1}; hash `{c.hash}`.",
        f"- Earned for hcbf-gym {c.version}, commit {c.commit or 'unknown'}.",
        f"- Computed with {computed_with}.",
        "",
        "A plant is this one where it declares:",
        "",
        Table("", ("name", "certified"), declared).markdown(),
        "",
        "## Limits",
        *(f"- {sentence}" for sentence in LIMITS),
        "",
        "## Who was drawn",
        _strata(c).markdown(),
        "",
        "## How the margins were found",
        _calibration(c),
        "",
        "Repeat a part of it: `hcbf certify --check FILE --episodes 50`.",
        "",
    ])  # fmt: skip


def _try(c: Certificate) -> str:
    """Return the number of the try, and the e-value that it requires."""
    which = "the only try" if c.attempt == 0 else f"try {c.attempt}"
    return f"{which}, which needs {1.0 / c.doubt:,.4g} at least"


def _stakes(c: Certificate) -> str:
    """Return how much the episodes put rank 1 to the test."""
    return (
        f"In {c.shown.pressed / c.episodes:.0%} of the episodes the filter had to change an input "
        f"that would have entered rank 1 within a second ({PRESSED:.0%} are required, so that the "
        "chance in such an episode is at most twice the bound). Half of the episodes came within "
        f"{c.shown.half_within:.3g}, and half lasted {c.shown.half_last} steps or more."
    )


def _margins(c: Certificate) -> str:
    """Return the margins that rows reserve."""
    if c.margins is None:
        return "Rows reserve what the plant's own law gives for each episode."
    listed = ", ".join(f"{name} {value:.4g}" for name, value in c.margins._asdict().items())
    return f"Rows reserve: {listed}."


def _strata(c: Certificate) -> Table:
    """Return a table of the episodes of each policy in each family of scenes."""
    doubt = c.doubt / len(c.strata)  # so that the bounds of all strata hold together
    rows = []
    for s in c.strata:
        entered = f"{s.entered} (≤ {running_bound(s.entered, s.episodes, doubt):.2%})"
        rows.append((s.policy, s.scene, str(s.episodes), entered, f"{s.least_h:+.4g}"))
    return Table("", ("policy", "scenes", "episodes", "entered (≤ at β/m)", "least h"), rows)


def _calibration(c: Certificate) -> str:
    """Return a table of the rounds of the calibration, or a sentence if there were none."""
    if not c.calibration:
        return "They are the plant's own; no calibration came before."
    rows = []
    for done in c.calibration:
        margins = [f"{done['margins'][name]:.4g}" for name in CALIBRATED]
        counts = str(done["episodes"]), str(done["entered"])
        rows.append((done["what"], *margins, *counts, f"{done['least_h']:+.4g}"))
    table = Table("", ("what", *CALIBRATED, "episodes", "entered", "least h"), rows)
    return (
        "Searched attackers find failures; they are no independent draws, and bound nothing.\n\n"
        + table.markdown()
    )


def _declaration(value: object) -> str:
    """Return a declared value in words, or the choices or the range that are certified of it."""
    if isinstance(value, Mapping) and set(value) == {"any of"}:
        return ", ".join(map(str, value["any of"]))
    if isinstance(value, Mapping) and set(value) == {"from", "to"}:
        return f"{value['from']:g} to {value['to']:g}"
    return str(value)
