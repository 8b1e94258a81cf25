"""The version of this package; certificates belong to one."""

VERSION = "0.2.0.dev0"
"""With ``.dev`` it is a development version, between two releases."""
