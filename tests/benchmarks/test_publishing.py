"""Published figures: what is kept with them, and how the pages follow them."""

import json
from pathlib import Path

import pytest

from benchmarks import publishing
from benchmarks.__main__ import main
from benchmarks.registry import SUITES
from hcbf_gym import certificates, sources, version
from hcbf_gym.errors import InvalidInputError, MissingDependencyError, UnknownNameError

PAGE = "before\n<!-- results: course/all -->\nold\n<!-- end of results -->\nafter\n"
ROOT = Path(publishing.__file__).parents[1]
COURSE = json.loads((ROOT / "docs/results/course.json").read_text(encoding="utf-8"))
ROW = COURSE["figures"]["rows"][0] | {"min_h": [0.125, 1.0, 1.0, -1.0]}


@pytest.fixture
def checkout(tmp_path):
    for folder in ("docs/results", "hcbf_gym"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "README.md").write_text(PAGE)
    (tmp_path / "docs" / "page.md").write_text("no table\n")
    return tmp_path


def test_a_page_is_filled_from_its_results_and_differs_when_they_change(checkout):
    publishing.publish(checkout, "course", {"rows": [ROW]})
    assert publishing.fill(checkout) == [checkout / "README.md"]
    text = (checkout / "README.md").read_text()
    assert text.startswith("before\n<!-- results: course/all -->\n")
    assert text.endswith("<!-- end of results -->\nafter\n")
    assert "| +0.125 |" in text
    assert "old" not in text
    assert publishing.fill(checkout) == []
    publishing.publish(checkout, "course", {"rows": [ROW | {"min_h": [0.25, 1.0, 1.0, 1.0]}]})
    assert [page for page, _ in publishing.differing(checkout)] == [checkout / "README.md"]
    with pytest.raises(SystemExit, match=r"README\.md"):
        main(["--check", "--root", str(checkout)])


def test_tables_whose_module_needs_a_missing_extra_name_its_install_command(checkout, monkeypatch):
    publishing.publish(checkout, "reproduction", {})

    def lacks(self, figures):
        raise ModuleNotFoundError("No module named 'optuna'", name="optuna")

    monkeypatch.setattr(type(SUITES["reproduction"]), "tables", lacks)
    with pytest.raises(
        MissingDependencyError, match=r"no optuna, expected the extra studies: pip install"
    ):
        publishing.check_results(checkout, but=["ground-truth"])


def test_results_say_what_they_came_from_and_are_listed_when_their_sources_change(checkout):
    publishing.publish(checkout, "course", {"rows": [ROW]})
    path = checkout / "docs" / "results" / "course.json"
    record = json.loads(path.read_text())
    assert record["command"] == "python -m benchmarks --suite course --publish"
    assert {"commit", "date", "machine", "sources", "figures"} <= set(record)
    assert publishing.stale(checkout) == []
    path.write_text(json.dumps(record | {"sources": "those of last year"}))
    assert publishing.stale(checkout) == ["course"]


def test_a_page_that_names_missing_figures_is_refused_and_no_page_changes(checkout):
    with pytest.raises(InvalidInputError, match=r"course\.json"):
        publishing.fill(checkout)
    publishing.publish(checkout, "course", {"rows": [ROW]})
    (checkout / "docs" / "page.md").write_text(PAGE.replace("course/all", "course/none"))
    with pytest.raises(UnknownNameError, match="all"):
        publishing.fill(checkout)
    assert (checkout / "README.md").read_text() == PAGE


def test_a_table_that_awaits_its_figures_stays_until_they_are_published(checkout):
    waiting = PAGE.replace("results: course", "awaits: course")
    (checkout / "README.md").write_text(waiting)
    assert publishing.fill(checkout) == []
    publishing.publish(checkout, "course", {"rows": [ROW]})
    assert publishing.fill(checkout) == [checkout / "README.md"]
    assert "| +0.125 |" in (checkout / "README.md").read_text()
    assert "awaits" not in (checkout / "README.md").read_text()
    (checkout / "README.md").write_text(waiting.replace("course/all", "no-such/all"))
    with pytest.raises(UnknownNameError, match="no-such"):
        publishing.fill(checkout)


def test_figures_that_lack_what_a_table_shows_are_refused_before_a_run(checkout):
    publishing.publish(checkout, "course", {"rows": [{"program": "none"}]})
    with pytest.raises(InvalidInputError, match=r"course\.json without .*--suite course"):
        publishing.fill(checkout)
    arguments = ["--suite", "soak", "--publish", "--output", str(checkout / "out")]
    for options in (["--check"], arguments):
        with pytest.raises(SystemExit, match="--suite course --publish"):
            main([*options, "--root", str(checkout)])
    assert (checkout / "README.md").read_text() == PAGE
    assert not (checkout / "out").exists()
    publishing.check_results(checkout, but=["course"])


def test_only_full_figures_of_known_suites_in_a_checkout_are_published(tmp_path):
    for arguments, message in (
        (["--suite", "course", "--publish", "--quick"], "full run"),
        (["--suite", "course", "--publish", "--root", str(tmp_path)], "checkout"),
        (["--suite", "speed"], "programs"),
    ):
        with pytest.raises(SystemExit, match=message):
            main([*arguments, "--output", str(tmp_path / "out")])
    assert not list(tmp_path.iterdir())


def test_the_sources_of_a_suite_are_those_it_imports_and_those_it_loads_by_name():
    hashes = {name: suite.sources() for name, suite in SUITES.items()}
    assert len(set(hashes.values())) == len(hashes)
    course = SUITES["course"]
    assert course.sources() != course._replace(also=()).sources()


def test_figures_of_a_candidate_are_those_of_its_release(monkeypatch):
    hashes = []
    for number in ("0.2.0rc1", "0.2.0", "0.2.0.dev0"):
        monkeypatch.setattr(version, "VERSION", number)
        sources._packages_hash.cache_clear()
        hashes.append(SUITES["course"].sources())
    sources._packages_hash.cache_clear()
    assert hashes[0] == hashes[1] != hashes[2]


@pytest.mark.parametrize("page", ["guarantees.md", "certificates.md"])
def test_pages_show_the_certificates_and_what_they_cover(page):
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    assert publishing.certified(ROOT, text) == text
    if page == "guarantees.md":
        assert all(f"| {name} |" in text for name in certificates.shipped())
    with pytest.raises(InvalidInputError, match="no/such"):
        publishing.certified(ROOT, "<!-- coverage: no/such.json -->\n<!-- end of coverage -->")
