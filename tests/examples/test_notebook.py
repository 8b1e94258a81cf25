"""The notebook runs from top to bottom, and shows its figure as a picture."""

import ast
import json
import sys
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[2] / "examples" / "own_environment.ipynb"


def shown(code, names):
    """Run a cell as a notebook does, and return the value of its last expression."""
    *first, last = ast.parse(code).body
    if not isinstance(last, ast.Expr):
        first, last = [*first, last], None
    exec(compile(ast.Module(first, []), "cell", "exec"), names)
    if last is None:
        return None
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


@pytest.mark.physics
def test_the_notebook_leads_from_an_environment_to_a_certificate(
    tmp_path, monkeypatch, recwarn, released
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)  # as Jupyter finds what lies beside a notebook
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    cells = ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code"]
    names: dict = {}
    values = [shown(cell, names) for cell in cells]
    pictures = [value for value in values if hasattr(value, "_repr_png_")]
    assert len(pictures) == 1
    assert pictures[0]._repr_png_()[:4] == b"\x89PNG"
    assert "of fresh episodes" in str(values) or "P(enter)" in str(values)
    assert values[-1] == 1  # covered by its certificate
    sys.modules.pop("raft", None)


def test_the_notebook_is_kept_without_outputs():
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert not any(cell.get("outputs") for cell in notebook["cells"])
