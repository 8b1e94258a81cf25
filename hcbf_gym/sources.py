"""Whether the compiled core was made from the sources that lie beside the package."""

import hashlib
import sys
from pathlib import Path

CORE = Path(__file__).parents[1] / "core"
"""The sources, in a checkout."""
REMEDY = "compile it in the checkout:\n    make core\nor install the package again"


def sources_hash(core: Path = CORE) -> str:
    """Return a hash of the C++ sources of a folder, with their names."""
    found = sorted(file for kind in ("*.hpp", "*.cpp") for file in core.rglob(kind))
    digest = hashlib.sha256()
    for file in found:
        digest.update(file.relative_to(core).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]


def check() -> None:
    """Refuse a compiled core that is missing or was made from other sources.

    Raises:
        ImportError: with the remedy.
    """
    try:
        from hcbf_gym import _core
    except ImportError as error:
        raise ImportError(f"hcbf_gym: the compiled core is missing ({error}); {REMEDY}") from error
    if (CORE / "CMakeLists.txt").is_file() and sources_hash() != _core.HASH:
        raise ImportError(f"hcbf_gym: the compiled core is older than core/; {REMEDY}")


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(f'#pragma once\n#define HCBF_HASH "{sources_hash()}"\n')
