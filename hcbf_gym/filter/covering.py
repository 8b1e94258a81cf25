"""Whether N plants are covered, from episode to episode; `certified` defines *covered*.

A plant is covered from the beginning of an episode at most until something leaves what was tested.
It is never covered again before the next episode.
"""

import numpy as np

from hcbf_gym.arrays import Integers, Mask, Records
from hcbf_gym.certificates import Judged, of_another_version, warn_of_version
from hcbf_gym.errors import InvalidInputError, as_array
from hcbf_gym.filter.certified import CertificateCoverage
from hcbf_gym.models.plant import Coverage, CoveredBy, Plant

PLAIN = np.array([CoveredBy.UNKNOWN, CoveredBy.NONE, CoveredBy.SCENE])
"""The `CoveredBy` of a `Coverage` that gives no reason, by its number."""


class Covering:
    """A `Coverage` and a `CoveredBy` of each of N plants.

    Attributes:
        is_new: whether one changed since they were written last.
    """

    def __init__(self, plant: Plant, count: int):
        self._by_certificate = isinstance(plant.covered, CertificateCoverage)
        self.is_new = True
        self._coverage: Integers = np.zeros(count, dtype=np.int64)
        self._why: Integers = np.zeros(count, dtype=np.int64)

    def begin(self, covered: object, fresh: Mask) -> None:
        """Set the coverage of episodes that begin: `covered` is a `Judged`, or (N,) `Coverage`.

        A development version covers none, whatever the plant states. `fresh` (N,) masks the
        plants whose episodes begin.
        """
        for kept, now in zip((self._coverage, self._why), self._judged(covered), strict=True):
            kept[fresh] = now[fresh]
        self.is_new = True

    def follow(self, covered: object) -> None:
        """Take the coverage away from plants that leave it; `covered` as `begin` takes it."""
        coverage, why = self._judged(covered)
        ends = (self._coverage == Coverage.COVERED) & (coverage != Coverage.COVERED)
        self._coverage[ends], self._why[ends] = coverage[ends], why[ends]
        self.is_new = True

    def _judged(self, covered: object) -> tuple[Integers, Integers]:
        """Return (N,) a `Coverage` and a `CoveredBy` of each plant."""
        shape = self._coverage.shape
        given = as_array("covered", covered.covered if isinstance(covered, Judged) else covered)
        known = given.dtype.kind in "iu" and np.isin(given, list(Coverage)).all()
        if not known or given.shape not in ((), shape):
            raise InvalidInputError(f"covered: got {covered!r}, expected one of {list(Coverage)}")
        why = covered.covered_by if isinstance(covered, Judged) else PLAIN[given]
        unreleased = of_another_version()
        if unreleased and (given != Coverage.OUTSIDE).any():
            warn_of_version(unreleased)
            why = np.where(given != Coverage.OUTSIDE, CoveredBy.VERSION, why)
            given = np.zeros_like(given)
        return np.broadcast_to(given, shape), np.broadcast_to(why, shape)

    def doubt(self, scenes: Integers, fresh: Mask) -> None:
        """Cover no episode that begins in a scene where U may not satisfy rank 1.

        Only a sufficient condition shows that, which does not overrule a certificate's episodes.

        Args:
            scenes: a `Coverage` of each scene in which an episode begins.
            fresh: (N,) the plants whose episodes begin.
        """
        known = self._coverage[fresh]
        certified = self._by_certificate & (known == Coverage.COVERED)
        doubted = (scenes == Coverage.OUTSIDE) & ~certified & (known != Coverage.OUTSIDE)
        self._coverage[fresh] = np.where(doubted, scenes, known)
        self._why[fresh] = np.where(doubted, CoveredBy.INPUTS, self._why[fresh])
        self.is_new = True

    def change(self, changed: Mask) -> None:
        """Take the coverage away where a scene changed: it was that of the scene before."""
        changed = changed & (self._coverage == Coverage.COVERED)
        self._coverage[changed] = Coverage.SCENE
        self._why[changed] = CoveredBy.CHANGED
        self.is_new = True

    def write(self, plants: Records) -> None:
        """Write what is covered and why into (N,) reports."""
        self.is_new = False
        plants["covered"], plants["covered_by"] = self._coverage, self._why
