"""Programs, ``(u*, rows) → FilterResult``: they make a safe input of a nominal one."""

from typing import Any

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import check_options
from hcbf_gym.models import input_sets
from hcbf_gym.models.input_sets import Box, InputSet
from hcbf_gym.programs.conflicts import ConflictReport, conflict_report, equivalent_offset
from hcbf_gym.programs.general import GeneralProgram
from hcbf_gym.programs.planar import BatchProgram, PlanarProgram
from hcbf_gym.programs.plans import Named, Plan, names, plain, plan_of, register
from hcbf_gym.programs.prices import Prices
from hcbf_gym.programs.program import Program
from hcbf_gym.programs.result import FilterResult, FilterStatus

__all__ = [
    "BatchProgram",
    "CbfRows",
    "ConflictReport",
    "FilterResult",
    "FilterStatus",
    "Named",
    "Plan",
    "Prices",
    "Program",
    "conflict_report",
    "equivalent_offset",
    "make",
    "make_batch",
    "names",
    "options",
    "plain",
    "plan_of",
    "register",
]


def options(program: Named) -> tuple[str, ...]:
    """Return the names of a program's options, besides `input_set` and `solver`.

    Raises:
        UnknownNameError: if there is no such program.
    """
    return plan_of(program).options


def make(
    program: Named,
    *,
    input_set: InputSet | None = None,
    solver: str | None = None,
    **program_options: Any,
) -> Program:
    """Return a program for single states.

    Args:
        program: one of :func:`names`, or a plan of your own.
        input_set: U; the paper's box |u_i| ≤ 5 unless given.
        solver: "daqp", "clarabel", or any solver that qpsolvers finds installed, as a second
            opinion. The core solves the program if none is named, or if that solver fails.
        program_options: options among :func:`options`; see `Prices.read`.

    Raises:
        UnknownNameError: on an unknown program or solver; the message lists the choices.
        InvalidInputError: on an unknown option or a value that the program refuses.
    """
    plan, prices, input_set = _read(program, program_options, input_set)
    if solver is None and input_set.n_u == 2:
        return PlanarProgram(plan, prices, input_set)
    return GeneralProgram(plan, prices, input_set, solver)


def make_batch(
    program: Named, *, input_set: InputSet | None = None, **program_options: Any
) -> BatchProgram:
    """Return a program for N states of two inputs at once.

    Args:
        program: as :func:`make` takes it. There is no solver to choose.
        input_set: U; the paper's box unless given.
        program_options: options among :func:`options`.

    Raises:
        InvalidInputError: as :func:`make`, or on an input set that is not planar.
    """
    return BatchProgram(*_read(program, program_options, input_set))


def _read(
    program: Named, program_options: dict[str, Any], input_set: InputSet | None
) -> tuple[Plan, Prices, InputSet]:
    """Return the validated arguments of a program."""
    plan = plan_of(program)
    name = program if isinstance(program, str) else plan
    check_options(f"program {name}", program_options, plan.options)
    prices = Prices.read(plan, **program_options)
    if input_set is None:
        return plan, prices, Box.symmetric(5.0)
    return plan, prices, input_sets.read("input_set", input_set)
