"""Commands with hostile arguments end in one line, at once, and leave nothing behind."""

import dataclasses
import importlib
import os
import subprocess
import sys
import time
import types
import typing
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import pytest
from tyro.conf import Positional

from hcbf_gym import HcbfError, cli, records
from hcbf_gym.arguments import Output, Range, check
from hcbf_gym.errors import InvalidInputError

pytestmark = pytest.mark.filterwarnings("ignore")

SECONDS = 5.0  # of a processor until a refusal
BESIDE = {"certify": ["regions"], "identify": ["cart"]}  # what a command needs besides
ANY_FINITE = {"tune --mean", "tune --covariance", "ros-sim --start"}  # numbers without a range
WORK = {
    "evaluate": [("hcbf_gym.evaluation.command", "_run")],
    "certify": [
        ("hcbf_lab.certification.certify", "calibrated"),
        ("hcbf_lab.certification.certify", "certify"),
        ("hcbf_lab.certification.check", "check"),
    ],
    "identify": [("hcbf_robots.identification.identify", "identify")],
    "reproduce": [("hcbf_lab.reproduction.command", "reproduce")],
    "tune": [("hcbf_lab.tuning.command", "TuningStudy")],
    "train": [("hcbf_gym.training.train", "make_model")],
    "play": [("hcbf_lab.play.command", "Page")],
    "ros-sim": [("hcbf_robots.ros.sim_node", "spin")],
}
"""Where a command's work begins."""


class BeganError(BaseException):
    """A command has begun to work."""


class Argument(typing.NamedTuple):
    flag: str
    kinds: list[Any]
    marks: list[Any]
    is_positional: bool


def arguments_of(args):
    hints = get_type_hints(args, include_extras=True)
    for field in dataclasses.fields(args):
        kinds, marks = [], []
        split(hints[field.name], kinds, marks)
        nested = [kind for kind in kinds if dataclasses.is_dataclass(kind)]
        if nested:
            yield from arguments_of(nested[0])
            continue
        named = [mark.name for mark in marks if getattr(mark, "name", None)]
        name = named[0] if named else field.name
        flag = "--" + name.replace("_", "-")
        where = any(mark in get_args(Positional[int]) for mark in marks)
        yield Argument(flag, kinds, marks, where)


def split(hint, kinds, marks):
    """Gather the types of a hint, and what stands beside them."""
    origin = get_origin(hint)
    if origin is Annotated:
        marks += hint.__metadata__
        split(get_args(hint)[0], kinds, marks)
    elif origin in (typing.Union, types.UnionType, tuple, dict):
        if origin is dict:
            kinds.append(dict)
        for one in get_args(hint):
            if one not in (..., type(None)):
                split(one, kinds, marks)
    elif origin is Literal:
        kinds.append(Literal)
    else:
        kinds.append(hint)


def values_of(argument, file):
    """Yield values that no command takes."""
    kinds, writes = argument.kinds, any(isinstance(mark, Output) for mark in argument.marks)
    ranged = any(isinstance(mark, Range) for mark in argument.marks)
    if dict in kinds:
        yield from (["nowhere.yaml", "x"], ["nowhere.yaml", "-1"], ["nowhere.yaml", "2"])
    elif int in kinds:
        count = 2 if argument.flag == "--part" else 1
        yield from ([value] * count for value in ("abc", "1.5", "-5", "9" * 23))
    elif float in kinds:
        count = {"--start": 3, "--mean": 2, "--covariance": 4, "--v-max": 1}.get(argument.flag, 1)
        values = ["abc", "nan", "inf", *(["-1", "1e30"] if ranged else [])]
        yield from ([value] * count for value in values)
    elif writes:
        yield from ([f"{file}/x"], [f"{file}/x/y"], ["x" * 5000], [f"new/{'y' * 300}"])
    elif Path in kinds:
        yield from (["nowhere.yaml"], [str(file)], ["x" * 5000])
    elif bool in kinds:
        yield from (["maybe"], ["2"])
    elif Literal in kinds:
        yield ["nope"]
    else:
        assert str in kinds
        yield from (["../../../evil"], ["nosuch://x"])
        if argument.flag != "--name":
            yield ["no such thing"]


def commands():
    """Return the names of the commands whose extras are installed."""
    return [
        name
        for name, command in cli.commands().items()
        if all(importlib.util.find_spec(module) for module in command.needs)
    ]


def tree(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def refused(name, given, capsys):
    """Return the error of a command that refuses its arguments, and its seconds."""
    begun = time.process_time()
    with pytest.raises(SystemExit) as end:
        cli.main([name, *given])
    seconds = time.process_time() - begun
    code = end.value.code
    error = code if isinstance(code, str) else capsys.readouterr().err
    assert code not in (0, None), given
    return error, seconds


COUNTED: list[str] = []


@pytest.mark.parametrize("name", commands())
def test_what_no_argument_may_be_is_refused_in_one_line(name, tmp_path, monkeypatch, capsys):
    file = tmp_path / "file"
    file.write_text("{", encoding="utf-8")
    inside = tmp_path / "inside"
    inside.mkdir()
    monkeypatch.chdir(inside)
    module = importlib.import_module(cli.commands()[name].module)
    for where, attribute in WORK.get(name, ()):
        if name != "ros-sim" or importlib.util.find_spec("rclpy"):
            work = importlib.import_module(where)
            monkeypatch.setattr(work, attribute, began)
    before = tree(tmp_path)
    failures = []
    for argument in arguments_of(module.Args):
        for value in values_of(argument, file):
            given = [*BESIDE.get(name, ()), argument.flag, *value]
            if bool in argument.kinds:
                given[-2:] = [f"{argument.flag}={value[0]}"]
            if argument.is_positional:
                given = value
            what = " ".join(one[:40] for one in given)
            COUNTED.append(what)
            try:
                error, seconds = refused(name, given, capsys)
            except (BeganError, pytest.fail.Exception) as error:
                failures.append(f"{what}: {type(error).__name__}")
                continue
            capsys.readouterr()
            lines = error.strip().splitlines()
            if len(lines) != 1 or not error.startswith("error: ") or " line " in error[-30:]:
                failures.append(f"{what}: {error}")
            if seconds > SECONDS:
                failures.append(f"{what}: {seconds:.1f} s")
            if tree(tmp_path) != before:
                failures.append(f"{what}: left {sorted({*tree(tmp_path)} - {*before})}")
                before = tree(tmp_path)
    assert not failures, "\n".join(failures)


def began(*_, **__):
    raise BeganError


def test_there_are_200_such_calls():
    if not COUNTED:
        pytest.skip("runs after the others of this file")
    assert len(COUNTED) >= 200


@pytest.mark.parametrize("name", commands())
def test_each_number_has_a_range_and_each_place_to_write_to_is_marked(name):
    module = importlib.import_module(cli.commands()[name].module)
    for argument in arguments_of(module.Args):
        if {int, float} & set(argument.kinds) and f"{name} {argument.flag}" not in ANY_FINITE:
            assert any(isinstance(mark, Range) for mark in argument.marks), argument.flag
        if argument.flag in ("--output", "--path"):
            assert any(isinstance(mark, Output) for mark in argument.marks), argument.flag


REAL = (
    ["evaluate", "--workers", "0"],
    ["evaluate", "--seed", "-5"],
    ["evaluate", "--output", "FILE/x"],
    ["certify", "cart", "--name", "../../../evil"],
    ["identify", "cart", "--seconds", "1e12"],
    ["nope"],
)


@pytest.mark.parametrize("given", REAL, ids=" ".join)
def test_a_process_ends_in_one_line_and_leaves_nothing_behind(given, tmp_path):
    file, inside = tmp_path / "FILE", tmp_path / "a" / "b" / "c"
    file.touch()
    inside.mkdir(parents=True)
    before = tree(tmp_path)
    given = [str(file / "x") if one == "FILE/x" else one for one in given]
    ended = subprocess.run(
        [sys.executable, "-m", "hcbf_gym.cli", *given],
        cwd=inside,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode > 0
    assert len(ended.stderr.strip().splitlines()) == 1
    assert ended.stderr.startswith("error: ")
    assert not ended.stdout
    assert tree(tmp_path) == before


@pytest.mark.parametrize(
    "name",
    ["../evil", "a/b", "..", ".", "", ".hidden", "-x", "a\\b", "c:d", "a\0b", "a\nb", "y" * 300],
)
def test_a_name_is_no_path(name):
    with pytest.raises(InvalidInputError, match="expected a name"):
        records.check_name("name", name)
    assert records.check_name("name", "my-robot_2.1") == "my-robot_2.1"


PLANT = """
import gymnasium as gym, numpy as np, hcbf_gym
from hcbf_gym import models
from hcbf_gym.barriers import Disc

class Point(gym.Env):
    action_space = gym.spaces.Box(-5.0, 5.0, (2,), np.float64)
    observation_space = gym.spaces.Box(-np.inf, np.inf, (4,), np.float64)
    def reset(self, *, seed=None, options=None):
        FAILS
        self.x = np.zeros(4)
        return self.x.copy(), {}
    def step(self, u):
        self.x = models.DoubleIntegrator().step(self.x, np.asarray(u, float), 0.02)
        return self.x.copy(), 0.0, False, False, {}

def make():
    plant = hcbf_gym.Plant(
        models.DoubleIntegrator(), [Disc("disc", 1, (2.0, 0.0), 0.5)],
        lambda env, *_: env.x.copy(), period=0.02,
    )
    return Point(), plant

def attack(s):
    return 5.0 * s.normal[0]

def policy(observation, info):
    return info["nothing"]
"""


@pytest.mark.parametrize(
    ("fails", "given", "message"),
    [
        ("raise OSError('unplugged')", [], "OSError: unplugged"),
        ("1 / 0", ["--workers", "1"], "ZeroDivisionError"),
        ("pass", ["--policies", "plant.py:attack"], "AttributeError"),
        ("pass", ["--policies", "plant.py:policy"], "KeyError"),
        ("pass", ["--policies", "no such"], "unknown policy"),
    ],
)
def test_certify_tries_what_is_the_user_s_own_before_it_begins(
    fails, given, message, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plant.py").write_text(PLANT.replace("FAILS", fails), encoding="utf-8")
    before = tree(tmp_path)
    error, _ = refused("certify", ["plant.py:make", "--output", "out/here", *given], capsys)
    assert message in error
    assert len(error.splitlines()) == 1
    assert [one for one in tree(tmp_path) if "__pycache__" not in one] == before


def test_a_folder_without_a_result_goes_with_an_error_and_one_with_a_result_stays(tmp_path):
    def fails(result):
        records.make_folder(tmp_path / "a" / "b")
        (tmp_path / "a" / "b" / records.SETTINGS).write_text("{}", encoding="utf-8")
        if result:
            (tmp_path / "a" / "b" / result).write_text("{}", encoding="utf-8")
        raise HcbfError("no")

    for result, left in ((None, []), ("result.json", ["a", "a/b", "a/b/result.json"])):
        with pytest.raises(HcbfError), records.nothing_left_behind():
            fails(result)
        found = [one for one in tree(tmp_path) if not one.endswith(records.SETTINGS)]
        assert found == left


def test_what_a_user_s_own_code_raises_ends_in_one_line_that_names_where(monkeypatch):
    def fails(_):
        raise ZeroDivisionError("one\ntwo")

    monkeypatch.setattr("hcbf_gym.evaluation.command.main", fails)
    with pytest.raises(SystemExit) as end:
        cli.main(["evaluate"])
    assert str(end.value.code).startswith("error: ZeroDivisionError: one two (")
    assert "test_hostile_commands.py, line " in str(end.value.code)


def test_numbers_in_nested_arguments_are_checked():
    @dataclasses.dataclass
    class Inner:
        x: Annotated[float, Range(0.0, 1.0)] = 0.5

    @dataclasses.dataclass
    class Outer:
        inner: Inner
        many: tuple[Annotated[int, Range(1, 2)], ...] = (1, 2)

    check(Outer(Inner()))
    for bad in (Outer(Inner(2.0)), Outer(Inner(float("nan"))), Outer(Inner(), (1, 3))):
        with pytest.raises(InvalidInputError, match=r"--(x|many): got"):
            check(bad)
