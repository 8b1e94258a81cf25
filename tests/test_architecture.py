"""The packages: their roots, the direction of their imports, and how fast they are imported."""

import re
import subprocess
import sys
from pathlib import Path

from importlinter import cli

import hcbf_gym
from hcbf_gym.cli import commands
from hcbf_gym.sources import PACKAGES

ROOT = Path(__file__).parents[1]


def test_imports_go_one_way(capsys):
    code = cli.lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True)
    assert code == cli.EXIT_STATUS_SUCCESS, capsys.readouterr().out


def test_nothing_stands_loose_at_the_root():
    loose = {path.stem for path in Path(hcbf_gym.__file__).parent.glob("*.py")}
    assert loose == {
        "__init__", "arguments", "arrays", "cli", "errors", "lazily", "loading",
        "opened", "plugins", "records", "sources", "version",
    }  # fmt: skip


def test_of_the_package_itself_modules_and_the_compiled_core_are_imported_alone():
    package = Path(hcbf_gym.__file__).parent
    modules = {path.stem for path in package.iterdir()} | {"_core"}
    for file in (file for package in PACKAGES for file in package.rglob("*.py")):
        for names in re.findall(
            r"^ *from hcbf_gym import ([^(\n]+)", file.read_text("utf-8"), re.M
        ):
            assert {name.split(" as ")[0].strip() for name in names.split(",")} <= modules, file


def test_the_packages_do_not_mention_their_evidence():
    files = [file for package in PACKAGES for file in package.rglob("*.py")]
    assert not [str(file) for file in files if "benchmarks" in file.read_text(encoding="utf-8")]


def test_the_list_of_commands_imports_none_of_them():
    code = "import sys; from hcbf_gym import cli; cli.main(['--help']); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    overview, modules = done.stdout.rsplit("\n", 2)[0], done.stdout.splitlines()[-1].split()
    assert all(name in overview for name in commands())
    assert not {command.module for command in commands().values()} & set(modules)
    assert not {"optuna", "torch", "matplotlib"} & set(modules)
