"""`make core`: compile what has changed of `core/` into `hcbf_gym/`.

With --sanitize, so that it ends at the first access beyond an array or undefined operation.
"""

import sys

from backend import ROOT, compile_in_place

SANITIZE = "--sanitize" in sys.argv[1:]
folder = ROOT / "build" / ("sanitized" if SANITIZE else "core")
compile_in_place(str(folder), f"-DHCBF_SANITIZE={'ON' if SANITIZE else 'OFF'}")
