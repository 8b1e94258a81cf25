"""Earlier versions of this checkout, taken out of its history."""

import subprocess
import tarfile
from io import BytesIO
from pathlib import Path

from hcbf_gym.errors import InvalidInputError

ROOT = Path(__file__).parents[1]
"""The checkout."""


def take_out(revision: str, folder: Path, *paths: str) -> None:
    """Write files of a revision to a folder (`git archive`).

    Args:
        revision: what git takes for a commit.
        folder: where they go.
        paths: which files and folders of the checkout.

    Raises:
        InvalidInputError: if this is no checkout with that revision.
    """
    command = ["git", "archive", revision, *paths]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, check=False)
    if done.returncode:
        raise InvalidInputError(
            f"history: got no revision {revision!r} with {', '.join(paths)} in {ROOT.name}, "
            "expected a checkout of hcbf-gym with its history"
        )
    with tarfile.open(fileobj=BytesIO(done.stdout)) as archive:
        archive.extractall(folder, filter="data")
