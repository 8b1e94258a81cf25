"""The notebook runs from top to bottom, leaves no file, and is stored with its outputs."""

import ast
import base64
import json
import os
import re
import sys
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[2] / "examples" / "own_environment.ipynb"


LARGEST = 400_000
"""Of the notebook with its outputs [bytes]."""


def code_cells():
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


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
def test_the_notebook_leads_from_an_environment_to_a_certificate_and_leaves_no_file(
    tmp_path, monkeypatch, recwarn, released
):
    monkeypatch.chdir(tmp_path)  # as Jupyter starts beside the notebook
    monkeypatch.setattr(sys, "path", [*sys.path])
    names: dict = {}
    try:
        values = [shown("".join(cell["source"]), names) for cell in code_cells()]
        assert list(tmp_path.iterdir()) == []
    finally:
        sys.modules.pop("raft", None)
        os.chdir(tmp_path)
        if "folder" in names:
            names["folder"].cleanup()
    pictures = [value for value in values if hasattr(value, "_repr_png_")]
    assert len(pictures) == 1
    assert pictures[0]._repr_png_()[:4] == b"\x89PNG"
    assert "P(enter)" in str(values)
    assert values[-1] == (1, "NONE")  # covered by its certificate


def test_the_notebook_is_kept_with_its_outputs():
    pictures = 0
    for cell in code_cells():
        source, outputs = "".join(cell["source"]), cell["outputs"]
        ends_in_a_value = isinstance(ast.parse(source).body[-1], ast.Expr)
        assert bool(outputs) == (ends_in_a_value or "print(" in source), source
        assert not [output for output in outputs if output["output_type"] == "error"]
        assert not [output for output in outputs if output.get("name") == "stderr"]
        for output in outputs:
            if picture := output.get("data", {}).pop("image/png", None):
                assert base64.b64decode(picture)[:4] == b"\x89PNG"
                pictures += 1
    assert pictures == 1
    assert NOTEBOOK.stat().st_size <= LARGEST


def test_the_outputs_of_the_notebook_name_no_machine_and_no_time():
    for cell in code_cells():
        for output in cell["outputs"]:
            output.get("data", {}).pop("image/png", None)
        kept = json.dumps([cell["outputs"], cell["metadata"]])
        assert not re.search(r"[\s\"'](?:/\w+/|~/|[A-Z]:\\)", kept)
        assert not re.search(r"\d\d:\d\d|iopub", kept)
