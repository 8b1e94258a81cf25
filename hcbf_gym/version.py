"""The version of this package; certificates belong to a release."""

VERSION = "0.2.0.dev0"
"""With ``.dev`` it is a development version, between two releases."""


def release() -> str:
    """Return the version for which certificates are earned: a candidate's is its release's."""
    return VERSION.partition("rc")[0]
