"""The version of this package."""

VERSION = "0.2.0"
"""The version; one with ``.dev`` is a development version, between two releases."""


def release() -> str:
    """Return the release to which certificates belong; a release candidate has its release's."""
    return VERSION.partition("rc")[0]
