"""The picture of the input plane in docs/programs.md."""

import tyro

from hcbf_gym.studies.input_plane import main

if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
