"""What README and docs show is run as it stands there."""

import ast
import importlib
import json
import re
import shlex
import shutil
import tomllib
from pathlib import Path

import gymnasium as gym
import pytest
import tyro
from needs import imported, needs

import hcbf_gym
from benchmarks import publishing
from benchmarks.__main__ import PICTURES
from benchmarks.pictures import gallery
from benchmarks.registry import SUITES
from hcbf_gym import cli, scenarios
from hcbf_gym.cli import commands
from hcbf_gym.errors import MissingDependencyError
from hcbf_gym.wrappers import SafetyFilter

ROOT = Path(__file__).parent.parent
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if page.parent.name != "api"),
]

EXTRA = r"(?:\.|hcbf-gym)\[([a-z,]+)\]"


def read(page):
    return page.read_text(encoding="utf-8")


def blocks(page, language):
    return re.findall(rf"```{language}\n(.*?)```", read(ROOT / page), flags=re.DOTALL)


def pages_with(pattern):
    """Return the pages in whose text a pattern is found: the others would pass any test of it."""
    return [page for page in PAGES if re.search(pattern, read(page))]


def named(page):
    """Return a page's path, which distinguishes evidence/guidance from guidance."""
    return str(page.relative_to(ROOT).with_suffix(""))


def test_the_readme_is_short():
    assert len(read(ROOT / "README.md").split()) <= 450


def test_readme_site_and_package_have_one_pitch():
    with open(ROOT / "pyproject.toml", "rb") as file:
        project = tomllib.load(file)["project"]
    with open(ROOT / "zensical.toml", "rb") as file:
        site = tomllib.load(file)["project"]["site_description"]
    for text in (site, hcbf_gym.__doc__, read(ROOT / "README.md"), read(ROOT / "docs/index.md")):
        assert project["description"] in " ".join(text.split())


def test_readme_clones_from_the_address_of_the_project():
    with open(ROOT / "pyproject.toml", "rb") as file:
        address = tomllib.load(file)["project"]["urls"]["Repository"]
    assert f"git clone {address}`" in read(ROOT / "README.md")


@pytest.mark.physics
def test_the_readmes_code_runs_and_does_what_it_shows(released, capsys):
    names: dict = {}
    (loop,) = blocks("README.md", "python")
    exec(loop, names)
    assert names["info"]["is_success"]
    assert names["info"]["safety_filter"]["covered"] == 1
    assert names["info"]["min_h"][:2].min() > 0.0  # the two walls
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "arrived: True"
    assert len(printed) == 1 + len(names["env"].conditions)
    assert re.fullmatch(r"wall 1, rank 1: least h \d\.\d+ m", printed[1])
    (shown,) = re.findall(r"reads `(.*?)`", read(ROOT / "README.md"))
    assert shown in printed


def test_the_readmes_figure_is_that_of_the_certificate():
    figures = r"rank 1 in (\d+) of ([\d,]+) fresh episodes: at most ([\d.]+) %, with ([\d.]+) %"
    found = re.search(figures, read(ROOT / "README.md"))
    assert found
    cart = json.loads(read(ROOT / "hcbf_gym/certificates/shipped/cart.json"))
    figures = [cart["entered"], cart["episodes"], 100 * cart["bound"], 100 * cart["confidence"]]
    assert [float(one.replace(",", "")) for one in found.groups()] == pytest.approx(figures)


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
        for page in pages_with("```python")
        if page.name != "README.md"
    ],
    ids=named,
)
def test_every_block_of_python_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for scene in blocks(page, "json"):
        Path("scene.json").write_text(scene, encoding="utf-8")  # as the page writes it
    names: dict = {}
    for block in blocks(page, "python"):
        exec(block, names)


HOW_TOS = ["my_map", "my_policy", "my_film", "my_curves"]


@pytest.mark.physics
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=needs(*imported("".join(blocks(f"docs/{name}.md", "python")))))
        for name in HOW_TOS
    ],
)
def test_a_how_to_does_what_it_shows_from_top_to_bottom(name, tmp_path, monkeypatch):
    """Its Python and its commands run in their order; of the playground all but the page."""
    monkeypatch.chdir(tmp_path)
    text, names = read(ROOT / "docs" / f"{name}.md"), {}
    for language, block in re.findall(r"```(python|bash)\n(.*?)```", text, flags=re.DOTALL):
        if language == "python":
            exec(block, names)
            continue
        for line in block.replace("\\\n", " ").splitlines():
            program, *rest = shlex.split(line, comments=True) or [""]
            assert program == "hcbf", line
            if rest[0] in UNTIL:
                begin(commands()[rest[0]].module, rest[1:], monkeypatch)
            else:
                cli.main([*rest, *(["--workers", "1", "--overwrite"] * (rest[0] == "evaluate"))])


def test_a_how_to_fits_a_screen():
    for name in HOW_TOS:
        assert len(read(ROOT / "docs" / f"{name}.md").splitlines()) <= 90


class BegunError(Exception):
    """A command has checked all that it was given, and begins."""


UNTIL = {
    "play": ("Page",),
    "certify": ("_margins", "check.check"),
    "train": ("train",),
    "tune": ("TuningStudy",),
    "reproduce": ("reproduce",),
}
"""command → what it calls first when all that it was given is checked."""


def begin(name, words, monkeypatch):
    """Start a command as a page shows it; end it where its work would begin."""

    def begun(*args, **options):
        raise BegunError

    module = importlib.import_module(name)
    command = next(key for key, one in commands().items() if one.module == name)
    args = tyro.cli(module.Args, args=words)
    with monkeypatch.context() as patched:
        for place in UNTIL.get(command, ("evaluate",)):
            owner, _, what = place.rpartition(".")
            patched.setattr(getattr(module, owner) if owner else module, what, begun)
        with pytest.raises(BegunError):
            module.main(args)


STARTED = {
    f"{part}.command"
    for part in ("hcbf_gym.evaluation", "hcbf_gym.training", "hcbf_lab.play",
                 "hcbf_lab.certification", "hcbf_lab.tuning", "hcbf_lab.reproduction")
}  # fmt: skip
HELP = (
    ("hcbf_lab.play.command", ["--map", "depot.yaml", "--masks", "keepout.yaml", "2", "avoid.yaml",
                               "3"]),
    ("hcbf_lab.play.command", ["--model", "reduced", "--map", "depot.yaml", "--slow",
                               "school.yaml", "0.4"]),
    ("hcbf_gym.evaluation.command", ["--env", "HCBF-Regions-v0", "--map", "depot.yaml", "--slow",
                                     "school.yaml", "0.4", "--masks", "keepout.yaml", "2"]),
)  # fmt: skip
"""What --help shows as an example, in a command."""


@pytest.fixture(autouse=True)
def families(monkeypatch):
    """Another registry for each test: pages register a family of the same name."""
    monkeypatch.setattr(scenarios, "_FAMILIES", scenarios._FAMILIES.copy())


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """A folder with the files that pages name."""
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(blocks("docs/my_map.md", "python")[0], names)
    for mask in ("zones", "zone", "avoid", "school"):
        for ending in ("yaml", "pgm"):
            content = Path(f"keepout.{ending}").read_bytes()
            Path(f"{mask}.{ending}").write_bytes(content.replace(b"keepout", mask.encode()))
    Path("scene.json").write_text(blocks("docs/environments.md", "json")[0], encoding="utf-8")
    exec(blocks("docs/my_policy.md", "python")[0], names)
    Path("pond.py").write_text(blocks("docs/my_family.md", "python")[0], encoding="utf-8")
    Path("examples").symlink_to(ROOT / "examples")
    shutil.copy(ROOT / "hcbf_gym/certificates/shipped/cart.json", "FILE")
    return tmp_path


def shown_commands(page):
    """Yield what every command that a page shows runs: a module, and the words that it is given."""
    text = read(page)
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
                    yield commands()[called[1]].module, rest
            case ["hcbf", name, *rest]:
                yield commands()[name].module, rest


ON_PAGES = sorted({
    (name, tuple(words))
    for page in pages_with("hcbf |python scripts/")
    for name, words in shown_commands(page)
    if name in STARTED and not {"--help", "ray", "base.json", "model.zip"} & {*words}
    and (words or "certif" not in name)  # which needs a plant
})  # fmt: skip


def needed(name, words):
    """Return the modules that a command needs before its work begins."""
    of_files = (word.partition(":")[0] for word in words if ".py:" in word)
    texts = [read(ROOT / file) for file in of_files if (ROOT / file).is_file()]
    own = ["stable_baselines3"] if "training" in name else []
    return [*own, *(module for text in texts for module in imported(text))]


@pytest.mark.physics
@pytest.mark.parametrize(
    ("name", "words"),
    [
        pytest.param(name, words, id=" ".join((name, *words)),
                     marks=needs(*needed(name, words)))
        for name, words in [*ON_PAGES, *((name, tuple(words)) for name, words in HELP)]
    ],
)  # fmt: skip
def test_every_command_that_is_shown_begins(name, words, workplace, monkeypatch):
    """All that a command is given on a page goes together, up to where its work begins."""
    begin(name, list(words), monkeypatch)


@pytest.mark.parametrize("page", pages_with("hcbf |python scripts/"), ids=named)
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


@pytest.mark.parametrize("page", pages_with(EXTRA), ids=named)
def test_every_extra_that_is_named_exists(page):
    with open(ROOT / "pyproject.toml", "rb") as file:
        extras = set(tomllib.load(file)["project"]["optional-dependencies"])
    text = read(page)
    for asked in re.findall(EXTRA, text):
        assert set(asked.split(",")) <= extras


@pytest.mark.parametrize("page", pages_with("```"), ids=named)
def test_a_block_without_a_language_is_a_formula_or_a_drawing(page):
    text = read(page)
    parts = re.findall(r"^ *```(\w*)\n(.*?)^ *```$", text, flags=re.DOTALL | re.MULTILINE)
    for language, block in parts:
        assert language in {"", "bash", "python", "json", "yaml", "diff"}
        runs = re.search(r"^ *(?:pip|hcbf|python|import|from|env|\w+\.\w+\()", block, re.MULTILINE)
        assert language or not runs, block


def test_the_version_is_the_same_everywhere_and_leads_the_changelog():
    with open(ROOT / "pyproject.toml", "rb") as file:
        version = tomllib.load(file)["project"]["version"]
    assert hcbf_gym.__version__ == version
    assert f"version: {version}\n" in read(ROOT / "CITATION.cff")
    newest = re.search(r"^## (\S+)", read(ROOT / "CHANGELOG.md"), re.MULTILINE)
    assert newest[1] == version


def test_the_site_lists_every_page():
    with open(ROOT / "zensical.toml", "rb") as file:
        listed = re.findall(r"'([\w/]+\.md)'", str(tomllib.load(file)["project"]["nav"]))
    pages = {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")}
    assert sorted(listed) == sorted(pages)


PUBLIC = (
    "hcbf_robots",
    "hcbf_robots.envs",
    "hcbf_robots.maps",
    *(
        f"hcbf_gym.{name}"
        for name in (
            "barriers", "certificates", "envs", "estimation", "guidance", "models", "policies",
            "programs", "scenarios", "wrappers",
        )
    ),
)  # fmt: skip


@needs("stable_baselines3")  # hcbf_gym.wrappers.sb3 imports it
def test_every_public_name_stands_once_in_the_reference_as_it_is_imported():
    pages = sorted((ROOT / "docs" / "api").glob("*.md"))
    shown = [name for page in pages for name in re.findall(r"^::: (\S+)$", read(page), re.M)]
    assert sorted(shown) == sorted(set(shown))
    wanted = {
        f"{package}.{name}"
        for package in PUBLIC
        for name in importlib.import_module(package).__all__
    }
    twice = {"hcbf_gym.programs.CbfRows"}  # of barriers
    assert wanted - twice <= {*shown}
    for name in shown:  # what is listed is there
        where, _, what = name.rpartition(".")
        found = getattr(importlib.import_module(where), what, None)
        assert found is not None or importlib.import_module(name), name


def test_every_loop_is_shown_and_all_together_are_small():
    files = {path.stem: path for path in (ROOT / "docs/images/gallery").glob("*.webp")}
    assert set(files) == set(gallery.LOOPS | gallery.FOREIGN)
    page = read(ROOT / "docs/gallery.md")
    assert all(f"images/gallery/{name}.webp" in page for name in files)
    assert sum(path.stat().st_size for path in files.values()) < 10e6


def test_every_suite_is_listed():
    page = read(ROOT / "docs/benchmarks.md")
    assert [name for name in SUITES if f"`{name}`" not in page] == []


def defined(file):
    """Return every name that a Python file defines, in classes too; of another file, its words."""
    text = read(file)
    if file.suffix != ".py":
        return set(re.findall(r"\w+", text)) | set(re.findall(r"^#+ (.*)$", text, re.MULTILINE))
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            found.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {target.id for target in targets if isinstance(target, ast.Name)}
    return found


def ways():
    """Yield what is sought, its files and its names, from the tables of CONTRIBUTING."""
    text = read(ROOT / "CONTRIBUTING.md")
    for table in ("Find your way", "To add"):
        section = re.search(rf"^## {table}\n(.*?)(?=^## )", text, re.DOTALL | re.MULTILINE)
        assert section, f"CONTRIBUTING.md has no section {table}"
        rows = re.findall(r"^\| (.+?) \| (.+?) \| (.+?) \|$", section[1], re.MULTILINE)
        for what, where, names in rows[1:]:  # below the head
            files = [name for name in re.findall(r"`([^`]+)`", where) if "=" not in name]
            yield pytest.param(what, files, re.findall(r"`([^`]+)`", names), id=what)


@pytest.mark.parametrize(("what", "files", "names"), list(ways()))
def test_every_way_that_is_shown_leads_there(what, files, names):
    assert files, f"{what}: no file is named"
    assert names, f"{what}: no name is given"
    lost = [file for file in files if not (ROOT / file).exists()]
    assert not lost, f"{what}: no {', '.join(lost)} in the repository"
    known = set().union(*(defined(ROOT / file) for file in files if (ROOT / file).is_file()))
    unknown = sorted(set(names) - known)
    assert not unknown, f"{what}: {', '.join(unknown)} is defined in none of {', '.join(files)}"


def headings(page):
    """The anchors of a page, as the site's generator and code hosts make them."""
    titles = re.findall(r"^#+ (.*)$", read(page), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title).strip().lower().replace(" ", "-") for title in titles}


def test_every_link_of_the_pages_leads_somewhere():
    for page in PAGES:
        text = read(page)
        for target, anchor in re.findall(r"\]\((?!http)([^)#]*)(?:#([^)]+))?\)", text):
            linked = page.parent / target if target else page
            assert linked.exists(), f"{page.name}: {target}"
            assert not anchor or anchor in headings(linked), f"{page.name}: {target}#{anchor}"


@needs("cbfpy")  # the suites that publish the tables import it
def test_every_table_is_that_of_its_results_and_every_result_is_known():
    assert not [str(page) for page, _ in publishing.differing(ROOT)]
    assert {path.stem for path in (ROOT / "docs" / "results").glob("*.json")} <= set(SUITES)


def test_every_result_is_shown_on_one_page_of_evidence_or_more():
    shown = set(re.findall(r"<!-- results: ([\w-]+)/", "".join(map(read, PAGES))))
    assert {path.stem for path in (ROOT / "docs" / "results").glob("*.json")} <= shown


def test_every_page_of_evidence_shows_the_command_that_makes_it():
    for page in sorted((ROOT / "docs" / "evidence").glob("*.md")):
        made = set(re.findall(r"<!-- (?:results|awaits): ([\w-]+)/", read(page)))
        shown = "".join(blocks(page, "bash"))
        missing = [name for name in made if f" --suite {name}\n" not in shown]
        assert made, page.name
        assert not missing, f"{page.name}: {missing}"
