"""The Monte Carlo comparison of the programs, from any folder of a checkout."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # `benchmarks` belongs to no wheel

from hcbf_gym import cli

if __name__ == "__main__":
    cli.run("benchmarks.suites.monte_carlo", "python scripts/monte_carlo.py", sys.argv[1:])
