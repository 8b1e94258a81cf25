"""`make core`: compile what has changed of `core/` into `hcbf_gym/`."""

from backend import ROOT, compile_in_place

compile_in_place(str(ROOT / "build" / "core"))
