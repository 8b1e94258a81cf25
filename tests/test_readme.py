"""What README and docs show is run as it stands there."""

import importlib
import json
import re
import shlex
import tomllib
from pathlib import Path

import gymnasium as gym
import pytest
import tyro
from needs import imported, needs

from benchmarks import publishing
from benchmarks.__main__ import PICTURES
from benchmarks.pictures import gallery
from benchmarks.registry import SUITES
from hcbf_gym import scenarios
from hcbf_gym.cli import COMMANDS
from hcbf_gym.errors import MissingDependencyError
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers import SafetyFilter

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page, language):
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


@pytest.mark.physics
def test_the_readmes_code_runs_and_does_what_it_says():
    names: dict = {}
    loop, vector, alone = blocks("README.md", "python")
    exec(loop, names)
    assert set(names["info"]["safety_filter"]) >= {"u_nominal", "u_safe", "slack", "status"}
    assert names["truncated"]
    assert not names["terminated"]
    exec(vector, names)
    names["envs"].reset(seed=0)
    exec(alone, names)
    result = names["result"]
    assert result.u == pytest.approx([1.0, 0.0], abs=1e-9)
    assert result.slack == pytest.approx([0.0, 1.5], abs=1e-9)
    assert result.status == FilterStatus.RELAXED


def test_the_environments_page_runs_and_its_scene_loads(tmp_path):
    names: dict = {}
    exec(blocks("docs/environments.md", "python")[0], names)
    assert "safety_filter" in names["info"]
    (scene,) = blocks("docs/environments.md", "json")
    assert scenarios.make(json.loads(scene)).name == "one disc"
    env = SafetyFilter(gym.make("HCBF-Regions-v0", scenario=json.loads(scene)))
    env.reset(seed=0)
    env.step(env.action_space.sample())


@pytest.mark.physics
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=needs(*imported("".join(blocks(page, "python")))))
        for page in sorted((ROOT / "docs").rglob("*.md"))
    ],
    ids=lambda page: page.stem,
)
def test_every_block_of_python_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for scene in blocks(page, "json"):
        Path("scene.json").write_text(scene, encoding="utf-8")  # as the page says
    names: dict = {}
    for block in blocks(page, "python"):
        exec(block, names)


def shown_commands(page):
    """Yield what every command that a page shows runs: a module, and the words that it is given."""
    text = page.read_text(encoding="utf-8")
    lines = re.findall(r"`((?:hcbf |python scripts/|python -m benchmarks\b(?!\.))[^`\n]*)`", text)
    for block in re.findall(r"```bash\n(.*?)```", text, flags=re.DOTALL):
        lines += re.split(r"\n|&&", block.replace("\\\n", " "))
    for line in lines:
        match shlex.split(line.replace("NAME", "course"), comments=True):
            case ["python", "-m", "benchmarks", picture, *rest] if picture in PICTURES:
                yield PICTURES[picture], rest
            case ["python", "-m", "benchmarks", *rest]:
                yield "benchmarks.command", rest
            case ["python", script, *rest]:
                called = re.search(r'main\(\["([a-z-]+)"', (ROOT / script).read_text("utf-8"))
                if called:
                    yield COMMANDS[called[1]].module, rest
            case ["hcbf", name, *rest]:
                yield COMMANDS[name].module, rest


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_that_is_shown_is_understood(page):
    missing = {}
    for name, rest in shown_commands(page):
        try:
            module = importlib.import_module(name)
        except MissingDependencyError as error:
            missing[name] = str(error)
            continue
        if rest != ["--help"]:
            args = tyro.cli(module.Args, args=rest)
            assert set(getattr(args, "suite", ())) <= {*SUITES, "all"}
    if missing:
        pytest.skip("; ".join(missing.values()))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_extra_that_is_named_exists(page):
    with open(ROOT / "pyproject.toml", "rb") as file:
        extras = set(tomllib.load(file)["project"]["optional-dependencies"])
    text = page.read_text(encoding="utf-8")
    for named in re.findall(r"(?:\.|hcbf-gym)\[([a-z,]+)\]", text):
        assert set(named.split(",")) <= extras


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_block_that_says_no_language_is_a_formula_or_a_drawing(page):
    text = page.read_text(encoding="utf-8")
    parts = re.findall(r"^ *```(\w*)\n(.*?)^ *```$", text, flags=re.DOTALL | re.MULTILINE)
    for language, block in parts:
        assert language in {"", "bash", "python", "json", "yaml"}
        runs = re.search(r"^ *(?:pip|hcbf|python|import|from|env|\w+\.\w+\()", block, re.MULTILINE)
        assert language or not runs, block


def test_the_site_lists_every_page():
    with open(ROOT / "zensical.toml", "rb") as file:
        listed = re.findall(r"'([\w/]+\.md)'", str(tomllib.load(file)["project"]["nav"]))
    pages = {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")}
    assert sorted(listed) == sorted(pages)


def test_every_loop_is_shown_and_all_together_are_small():
    files = {path.stem: path for path in (ROOT / "docs/images/gallery").glob("*.webp")}
    assert set(files) == set(gallery.LOOPS)
    page = (ROOT / "docs/gallery.md").read_text(encoding="utf-8")
    assert all(f"images/gallery/{name}.webp" in page for name in files)
    assert sum(path.stat().st_size for path in files.values()) < 10e6


def test_every_suite_is_listed():
    page = (ROOT / "docs/benchmarks.md").read_text(encoding="utf-8")
    assert [name for name in SUITES if f"`{name}`" not in page] == []


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_every_registry_that_is_named_exists(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    named = re.findall(r"`(\w+)` in `([\w/]+)\.py`", text)
    assert named
    for registry, file in named:
        name = file.removesuffix("/__init__").replace("/", ".")
        inside = name.startswith(("hcbf_gym.", "benchmarks."))
        module = importlib.import_module(name if inside else f"hcbf_gym.{name}")
        assert hasattr(module, registry), f"{registry} in {file}.py"


def headings(page):
    """The anchors of a page, as the site's generator and code hosts make them."""
    titles = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title).strip().lower().replace(" ", "-") for title in titles}


def test_every_link_of_the_pages_leads_somewhere():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for target, anchor in re.findall(r"\]\((?!http)([^)#]*)(?:#([^)]+))?\)", text):
            linked = page.parent / target if target else page
            assert linked.exists(), f"{page.name}: {target}"
            assert not anchor or anchor in headings(linked), f"{page.name}: {target}#{anchor}"


@needs("cbfpy")  # the suites that publish the tables import it
def test_every_table_is_that_of_its_results_and_every_result_is_known():
    assert not [str(page) for page, _ in publishing.differing(ROOT)]
    assert {path.stem for path in (ROOT / "docs" / "results").glob("*.json")} <= set(SUITES)
    assert "<!-- results: course/all -->" in (ROOT / "README.md").read_text(encoding="utf-8")
