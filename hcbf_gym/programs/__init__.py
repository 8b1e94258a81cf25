"""The family of programs: ``(u*, rows) → FilterResult``, without Gymnasium or MuJoCo."""

from typing import Any

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import check_options, choose
from hcbf_gym.models.input_sets import Box, InputSet
from hcbf_gym.programs.cbf import CbfQp
from hcbf_gym.programs.conflicts import ConflictReport, conflict_report, equivalent_offset
from hcbf_gym.programs.explicit import ExplicitHierarchicalCbfQp
from hcbf_gym.programs.hierarchical import HierarchicalCbfQp
from hcbf_gym.programs.lexicographic import LexicographicCbfQp
from hcbf_gym.programs.planar.batch import BatchProgram
from hcbf_gym.programs.program import Program
from hcbf_gym.programs.relaxed import RelaxedCbfQp
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
    "make",
    "make_batch",
    "names",
    "options",
]

_PROGRAMS: dict[str, type[Program]] = {
    "cbf-qp": CbfQp,
    "r-cbf-qp": RelaxedCbfQp,
    "h-cbf-qp": HierarchicalCbfQp,
    "ih-cbf-qp": HierarchicalCbfQp,
    "eh-cbf-qp": ExplicitHierarchicalCbfQp,
    "lex-cbf-qp": LexicographicCbfQp,
}


def names() -> list[str]:
    """Return the names of the programs."""
    return list(_PROGRAMS)


def options(name: str) -> tuple[str, ...]:
    """Return the options that the program takes beside `input_set` and `solver`.

    Raises:
        UnknownNameError: if there is no such program.
    """
    return choose("program", name, _PROGRAMS).options


def make(
    name: str, *, input_set: InputSet | None = None, solver: str = "daqp", **program_options: Any
) -> Program:
    """Return the program of that name.

    Args:
        name: one of :func:`names`.
        input_set: U; the paper's box |u_i| ≤ 5 unless given.
        solver: "daqp", "clarabel", or any solver that qpsolvers finds installed.
        program_options: among :func:`options`.

    Raises:
        UnknownNameError: on an unknown program or solver; the message lists the choices.
        InvalidInputError: on an unknown option or a value that the program refuses.
    """
    kind = choose("program", name, _PROGRAMS)
    check_options(f"program {name}", program_options, kind.options)
    return kind(Box.symmetric(5.0) if input_set is None else input_set, solver, **program_options)


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
        InvalidInputError: on an unknown option, a value that the program refuses, or an input set
            that is not planar.
    """
    return BatchProgram(make(name, input_set=input_set, **program_options))
