"""What other packages register by entry points."""

from importlib import metadata

import pytest

from hcbf_gym import cli, plugins, scenarios
from hcbf_gym.errors import InvalidInputError


@pytest.fixture
def broken(monkeypatch):
    """A package whose entry point names a module that is not there."""
    point = metadata.EntryPoint("broken", "no_such_package.commands:COMMANDS", plugins.GROUP)
    monkeypatch.setattr(metadata, "entry_points", lambda group: [point])
    plugins.load.cache_clear()
    yield
    plugins.load.cache_clear()


def test_a_package_that_cannot_be_imported_is_named(broken):
    with pytest.raises(InvalidInputError, match=r"'broken' .*no_such_package"):
        scenarios.make("no-such-scene")
    for arguments in ([], ["evaluate"]):
        with pytest.raises(SystemExit, match="error: entry point 'broken'"):
            cli.main(arguments)


def test_a_scene_that_is_known_or_a_file_loads_no_other_package(broken):
    assert scenarios.family_of("random") is not None
    assert scenarios.family_of("scene.json") is None
