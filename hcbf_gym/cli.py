"""Put safety filters that know priorities around a policy, and study them.

Each command takes --help.
"""

import contextlib
import dataclasses
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
from hcbf_gym.errors import HcbfError, choose, require

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


def commands() -> dict[str, Subcommand]:
    """Return name → command: those of this package, then those of installed packages."""
    return OWN | plugins.load()


READS = (tyro.conf.DisallowNone, tyro.conf.PositionalMetavarFromFieldName)
"""How commands read their arguments: None cannot be typed."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command; an error that this package raises ends it in one line."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    try:
        if not arguments or arguments[0] in ("-h", "--help"):
            print(_overview())
            return
        name, *rest = arguments
        command = choose("command", name, commands())
        require(f"hcbf {name}", command.extra, *command.needs)
    except HcbfError as error:
        sys.exit(f"error: {error}")
    run(command.module, f"hcbf {name}", rest)


def run(name: str, program: str, arguments: Sequence[str]) -> None:
    """Run a module's `main` with its `Args`; errors and Ctrl-C end it in a line.

    Args:
        name: of the module.
        program: its name in the help.
        arguments: of the command.
    """
    # one episode, one core: processes share the work, not threads, unless the user sets it
    threads = None if "OMP_NUM_THREADS" in os.environ else 1
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    usual, warnings.formatwarning = warnings.formatwarning, _warning
    resumed = ""
    try:
        module = importlib.import_module(name)
        resumed = getattr(module, "RESUMED", "")
        own = list(arguments)
        own = own[: own.index("--ros-args")] if "--ros-args" in own else own  # the rest is ROS's
        _describe(module.Args)
        about = re.sub(r"(?<=\S)\n(?=\S)", " ", module.__doc__ or "")
        args = _parsed(module.Args, program, about, own)
        ranges.check(args)
        with threadpool_limits(threads), records.nothing_left_behind():
            module.main(args)
    except HcbfError as error:
        sys.exit(f"error: {_one_line(error)}")
    except Exception as error:  # of a user's own code, of the disk, or of this package
        where = traceback.extract_tb(error.__traceback__)[-1]
        sys.exit(
            f"error: {type(error).__name__}: {_one_line(error)} ({where.filename}, line "
            f"{where.lineno})"
        )
    except KeyboardInterrupt:
        print("; ".join(filter(None, ("interrupted", resumed))), file=sys.stderr)
        sys.exit(130)
    finally:
        warnings.formatwarning = usual


def _parsed(args: type, program: str, about: str, own: list[str]) -> Any:
    """Return a command's arguments; invalid ones end the process in one line."""
    if {"-h", "--help"} & set(own):  # which is longer
        return tyro.cli(args, prog=program, description=about, args=own, config=READS)
    printed = io.StringIO()
    try:
        with contextlib.redirect_stderr(printed), contextlib.redirect_stdout(printed):
            return tyro.cli(args, prog=program, description=about, args=own, config=READS)
    except SystemExit as end:
        print(f"error: {_one_line(printed.getvalue())}", file=sys.stderr)
        raise SystemExit(end.code or 2) from None


def _one_line(text: object) -> str:
    """Return a text without frames and ends of lines."""
    return " ".join(re.sub(r"[─-╿]|-{3,}", " ", str(text)).split())


def _describe(args: type) -> None:
    """Let the help of a dataclass's fields flow, without defaults that its text states."""
    texts = {
        one.arg_name: " ".join((one.description or "").split())
        for cls in reversed(args.__mro__[:-1])
        for one in docstring_parser.parse_from_object(cls).params
    }
    hints = get_type_hints(args, include_extras=True)
    plain = get_type_hints(args)
    for field in dataclasses.fields(args):
        if dataclasses.is_dataclass(plain[field.name]):
            _describe(plain[field.name])
            continue
        is_stated = field.default in (None, (), "") or field.default_factory is dict
        about = tyro.conf.arg(
            help=texts.get(field.name), help_behavior_hint="" if is_stated else None
        )
        args.__annotations__[field.name] = Annotated[hints[field.name], about]


def _warning(message: Warning | str, *_: object, **__: object) -> str:
    """Return a warning without the line of code that raised it."""
    return f"warning: {message}\n"


def _overview() -> str:
    known = commands()
    width = max(map(len, known))
    lines = [f"  {name:{width}}  {command.does}" for name, command in known.items()]
    return "\n".join(["usage: hcbf COMMAND [arguments]", "", str(__doc__), *lines])


if __name__ == "__main__":
    main()
