"""Settings of all tests: random examples, what may be skipped, and where pictures can be drawn."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# CI judges a change, not its luck: the same examples every time. By hand, new ones every time.
settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("dev", deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "dev")


def pytest_addoption(parser):
    parser.addoption(
        "--only-skips",
        metavar="FILE",
        help="fail if a test is skipped that FILE does not list, a line each: 'id | reason'",
    )


def pytest_configure(config):
    file = config.getoption("only_skips")
    if file and not hasattr(config, "workerinput"):  # the workers of xdist report to this process
        config.pluginmanager.register(OnlySkips(Path(file)))


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
            if skip not in self.listed:
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
    from hcbf_gym.envs.rendering import OffscreenRenderer
    from hcbf_gym.errors import RenderingError

    import mujoco  # after this package, which chooses how MuJoCo renders  # isort: skip

    try:
        OffscreenRenderer(mujoco.MjModel.from_xml_string("<mujoco/>")).close()
    except RenderingError as error:
        pytest.skip(f"needs OpenGL: {error}")
