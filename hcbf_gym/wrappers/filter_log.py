"""FilterLog: a filter's statuses, least h by rank and intervention, as scalars for training."""

from collections.abc import Sequence

import numpy as np

from hcbf_gym.arrays import Info
from hcbf_gym.barriers.set import Condition
from hcbf_gym.errors import listed
from hcbf_gym.programs import FilterStatus


class FilterLog:
    """Collects a filter's reports between two points of a training curve.

    Args:
        conditions: `SafetyFilter.conditions`, for the rank of each row.

    Examples:
        >>> log = FilterLog([Condition("wall", 1), Condition("lawn", 2)])
        >>> log.add({"status": 2, "intervention": 0.5, "h": [0.3, -0.1]})
        >>> log.add({"status": 0, "intervention": 0.0, "h": [0.4, 0.2]})
        >>> log.scalars()["filter/least_h_rank_2"], log.scalars()
        (-0.1, {})
    """

    def __init__(self, conditions: Sequence[Condition]):
        checked = listed("conditions", conditions, Condition)
        self._ranks = np.array([condition.rank for condition in checked])
        self._clear()

    def add(self, report: Info) -> None:
        """Add the report ``info["safety_filter"]`` of a step, of one environment or of N."""
        status = np.atleast_1d(report["status"]).astype(np.int64)
        self._counts += np.bincount(status, minlength=len(FilterStatus))
        self._intervention += float(np.sum(report["intervention"]))
        h = np.atleast_2d(np.asarray(report["h"], dtype=np.float64))
        self._least = np.fmin(self._least, np.fmin.reduce(h, axis=0))

    def scalars(self) -> dict[str, float]:
        """Return name → value of the reports since the last call, and forget them.

        Without a report the dict is empty.
        """
        scalars: dict[str, float] = {}
        total = int(self._counts.sum())
        if total:
            for status, reports in zip(FilterStatus, self._counts.tolist(), strict=True):
                scalars[f"filter/status_{status.name}"] = reports / total
            scalars["filter/intervention"] = self._intervention / total
            for rank in np.unique(self._ranks).tolist():
                least = float(np.min(self._least[self._ranks == rank]))
                if np.isfinite(least):
                    scalars[f"filter/least_h_rank_{rank}"] = least
        self._clear()
        return scalars

    def _clear(self) -> None:
        self._counts = np.zeros(len(FilterStatus), dtype=np.int64)
        self._intervention = 0.0
        self._least = np.full(len(self._ranks), np.inf)
