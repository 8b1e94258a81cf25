"""A figure beside what is asked of it."""

from typing import NamedTuple


class Measure(NamedTuple):
    """One line of the table.

    Attributes:
        section: what is measured.
        name: under which circumstances.
        value: the figure.
        unit: of the value.
        bound: what is asked, None for a figure that is only reported.
        at_least: whether the bound is a lower one.
    """

    section: str
    name: str
    value: float
    unit: str
    bound: float | None = None
    at_least: bool = False

    @property
    def met(self) -> bool | None:
        """Whether the bound holds; None if there is none."""
        if self.bound is None:
            return None
        return bool(self.value >= self.bound if self.at_least else self.value <= self.bound)
