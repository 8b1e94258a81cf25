"""Settings of all tests."""

import os

from hypothesis import settings

# CI judges a change, not its luck: the same examples every time. By hand, new ones every time.
settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("dev", deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "dev")
