"""The help of commands."""

import dataclasses
import importlib
import re
from typing import get_type_hints

import pytest

from hcbf_gym import cli


@pytest.mark.parametrize("name", cli.commands())
def test_help_describes_each_argument_and_shows_no_default_that_python_alone_knows(name, capsys):
    command = cli.commands()[name]
    for module in command.needs:
        pytest.importorskip(module)
    with pytest.raises(SystemExit):
        cli.main([name, "--help"])
    printed = capsys.readouterr().out
    assert not re.search(r"\{None\}|default: (None|'')?\)", printed)
    texts = list(texts_of(importlib.import_module(command.module).Args))
    assert texts
    assert all(texts)
    assert not [text for text in texts if "\n" in text]  # lines break where the terminal ends


def texts_of(args):
    for name, hint in args.__annotations__.items():
        plain = get_type_hints(args)[name]
        if dataclasses.is_dataclass(plain):
            yield from texts_of(plain)
        else:
            yield hint.__metadata__[-1].help
