"""The family of programs: ``(u*, rows) → FilterResult``, without Gymnasium or MuJoCo."""

from typing import Any

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import check_options, choose
from hcbf_gym.models.input_sets import Box, InputSet
from hcbf_gym.programs.cascades import CASCADES, Cascade
from hcbf_gym.programs.conflicts import ConflictReport, conflict_report, equivalent_offset
from hcbf_gym.programs.general.program import GeneralProgram
from hcbf_gym.programs.planar.program import KINDS, BatchProgram, PlanarProgram
from hcbf_gym.programs.program import Program
from hcbf_gym.programs.result import FilterResult, FilterStatus

__all__ = [
    "BatchProgram",
    "CbfRows",
    "ConflictReport",
    "FilterResult",
    "FilterStatus",
    "Program",
    "conflict_report",
    "equivalent_offset",
    "is_compiled",
    "make",
    "make_batch",
    "names",
    "options",
]


def names() -> list[str]:
    """Return the names of the programs."""
    return list(CASCADES)


def options(name: str) -> tuple[str, ...]:
    """Return the options that the program takes beside `input_set` and `solver`.

    Raises:
        UnknownNameError: if there is no such program.
    """
    return choose("program", name, CASCADES).options


def is_compiled(name: str) -> bool:
    """Tell whether the program is compiled for two inputs, as all of this package are.

    Raises:
        UnknownNameError: if there is no such program.
    """
    return choose("program", name, CASCADES) in KINDS


def make(
    name: str,
    *,
    input_set: InputSet | None = None,
    solver: str | None = None,
    **program_options: Any,
) -> Program:
    """Return the program of that name.

    Args:
        name: one of :func:`names`.
        input_set: U; the paper's box |u_i| ≤ 5 unless given.
        solver: "daqp", "clarabel", or any solver that qpsolvers finds installed. Without a name,
            the programs of this package need none for two inputs (`planar`); any
            other number of inputs, and a program of your own, takes DAQP.
        program_options: among :func:`options`.

    Raises:
        UnknownNameError: on an unknown program or solver; the message lists the choices.
        InvalidInputError: on an unknown option or a value that the program refuses.
    """
    cascade, inputs = _cascade(name, program_options), _input_set(input_set)
    if solver is None and inputs.n_u == 2 and type(cascade) in KINDS:
        return PlanarProgram(cascade, inputs)
    return GeneralProgram(cascade, inputs, solver or "daqp")


def make_batch(
    name: str, *, input_set: InputSet | None = None, **program_options: Any
) -> BatchProgram:
    """Return the program of that name for N states of two inputs at once.

    Args:
        name: one of :func:`names`.
        input_set: U, as :func:`make` takes it.
        program_options: among :func:`options`. There is no solver to choose.

    Raises:
        UnknownNameError: on an unknown program; the message lists the choices.
        InvalidInputError: on an unknown option, a value that the program refuses, an input set
            that is not planar, or a program of your own.
    """
    return BatchProgram(_cascade(name, program_options), _input_set(input_set))


def _cascade(name: str, program_options: dict[str, Any]) -> Cascade:
    kind = choose("program", name, CASCADES)
    check_options(f"program {name}", program_options, kind.options)
    return kind(**program_options)


def _input_set(input_set: InputSet | None) -> InputSet:
    return Box.symmetric(5.0) if input_set is None else input_set
