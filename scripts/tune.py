"""`hcbf tune` from a checkout."""

import sys

from hcbf_gym.cli import main

if __name__ == "__main__":
    main(["tune", *sys.argv[1:]])
