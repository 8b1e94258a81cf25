"""Figures that cannot go stale: kept with what they came from, and the pages filled from them.

``docs/results/SUITE.json`` holds a suite's figures with the command, the commit, the date, the
machine and the hash of the sources that they depend on. A page marks the place of a table,
and nothing else::

    <!-- results: SUITE/TABLE -->
    <!-- end of results -->

``awaits`` in the place of ``results`` keeps the text there until the suite is published.
``certificates: FOLDER`` and ``coverage: FILE`` show the certificates in a folder, and what one of
them covers; both are paths below the package or the checkout.
"""

import datetime
import json
import os
import platform
import re
import subprocess
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from benchmarks.common import table
from benchmarks.registry import SUITES
from hcbf_gym import certificates
from hcbf_gym.certificates import Certificate
from hcbf_gym.certificates.ranges import parse_range
from hcbf_gym.errors import InvalidInputError, MissingDependencyError, choose, install
from hcbf_gym.evaluation.output_folder import write_json, write_text
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.sources import NAMES, PACKAGES

_MARKED = re.compile(
    r"<!-- (results|awaits): ([\w-]+)/([^>]+?) -->\n.*?<!-- end of results -->", re.DOTALL
)
_CERTIFIED = re.compile(
    r"<!-- (certificates|coverage): ([^>]+?) -->\n.*?<!-- end of \1 -->", re.DOTALL
)


def publish(root: Path, name: str, figures: dict[str, Any]) -> None:
    """Write a suite's figures to ``docs/results/`` of a checkout."""
    check_root(root)
    changed = _git(root, "status", "--porcelain", "--", *NAMES, "benchmarks")
    record = {
        "suite": name,
        "command": f"python -m benchmarks --suite {name} --publish",
        "commit": _git(root, "rev-parse", "--short", "HEAD"),
        "changed_since_commit": bool(changed),
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "machine": machine(),
        "sources": SUITES[name].sources(),
        "figures": figures,
    }
    write_json(_results(root, name), record)


def check_root(root: Path) -> None:
    """Refuse a folder that is no checkout of this project."""
    if not (root / "docs" / "results").is_dir() or not (root / "hcbf_gym").is_dir():
        raise InvalidInputError(
            f"publish: got the folder {root.resolve()}, expected a checkout of hcbf-gym"
        )


def check_results(root: Path, but: Collection[str]) -> None:
    """Refuse a checkout whose pages could not be filled after a run."""
    for path in sorted((root / "docs" / "results").glob("*.json")):
        if path.stem in SUITES and path.stem not in but:
            _published(root, path.stem)


def fill(root: Path) -> list[Path]:
    """Fill every table of README and docs from its JSON; return the pages that changed."""
    changed = dict(differing(root))
    for page, text in changed.items():
        write_text(page, text)
    return list(changed)


def differing(root: Path) -> Iterator[tuple[Path, str]]:
    """Yield every page whose tables are not those of the JSONs, with the text it should have."""
    check_root(root)
    shown = {}

    def filled_table(match: re.Match[str]) -> str:
        kind, name, which = match.groups()
        choose("suite", name, SUITES)
        if kind == "awaits" and not _results(root, name).is_file():
            return match[0]
        if name not in shown:
            shown[name] = _published(root, name)
        text = choose(f"table of {name}", which, shown[name])
        return f"<!-- results: {name}/{which} -->\n{text}\n<!-- end of results -->"

    files = [root / "README.md", *sorted((root / "docs").rglob("*.md"))]
    pages = {page: page.read_text(encoding="utf-8") for page in files}
    for page, text in pages.items():
        filled = certified(root, _MARKED.sub(filled_table, text))
        if filled != text:
            yield page, filled


def certified(root: Path, text: str) -> str:
    """Return a page's text with its tables of certificates as they are now."""

    def fill_one(match: re.Match[str]) -> str:
        kind, name = match.groups()
        place = next((top / name for top in (*PACKAGES, root) if (top / name).exists()), None)
        if place is None:
            raise InvalidInputError(f"{kind}: got {name!r}, expected a path of the checkout")
        shown = certified_table(place) if kind == "certificates" else covered_table(place)
        return f"<!-- {kind}: {name} -->\n\n{shown.markdown()}\n\n<!-- end of {kind} -->"

    return _CERTIFIED.sub(fill_one, text)


def certified_table(folder: Path) -> Table:
    """Return a line for each certificate in a folder."""
    columns = {
        "certificate": "{c.name}", "episodes": "{c.episodes:,}", "entered": "{c.entered}",
        "P(enter) ≤": "{c.bound:.2g}", "confidence": "{c.confidence:.1%}",
        "least h [m]": "{c.least_h:+.4f}", "version": "{c.version}", "commit": "{c.commit}",
    }  # fmt: skip
    loaded = ({"c": Certificate.load(file)} for file in sorted(folder.glob("*.json")))
    return table("certificates", loaded, columns)


def covered_table(file: Path) -> Table:
    """Return what a certificate covers, and what was tested besides."""
    plant = Certificate.load(file).plant
    none: dict[str, Any] = {"ranges": {}, "words": "none"}
    alone = certificates.tested()["alone"].get(plant["environment"], none)
    ranges = dict(plant) | alone["ranges"]
    arguments = [name for name in ranges if name not in ("environment", "scene")]
    rows = [(name, parse_range(ranges[name], {}).words) for name in arguments]
    return Table("covered", ("argument", "tested"), [*rows, ("alone", alone["words"])])


def stale(root: Path) -> list[str]:
    """Return the names of the suites whose sources have changed since their figures were taken."""
    names = []
    for path in sorted((root / "docs" / "results").glob("*.json")):
        suite = SUITES.get(path.stem)
        known = json.loads(path.read_text(encoding="utf-8"))["sources"]
        if suite is None or suite.sources() != known:
            names.append(path.stem)
    return names


def machine() -> str:
    """Return this machine in words, without its name or address."""
    try:
        info = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        found = re.search(r"^model name\s*:\s*(.+)$", info, re.M)
    except OSError:
        found = None
    model = found.group(1) if found else platform.machine()
    python = ".".join(platform.python_version_tuple()[:2])
    return f"{os.cpu_count()} cores of {model}, {platform.system()}, Python {python}"


def _results(root: Path, name: str) -> Path:
    return root / "docs" / "results" / f"{name}.json"


def _published(root: Path, name: str) -> dict[str, str]:
    """Return a published suite's tables as Markdown, each with where it came from."""
    path = _results(root, name)
    if not path.is_file():
        raise InvalidInputError(f"results: got no {path.name}, expected it in docs/results")
    record = json.loads(path.read_text(encoding="utf-8"))
    changed = " with changes" if record["changed_since_commit"] else ""
    came = (
        f"`--suite {name}`, commit {record['commit']}{changed}, "
        f"{record['date']}; {record['machine']}."
    )
    suite = SUITES[name]
    try:
        tables = suite.tables(record["figures"])
    except ModuleNotFoundError as error:  # pages show the tables of every suite
        raise MissingDependencyError(
            f"table of {name}: got no {error.name}, expected the extra {suite.extra}: "
            f"{install(suite.extra)}"
        ) from error
    except (AttributeError, KeyError, IndexError, TypeError) as error:
        # The suite has changed since.
        raise InvalidInputError(
            f"results: got {path.name} without what the suite's tables show "
            f"({type(error).__name__}: {error}), expected the figures of the present suite: take "
            f"them again with `python -m benchmarks --suite {name} --publish`"
        ) from error
    return {which: f"\n{table.markdown()}\n\n*{came}*\n" for which, table in tables.items()}


def _git(root: Path, *arguments: str) -> str:
    done = subprocess.run(
        ["git", *arguments], cwd=root, capture_output=True, text=True, check=False
    )
    return done.stdout.strip() or ("" if done.returncode == 0 else "unknown")
