"""Tables for a terminal and for pages."""

from collections.abc import Sequence
from typing import NamedTuple

from rich.markup import escape
from rich.table import Table as RichTable


class Table(NamedTuple):
    """A table of text: a title, the names of the columns, and rows with a cell for each column."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def markdown(self) -> str:
        """Return the table as Markdown; all columns but the first are aligned to the right."""
        rule = ["---", *["---:"] * (len(self.header) - 1)]
        return "\n".join(
            "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"
            for row in (self.header, rule, *self.rows)
        )

    def rich(self) -> RichTable:
        """Return the table for a terminal."""
        table = RichTable(title=escape(self.title))
        for k, name in enumerate(self.header):
            table.add_column(escape(name), justify="right" if k else "left", overflow="fold")
        for row in self.rows:
            table.add_row(*map(escape, row))
        return table
