"""Count what a reader of the package meets: `python -m benchmarks.house --against REVISION`.

Of `hcbf_gym` without `studies`, which are built on everything else.
"""

import ast
import io
import re
import statistics
import sys
import tempfile
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import tyro
from rich.console import Console
from scipy.sparse.csgraph import connected_components

from benchmarks.history import ROOT, take_out
from hcbf_gym.errors import HcbfError, InvalidInputError
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.sources import NAMES

MANY = 8
"""Parameters, above which a function has many."""
LONG = 60
"""Lines, above which a function is long."""

_ANY = re.compile(r"\bAny\b")
_ALIAS = re.compile(r"^\w+ = NDArray\[", re.MULTILINE)
_BLANK = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)
_BLANK += (tokenize.ENCODING, tokenize.ENDMARKER)

Function = ast.FunctionDef | ast.AsyncFunctionDef


def sources(root: Path) -> list[Path]:
    """Return the packages' files in a checkout."""
    return [f for name in NAMES for f in (root / name).rglob("*.py")]


def deleted(then: Path, now: Path) -> str:
    """Return how many lines of the package then stand nowhere in the checkout now, in words.

    A line that has moved, be it to the evidence or to a test, is not deleted; nor is one that is
    indented in another way.

    Args:
        then: the package before, see `count`.
        now: the checkout.
    """
    places = (*NAMES, "benchmarks", "tests", "examples", "scripts")
    here = [file for place in places for file in (now / place).rglob("*.py")]
    before = _lines(sources(then))
    return f"{(before - _lines(here)).total():,} of {before.total():,}"


def _lines(files: list[Path]) -> Counter[str]:
    """Return how often each line stands in files; blank ones do not count."""
    lines = (line.strip() for f in files for line in f.read_text(encoding="utf-8").splitlines())
    return Counter(line for line in lines if line)


def count(root: Path) -> dict[str, str]:
    """Return what is counted in a checkout, in words.

    Args:
        root: the checkout.

    Raises:
        InvalidInputError: if it holds no package.
    """
    files = sources(root)
    if not files:
        raise InvalidInputError(f"house: got {root}, expected a checkout with hcbf_gym/ in it")
    texts = [file.read_text(encoding="utf-8") for file in files]
    nodes = [node for text in texts for node in ast.walk(ast.parse(text))]
    functions = [node for node in nodes if isinstance(node, Function)]
    lengths = {node: (node.end_lineno or 0) - node.lineno + 1 for node in functions}
    longest = max(functions, key=lengths.__getitem__)
    assignments = [node for node in nodes if isinstance(node, ast.Assign)]
    outside = sorted(set(_imported(nodes)) - set(sys.stdlib_module_names) - set(NAMES))
    several = sum(_several(node) for node in assignments)
    edges = set(_edges(root, files, texts))
    return {
        "files": f"{len(files)}",
        "lines": f"{sum(len(text.splitlines()) for text in texts):,}",
        "lines of code": f"{sum(map(_lines_of_code, texts)):,}",
        "functions": f"{len(functions):,}",
        "longest function": f"{lengths[longest]} lines, {longest.name}",
        "median function": f"{statistics.median(lengths.values()):g} lines",
        f"functions over {LONG} lines": f"{sum(n > LONG for n in lengths.values())}",
        f"functions over {MANY} parameters": f"{sum(_parameters(f) > MANY for f in functions)}",
        "several-part assignments": f"{several} of {len(assignments)}, "
        f"{several / len(assignments):.1%}",
        "Any": f"{sum(len(_ANY.findall(text)) for text in texts)}",
        "aliases of arrays elsewhere": f"{sum(map(_aliases, files, texts))}",
        "circles of imports": f"{_circles(edges)}",
        "imports upwards": f"{_upwards(root, edges)}",
        "lines of tests": f"{_length(root / 'tests'):,}",
        "lines of benchmarks": f"{_length(root / 'benchmarks'):,}",
        "imported from outside": f"{len(outside)}: {', '.join(outside)}",
        "words of README": f"{len((root / 'README.md').read_text(encoding='utf-8').split()):,}",
    }


def _lines_of_code(text: str) -> int:
    """Return the number of lines that hold more than a comment or a docstring."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _BLANK:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(getattr(node.value, "value", None), str):
            lines.difference_update(range(node.lineno, (node.end_lineno or 0) + 1))
    return len(lines)


def _parameters(function: Function) -> int:
    """Return how many parameters a caller meets; neither self nor cls."""
    given = function.args
    named = [arg.arg for arg in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len([name for name in named if name not in ("self", "cls")])


def _several(assignment: ast.Assign) -> bool:
    """Return whether a tuple written out is assigned to names written out."""
    return isinstance(assignment.value, ast.Tuple) and isinstance(assignment.targets[0], ast.Tuple)


def _imported(nodes: list[ast.AST]) -> Iterator[str]:
    """Yield the first name of every module that is imported."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield (node.module or "").partition(".")[0]


def _length(folder: Path) -> int:
    """Return the lines of the Python files in a folder."""
    files = folder.rglob("*.py")
    return sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)


def _aliases(file: Path, text: str) -> int:
    """Return how many names of kinds of arrays a file gives that is not the one for them."""
    return 0 if file.name == "arrays.py" else len(_ALIAS.findall(text))


def _edges(root: Path, files: list[Path], texts: list[str]) -> Iterator[tuple[str, str]]:
    """Yield (module, module it imports), under TYPE_CHECKING and in functions, too.

    What a package's own `__init__` hands on is no edge: it imports all that is below it.
    """
    names = {".".join(file.relative_to(root).with_suffix("").parts): file for file in files}
    for (name, _), text in zip(names.items(), texts, strict=True):
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and not name.endswith("__init__"):
                found = {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
                yield from ((name, one) for one in found & names.keys())


def _circles(edges: set[tuple[str, str]]) -> int:
    """Return how many groups of modules import each other."""
    index = {name: k for k, name in enumerate(sorted({name for edge in edges for name in edge}))}
    graph = np.zeros((len(index), len(index)), dtype=np.int8)
    for one, other in edges:
        graph[index[one], index[other]] = 1
    _, groups = connected_components(graph, connection="strong") if index else (0, [])
    return sum(size > 1 for size in Counter(map(int, groups)).values())


def _upwards(root: Path, edges: set[tuple[str, str]]) -> int:
    """Return how many imports go against the layers that `pyproject.toml` states."""
    file = root / "pyproject.toml"
    tools = tomllib.loads(file.read_text(encoding="utf-8"))["tool"] if file.exists() else {}
    contracts = tools.get("importlinter", {}).get("contracts", [])
    layers = next((one["layers"] for one in contracts if one["type"] == "layers"), [])
    level = {room: k for k, layer in enumerate(layers) for room in re.findall(r"\w+", layer)}
    rooms = [(one.split(".")[1], other.split(".")[1]) for one, other in edges]
    return sum(level.get(low, 0) > level.get(high, len(level)) for low, high in rooms)


def main(path: tyro.conf.Positional[Path] = ROOT, against: str = "") -> None:
    """Print the counts.

    Args:
        path: the checkout.
        against: a revision of this checkout, counted beside it; none without one.
    """
    columns = {"now": count(path)}
    if against:
        with tempfile.TemporaryDirectory() as folder:
            places = (*NAMES, "tests", "benchmarks", "README.md", "pyproject.toml")
            take_out(against, Path(folder), *places)
            columns = {against: count(Path(folder))} | columns
            columns[against]["lines deleted since"] = deleted(Path(folder), path)
    names = max(columns.values(), key=len)
    rows = [(name, *(column.get(name, "") for column in columns.values())) for name in names]
    Console().print(Table("hcbf_gym without studies", ("", *columns), rows).rich())


if __name__ == "__main__":
    try:
        tyro.cli(main, description=__doc__)
    except HcbfError as error:
        sys.exit(f"error: {error}")
