"""Filters without an environment."""

from hcbf_gym.filter.core import FilterCore
from hcbf_gym.filter.settings import FilterSettings


def core_of(
    plant, program="lex-cbf-qp", count=None, *, rows="held", guidance=None, solver=None,
    on_alarm="warn", input_set=None, **options,
):  # fmt: skip
    """Return the filter of a plant, or of so many."""
    settings = FilterSettings(program, rows, guidance, None, solver, on_alarm, True, options)
    return FilterCore(plant, input_set or plant.input_set, settings, count)
