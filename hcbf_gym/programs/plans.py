r"""The programs: each is a plan, which consists of a few choices, beside its equation.

Throughout, u ∈ U, and rows of one priority are one level. û_k solves the program of row k alone: it
is the input of U nearest u* that meets row k or, if none does, violates it least. The core's
`cascade.hpp` reads a plan: on polygons for two inputs, on polyhedra for any number of inputs and
for QP solvers by name.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from hcbf_gym.errors import (
    InvalidInputError,
    UnknownNameError,
    check_options,
    choose,
    instance,
    shown,
)

STRICT = ("first", "all")
LOWER = ("nothing", "relaxed", "drawn")
ORDER = ("at once", "by level")
LOCK = ("nothing", "pin", "bound")


@dataclass(frozen=True)
class Plan:
    r"""A program as data: which stages there are, and what each does.

    A stage of strict rows leaves the inputs that meet them or, if none does, violate them least,
    :math:`\min Σ_k \max(0, b_k − a_k u)²`. A stage of other rows chooses the u that trades their
    δ against the distance to u*, :math:`λ_u ‖u^⋆ − u‖² + Σ_k λ_{δ_k} δ_k²`, among the inputs that
    the earlier stages leave. The program's input is that of the last stage.

    Args:
        strict: the strict rows: "first" for the rows of priority 1; "all" for all rows but those of
            levels with a weight.
        lower: the δ of all other rows: "relaxed" for their violation,
            :math:`δ_k = \max(δ_{min}, b_k − a_k u)`; "drawn" for the difference from the value
            that a row has alone, :math:`δ_k = a_k(û_k − u)`; "nothing" to ignore these rows.
        order: the stages: the strict rows, then all others "at once"; or "by level".
        lock: what later stages keep of a relaxed level: "pin" each row's value, "bound" each row's
            violation; "nothing" if there is no later stage.

    Raises:
        InvalidInputError: on other values; if a plan by level has no lock, or another plan has one.
    """

    strict: str
    lower: str = "nothing"
    order: str = "at once"
    lock: str = "nothing"

    def __post_init__(self) -> None:
        choices = {"strict": STRICT, "lower": LOWER, "order": ORDER, "lock": LOCK}
        for name, known in choices.items():
            choose(f"plan: {name}", getattr(self, name), dict.fromkeys(known))
        locks = self.order == "by level" and self.lower != "nothing"
        if locks == (self.lock == "nothing"):
            expected = f"one of {LOCK[1:]}" if locks else "'nothing'"
            raise InvalidInputError(
                f"plan: got lock {self.lock!r} with lower {self.lower!r} and order "
                f"{self.order!r}, expected {expected}"
            )

    @property
    def options(self) -> tuple[str, ...]:
        """The options of programs with this plan; see `Prices.read`."""
        if self.lower == "nothing":
            return ()
        if self.strict == "all":
            return ("weights", "delta_gamma", "lambda_u")
        known = ("epsilon",) if self.lower == "relaxed" else ()
        return ("gamma0", "delta_gamma", "lambda_u", *known)

    @property
    def ranks(self) -> bool:
        """Whether rows of priority 1 come before the others."""
        return self.strict == "first" or self.order == "by level"


CBF_QP = Plan(strict="all")
r"""CBF-QP (section II-C): every row is hard.

.. math:: \min_{u ∈ U} ‖u^⋆ − u‖² \quad \text{s.t.}\quad a_k u ≥ b_k \;\text{for all } k.

Where the rows conflict it has no solution: the status is VIOLATED whatever the priority of the row
that is missed, and u violates the rows least, ``min Σ δ_k²``.
"""

R_CBF_QP = Plan(strict="first", lower="relaxed")
r"""R-CBF-QP (section III-A) with m rows: lower rows may be missed, at a price.

.. math::
    \min_{u ∈ U,\, δ ≥ δ_{min}} λ_u ‖u^⋆ − u‖² + \sum_k λ_{δ_k} δ_k² \quad \text{s.t.}\quad
    a_i u ≥ b_i \;(\text{priority } 1), \qquad a_k u ≥ b_k − δ_k \;(\text{others}).
"""

H_CBF_QP = Plan(strict="first", lower="drawn")
r"""H-CBF-QP for one relaxed row, IH-CBF-QP for several (sections III-B, III-C).

Lower rows are drawn to what each would get alone:

.. math::
    \min_{u ∈ U,\, δ} λ_u ‖u^⋆ − u‖² + \sum_k λ_{δ_k} δ_k² \quad \text{s.t.}\quad
    a_i u ≥ b_i \;(\text{priority } 1), \qquad a_k u + δ_k = a_k û_k \;(\text{others}).
"""

EH_CBF_QP = Plan(strict="first", lower="drawn", order="by level", lock="pin")
r"""EH-CBF-QP (section III-D) as printed: each level is pinned before the next.

For each priority p = 2, 3, …

.. math::
    \min_{u ∈ U,\, δ} λ_u ‖u^⋆ − u‖² + \sum_{k ∈ p} λ_{δ_k} δ_k² \quad \text{s.t.}\quad
    & a_i u ≥ b_i \;(\text{priority } 1), \\
    & a_i u + δ_i^⋆ = a_i û_i \;(\text{priorities } 2 … p−1), \\
    & a_k u + δ_k = a_k û_k \;(\text{priority } p).

The equalities hold whether or not a row is near its bound: in the plane two of them leave nothing
to decide.
"""

LEX_CBF_QP = Plan(strict="all", lower="relaxed", order="by level", lock="bound")
r"""Lex-CBF-QP (ours): no row is relaxed while one of lower priority still could be.

For each priority p = 1, 2, …, with :math:`δ_i^⋆` the violations of the earlier stages,

.. math::
    \min_{u ∈ U,\, δ ≥ 0} \sum_{k ∈ p} δ_k² \quad \text{s.t.}\quad
    a_i u ≥ b_i − δ_i^⋆ \;(\text{priorities } 1 … p−1), \qquad a_k u ≥ b_k − δ_k,

and at last the u nearest u*. A level with a weight minimises
:math:`λ_u ‖u^⋆ − u‖² + \sum_{k ∈ p} λ_{δ_k} δ_k²` instead, and its δ is locked in the same way.
"""

_PLANS: dict[str, Plan] = {
    "cbf-qp": CBF_QP,
    "r-cbf-qp": R_CBF_QP,
    "h-cbf-qp": H_CBF_QP,
    "ih-cbf-qp": H_CBF_QP,
    "eh-cbf-qp": EH_CBF_QP,
    "lex-cbf-qp": LEX_CBF_QP,
}


def names() -> list[str]:
    """Return the names of the programs."""
    return list(_PLANS)


def register(name: str, plan: Plan) -> None:
    """Name a plan, so that the name is valid wherever a program is named.

    Args:
        name: a name that no other plan has.
        plan: the program.

    Raises:
        InvalidInputError: if the name is taken or not a text, or `plan` is not a plan.
    """
    if not isinstance(name, str) or not name:
        raise InvalidInputError(
            f"program name: got {shown(name)}, expected a text that is not empty"
        )
    instance("plan", plan, Plan)
    if _PLANS.get(name, plan) != plan:
        raise InvalidInputError(
            f"program name: got {name!r}, expected one that is not taken; taken: {sorted(_PLANS)}"
        )
    _PLANS[name] = plan


Named = str | Plan | Mapping[str, Any]
"""A program's name, a plan, or a plan's choices in a plain dict."""


def plan_of(program: Named) -> Plan:
    """Return the plan of a name or of a plain dict, or the plan itself.

    Raises:
        UnknownNameError: on an unknown name; the message lists the choices.
        InvalidInputError: on a dict of other keys or values.
    """
    if isinstance(program, Plan):
        return program
    if isinstance(program, Mapping):
        check_options("plan", program, [field.name for field in fields(Plan)])
        if "strict" not in program:
            raise InvalidInputError(f"plan: got {dict(program)}, expected 'strict' among its keys")
        return Plan(**program)
    if isinstance(program, str) and program == "none":
        raise UnknownNameError(
            f"unknown program: got 'none', expected one of {sorted(_PLANS)}; for no filter, leave "
            "the environment without SafetyFilter"
        )
    return choose("program", program, _PLANS)


def plain(program: Named) -> str | dict[str, object]:
    """Return a name as it is, and a plan as a plain dict, for a wrapper's spec."""
    return program if isinstance(program, str) else asdict(plan_of(program))
