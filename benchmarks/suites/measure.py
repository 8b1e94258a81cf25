"""A figure beside what is asked of it."""

from typing import NamedTuple


class Measure(NamedTuple):
    """One line of the table."""

    section: str  # what is measured
    name: str  # under which circumstances
    value: float  # the figure
    unit: str  # of the value
    bound: float | None = None  # what is asked, None for a figure that is only reported
    at_least: bool = False  # whether the bound is a lower one

    @property
    def met(self) -> bool | None:
        """Whether the bound holds; None if there is none."""
        if self.bound is None:
            return None
        return bool(self.value >= self.bound if self.at_least else self.value <= self.bound)
