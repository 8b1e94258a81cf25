"""The coverage of N plants during their episodes: whether the promise was tested for each plant.

`certified` explains the words. An episode is covered from its beginning, or not at all. It loses
its coverage when the plant or the scene leaves the tested ranges, and never regains it.
"""

import numpy as np

from hcbf_gym.arrays import Integers, Mask, Records
from hcbf_gym.certificates import Judged, of_another_version, warn_of_version
from hcbf_gym.errors import InvalidInputError, as_array, shown
from hcbf_gym.filter.certified import CertificateCoverage
from hcbf_gym.models.plant import Coverage, CoveredBy, Plant

DEFAULT_REASONS = np.array([CoveredBy.UNKNOWN, CoveredBy.NONE, CoveredBy.SCENE])
"""The `CoveredBy` of each `Coverage`, by its number, if a plant gives no reason."""


class EpisodeCoverage:
    """The `Coverage` and the `CoveredBy` of each of N plants in its present episode.

    Attributes:
        is_new: whether an entry changed since `write` was called last.
    """

    def __init__(self, plant: Plant, count: int):
        self._has_certificate = isinstance(plant.covered, CertificateCoverage)
        self.is_new = True
        self._coverage: Integers = np.zeros(count, dtype=np.int64)
        self._reason: Integers = np.zeros(count, dtype=np.int64)

    def check(self, covered: object) -> None:
        """Refuse a verdict that is none, by an InvalidInputError."""
        self._checked_verdict(covered)

    def begin(self, covered: object, fresh: Mask) -> None:
        """Set the coverage of new episodes; a development version covers none of them.

        Args:
            covered: the verdict: a `Judged`, or one `Coverage` for all plants or for each (N,).
            fresh: (N,) the plants whose episodes begin.
        """
        verdict = self._checked_verdict(covered)
        self._set(fresh, verdict.covered, verdict.covered_by)

    def update(self, covered: object) -> None:
        """End the coverage of the plants that are not covered now; `covered` is as in `begin`."""
        verdict = self._checked_verdict(covered)
        ends = (self._coverage == Coverage.COVERED) & (verdict.covered != Coverage.COVERED)
        self._set(ends, verdict.covered, verdict.covered_by)

    def check_scenes(self, scenes: Integers, fresh: Mask) -> None:
        """End the coverage of new episodes in whose scenes U may not satisfy rank 1.

        The check of U is a sufficient condition. A certificate overrules it, because its episodes
        have shown that this very plant satisfies rank 1.

        Args:
            scenes: a `Coverage` of each scene in which an episode begins.
            fresh: (N,) the plants whose episodes begin.
        """
        ends = np.zeros_like(fresh)
        ends[fresh] = (scenes == Coverage.OUTSIDE) & (self._coverage[fresh] != Coverage.OUTSIDE)
        if self._has_certificate:
            ends &= self._coverage != Coverage.COVERED
        self._set(ends, Coverage.OUTSIDE, CoveredBy.INPUTS)

    def end_where_changed(self, changed: Mask) -> None:
        """End the coverage of the masked plants (N,): it was that of the scene before a change."""
        ends = changed & (self._coverage == Coverage.COVERED)
        self._set(ends, Coverage.SCENE, CoveredBy.CHANGED)

    def write(self, reports: Records) -> None:
        """Write coverage and reason into the reports (N,) of the plants."""
        self.is_new = False
        reports["covered"], reports["covered_by"] = self._coverage, self._reason

    def _set(self, mask: Mask, coverage: int | Integers, reason: int | Integers) -> None:
        """Set the entries of the masked plants (N,) to numbers, or to those of (N,) arrays."""
        self._coverage = np.where(mask, coverage, self._coverage)
        self._reason = np.where(mask, reason, self._reason)
        self.is_new = True

    def _checked_verdict(self, covered: object) -> Judged:
        """Return a verdict as (N,) arrays; refuse other values than a `Coverage`."""
        shape, judged = self._coverage.shape, covered if isinstance(covered, Judged) else None
        coverage = as_array("covered", covered if judged is None else judged.covered)
        is_valid = coverage.dtype.kind in "iu" and np.isin(coverage, list(Coverage)).all()
        if not is_valid or coverage.shape not in ((), shape):
            raise InvalidInputError(
                f"covered: got {shown(covered)}, expected one of {list(Coverage)}"
            )
        reason = DEFAULT_REASONS[coverage]
        if judged is not None:
            reason = as_array("covered_by", judged.covered_by)
            is_valid = reason.dtype.kind in "iu" and np.isin(reason, list(CoveredBy)).all()
            if not is_valid or reason.shape not in ((), shape):
                raise InvalidInputError(
                    f"covered_by: got {shown(judged.covered_by)}, expected one of {list(CoveredBy)}"
                )
        unreleased = of_another_version()
        if unreleased and (coverage != Coverage.OUTSIDE).any():
            warn_of_version(unreleased)
            reason = np.where(coverage != Coverage.OUTSIDE, CoveredBy.VERSION, reason)
            coverage = np.zeros_like(coverage)
        return Judged(np.broadcast_to(coverage, shape), np.broadcast_to(reason, shape))
