"""`hcbf benchmark` from a checkout."""

import sys

from hcbf_gym.cli import main

if __name__ == "__main__":
    main(["benchmark", *sys.argv[1:]])
