"""What a training curve shows of a filter: statuses, least h by rank, intervention."""

from collections.abc import Sequence

import numpy as np

from hcbf_gym.arrays import Info
from hcbf_gym.barriers.set import Condition
from hcbf_gym.errors import listed
from hcbf_gym.programs import FilterStatus


class FilterLog:
    """Gathers a filter's reports between two points of a curve.

    Args:
        conditions: `SafetyFilter.conditions`, which have the ranks.

    Examples:
        >>> log = FilterLog([Condition("wall", 1), Condition("lawn", 2)])
        >>> log.add({"status": 2, "intervention": 0.5, "h": [0.3, -0.1]})
        >>> log.add({"status": 0, "intervention": 0.0, "h": [0.4, 0.2]})
        >>> log.scalars()["filter/least_h_rank_2"], log.scalars()
        (-0.1, {})
    """

    def __init__(self, conditions: Sequence[Condition]):
        given = listed("conditions", conditions, Condition)
        self._ranks = np.array([condition.rank for condition in given])
        self._clear()

    def add(self, report: Info) -> None:
        """Take a report, ``info["safety_filter"]`` of a step; of N environments with N entries."""
        status = np.atleast_1d(report["status"]).astype(np.int64)
        self._counts += np.bincount(status, minlength=len(FilterStatus))
        self._intervention += float(np.sum(report["intervention"]))
        h = np.atleast_2d(np.asarray(report["h"], dtype=np.float64))
        self._least = np.fmin(self._least, np.fmin.reduce(h, axis=0))

    def scalars(self) -> dict[str, float]:
        """Return name → value since the last call, and begin anew; nothing without a report."""
        total = int(self._counts.sum())
        found: dict[str, float] = {}
        if total:
            shares = zip(FilterStatus, (self._counts / total).tolist(), strict=True)
            found = {f"filter/status_{status.name}": share for status, share in shares}
            found["filter/intervention"] = self._intervention / total
            for rank in np.unique(self._ranks).tolist():
                least = float(np.min(self._least[self._ranks == rank]))
                if np.isfinite(least):
                    found[f"filter/least_h_rank_{rank}"] = least
        self._clear()
        return found

    def _clear(self) -> None:
        self._counts = np.zeros(len(FilterStatus), dtype=np.int64)
        self._intervention = 0.0
        self._least = np.full(len(self._ranks), np.inf)
