"""`hcbf monte-carlo` from a checkout."""

import sys

from hcbf_gym.cli import main

if __name__ == "__main__":
    main(["monte-carlo", *sys.argv[1:]])
