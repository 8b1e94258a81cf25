"""Settings of all tests: random examples, what may be skipped, and where pictures can be drawn."""

import os
import warnings
from pathlib import Path

import pytest
from hypothesis import settings

from hcbf_gym import certificates, version

# CI judges a change, not its luck: the same examples every time. By hand, new ones every time.
settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("dev", deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "dev")

with warnings.catch_warnings():  # once a process, so that no test gets it by its place
    warnings.simplefilter("ignore")
    certificates.warn_of_version(certificates.of_another_version())

SKIPPED = "hcbf/skipped"
"""Where pytest's cache has the ids of what the last run skipped."""


def pytest_addoption(parser):
    parser.addoption(
        "--only-skips",
        metavar="FILE",
        help="fail if a test is skipped that FILE does not list, a line each: 'id | reason'; the "
        "id * stands for every test with that reason",
    )
    parser.addoption(
        "--skipped-before",
        action="store_true",
        help="run the tests alone that the last run skipped, whole files included",
    )
    parser.addoption(
        "--with-browser",
        action="store_true",
        help="let Chromium visit the playground, too, for 10 minutes or more without a GPU",
    )


def pytest_configure(config):
    if hasattr(config, "workerinput"):  # the workers of xdist report to the one process that stays
        return
    config.pluginmanager.register(Skipped(config))
    if config.getoption("only_skips"):
        config.pluginmanager.register(OnlySkips(Path(config.getoption("only_skips"))))


def pytest_collection_modifyitems(config, items):
    if config.getoption("skipped_before"):
        before = set(config.cache.get(SKIPPED, []))
        chosen = [i for i in items if {i.nodeid, i.nodeid.partition("::")[0]} & before]
        config.hook.pytest_deselected(items=[i for i in items if i not in chosen])
        items[:] = chosen


class Skipped:
    """Keeps which tests and whole files a run skipped, for `--skipped-before`."""

    def __init__(self, config):
        self.cache = getattr(config, "cache", None)
        self.ids = set()

    def pytest_runtest_logreport(self, report):
        if report.skipped:
            self.ids.add(report.nodeid)

    pytest_collectreport = pytest_runtest_logreport  # a whole file

    def pytest_sessionfinish(self):
        if self.cache is not None:
            self.cache.set(SKIPPED, sorted(self.ids))


class OnlySkips:
    """Fails a run in which a test is skipped that is not on the list."""

    def __init__(self, file):
        lines = file.read_text(encoding="utf-8").splitlines()
        self.listed = {line.strip() for line in lines if line.strip() and line[0] != "#"}
        self.others = []

    def pytest_runtest_logreport(self, report):
        if report.skipped:
            reason = getattr(report, "wasxfail", None) or report.longrepr[2]
            skip = f"{report.nodeid} | {reason.removeprefix('Skipped: ')}"
            if not {skip, f"* | {skip.partition(' | ')[2]}"} & self.listed:
                self.others.append(skip)

    pytest_collectreport = pytest_runtest_logreport  # a whole file

    def pytest_sessionfinish(self, session):
        if self.others:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter):
        if self.others:
            terminalreporter.section("skipped, but not on the list of --only-skips")
            for skip in self.others:
                terminalreporter.line(skip)


@pytest.fixture(scope="session")
def opengl():
    """Skip where MuJoCo cannot draw."""
    from hcbf_gym.drawing.rendering import OffscreenRenderer
    from hcbf_gym.errors import RenderingError

    import mujoco  # after this package, which chooses how MuJoCo renders  # isort: skip

    try:
        model = mujoco.MjModel.from_xml_string("<mujoco/>")
        OffscreenRenderer(model, mujoco.MjData(model)).close()
    except RenderingError as error:
        pytest.skip(f"needs OpenGL: {error}")


@pytest.fixture
def released(monkeypatch):
    """Let this version count as the release of the shipped certificates."""
    monkeypatch.setattr(version, "VERSION", certificates.load("cart").version)
