"""`hcbf train` from a checkout."""

import sys

from hcbf_gym.cli import main

if __name__ == "__main__":
    main(["train", *sys.argv[1:]])
