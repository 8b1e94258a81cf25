"""Whether the promise was tested for N plants, from episode to episode."""

import numpy as np

from hcbf_gym.arrays import Integers, Mask, Records
from hcbf_gym.certificates import Judged, of_another_version, warn_of_version
from hcbf_gym.errors import InvalidInputError, as_array
from hcbf_gym.filter.certified import CertificateCoverage
from hcbf_gym.models.plant import Coverage, CoveredBy, Plant

PLAIN = np.array([CoveredBy.UNKNOWN, CoveredBy.NONE, CoveredBy.SCENE])
"""Why, of a `Coverage` alone."""


class Covering:
    """What is covered of N plants, and why not.

    Attributes:
        is_new: whether something changed since it was written last.
    """

    def __init__(self, plant: Plant, count: int):
        self._shown = isinstance(plant.covered, CertificateCoverage)
        self.is_new = True
        self._coverage: Integers = np.zeros(count, dtype=np.int64)
        self._why: Integers = np.zeros(count, dtype=np.int64)

    def begin(self, covered: object, fresh: Mask) -> None:
        """Note whether the promise was tested for the episodes that begin.

        In a development version none is covered, whatever the plant states.

        Args:
            covered: a `Judged`, a `Coverage`, or (N,) of them.
            fresh: (N,) which begin.
        """
        for kept, now in zip((self._coverage, self._why), self._judged(covered), strict=True):
            kept[fresh] = now[fresh]
        self.is_new = True

    def follow(self, covered: object) -> None:
        """Note where a promise that was tested when the episode began is no longer.

        Args:
            covered: as `begin` takes it, at a later step.
        """
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
        """Cover no episode that begins in a scene where rank 1 cannot be promised.

        What is promised is a sufficient condition: it does not overrule episodes that showed it.

        Args:
            scenes: a `Coverage` of each such episode's scene.
            fresh: (N,) which begin.
        """
        known = self._coverage[fresh]
        shown = self._shown & (known == Coverage.COVERED)
        doubted = (scenes == Coverage.OUTSIDE) & ~shown & (known != Coverage.OUTSIDE)
        self._coverage[fresh] = np.where(doubted, scenes, known)
        self._why[fresh] = np.where(doubted, CoveredBy.INPUTS, self._why[fresh])
        self.is_new = True

    def change(self, changed: Mask) -> None:
        """Note where scenes changed in an episode: it was covered with the one it began in."""
        changed = changed & (self._coverage == Coverage.COVERED)
        self._coverage[changed] = Coverage.SCENE
        self._why[changed] = CoveredBy.CHANGED
        self.is_new = True

    def write(self, plants: Records) -> None:
        """Write what is covered and why into (N,) reports."""
        self.is_new = False
        plants["covered"], plants["covered_by"] = self._coverage, self._why
