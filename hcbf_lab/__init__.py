"""Studies: certificates earned, the paper reproduced, weights tuned, and a playground."""

import hcbf_robots  # noqa: F401 - registers environments and maps
