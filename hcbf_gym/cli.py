"""Put safety filters that know priorities around a policy, and study them.

Each command takes --help.
"""

import contextlib
import dataclasses
import functools
import importlib
import io
import os
import re
import sys
import traceback
import warnings
from collections.abc import Sequence
from typing import Annotated, Any, get_type_hints

import docstring_parser
import tyro
from threadpoolctl import threadpool_limits

from hcbf_gym import arguments as ranges
from hcbf_gym import plugins, records
from hcbf_gym.arguments import Subcommand
from hcbf_gym.errors import HcbfError, choose, in_words, require

OWN = {
    "evaluate": Subcommand(
        "hcbf_gym.evaluation.command", "policies × programs: table, figures, summary.json, videos"
    ),
    "train": Subcommand(
        "hcbf_gym.training.command",
        "a policy under the filter, by PPO, SAC or TD3",
        "rl",
        ("stable_baselines3",),
    ),
}
"""name → command of this package."""
PARSING = (tyro.conf.DisallowNone, tyro.conf.PositionalMetavarFromFieldName)
"""Options of tyro for all commands; None cannot be typed as an argument."""
_FRAMES = re.compile(r"[─-╿]|-{3,}")  # the boxes that tyro draws around messages


def commands() -> dict[str, Subcommand]:
    """Return name → command: those of this package, then those of installed packages."""
    return OWN | plugins.load()


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command, or list all; `arguments` are those of the process unless given."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    try:
        if not arguments or arguments[0] in ("-h", "--help"):
            print(_overview())
            return
        name, *rest = arguments
        command = choose("command", name, commands())
        require(f"hcbf {name}", command.extra, *command.needs)
    except HcbfError as error:
        sys.exit(f"error: {in_words(error)}")
    run(command.module, f"hcbf {name}", rest)


def run(name: str, program: str, arguments: Sequence[str]) -> None:
    """Run a module's `main` with its `Args`; an error or Ctrl-C ends the process with one line.

    Args:
        name: the module's name. Its docstring is the help; its `RESUMED`, if it has one, states how
            an interrupted run resumes.
        program: the program's name in the help.
        arguments: the command's arguments; those from "--ros-args" on are left to ROS.
    """
    # an episode runs on one core, as processes share the episodes; a user's setting has priority
    threads = None if "OMP_NUM_THREADS" in os.environ else 1
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    usual_format, warnings.formatwarning = warnings.formatwarning, _one_line_warning
    resumed = ""
    try:
        module = importlib.import_module(name)
        resumed = getattr(module, "RESUMED", "")
        arguments = list(arguments)
        if "--ros-args" in arguments:
            arguments = arguments[: arguments.index("--ros-args")]
        _describe(module.Args)
        description = re.sub(r"(?<=\S)\n(?=\S)", " ", module.__doc__ or "")  # without line breaks
        args = _parsed(module.Args, program, description, arguments)
        ranges.check(args)
        with threadpool_limits(threads), records.nothing_left_behind():
            module.main(args)
    except HcbfError as error:
        sys.exit(f"error: {_one_line(in_words(error))}")
    except Exception as error:  # of a user's own code, of the disk, or of this package
        frame = traceback.extract_tb(error.__traceback__)[-1]
        sys.exit(f"error: {_one_line(in_words(error))} ({frame.filename}, line {frame.lineno})")
    except KeyboardInterrupt:
        print(f"interrupted; {resumed}" if resumed else "interrupted", file=sys.stderr)
        sys.exit(130)
    finally:
        warnings.formatwarning = usual_format


def _parsed(args: type, program: str, description: str, arguments: Sequence[str]) -> Any:
    """Return the dataclass `args` of arguments; an invalid one ends the process with one line."""
    options = {"prog": program, "description": description, "config": PARSING}
    parse = functools.partial(tyro.cli, args, args=arguments, **options)
    if {"-h", "--help"} & set(arguments):  # the help is printed as tyro lays it out
        return parse()
    printed = io.StringIO()
    try:
        with contextlib.redirect_stderr(printed), contextlib.redirect_stdout(printed):
            return parse()
    except SystemExit as end:
        print(f"error: {_one_line(printed.getvalue())}", file=sys.stderr)
        raise SystemExit(end.code or 2) from None


def _one_line(text: object) -> str:
    """Return a text in one line, without the lines of boxes."""
    return " ".join(_FRAMES.sub(" ", str(text)).split())


def _describe(args: type) -> None:
    """Give the fields of a dataclass their help, from the docstrings of the class and its bases.

    An empty default is not shown, because the text states its meaning.
    """
    texts = {
        parameter.arg_name: " ".join((parameter.description or "").split())
        for cls in reversed(args.__mro__[:-1])
        for parameter in docstring_parser.parse_from_object(cls).params
    }
    annotated = get_type_hints(args, include_extras=True)
    types = get_type_hints(args)
    for field in dataclasses.fields(args):
        if dataclasses.is_dataclass(types[field.name]):
            _describe(types[field.name])
            continue
        is_empty = field.default in (None, (), "") or field.default_factory is dict
        hint = "" if is_empty else None
        options = tyro.conf.arg(help=texts.get(field.name), help_behavior_hint=hint)
        args.__annotations__[field.name] = Annotated[annotated[field.name], options]


def _one_line_warning(message: Warning | str, *_: object, **__: object) -> str:
    """Return the text of a warning, without the line of code that `warnings` would show."""
    return f"warning: {message}\n"


def _overview() -> str:
    """Return the help of `hcbf` itself: usage and the list of commands."""
    known = commands()
    width = max(map(len, known))
    lines = [f"  {name:{width}}  {command.does}" for name, command in known.items()]
    return "\n".join(["usage: hcbf COMMAND [arguments]", "", str(__doc__), *lines])


if __name__ == "__main__":
    main()
