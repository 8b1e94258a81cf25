"""The compiled filter of N plants, bound to the arrays that it reads and writes."""

from operator import is_

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.filtering.report import ReportBuffer
from hcbf_gym.filtering.samples import Samples

DONE, NOT_FINITE, MISSHAPED, ASKS = range(4)
"""What a step returns: nothing is to be done, u* is not finite, the scene is not of these plants,
or a warning is due."""


class Bound:
    """Binds what is another array than before, so that a step passes none; a copy binds its own.

    Args:
        threads: how many cores filter parts of a batch at once.
    """

    def __init__(self, threads: int):
        self._threads = threads
        self._forget()

    def _forget(self) -> None:
        self._filter: _core.Filter | None = None
        self._plants: tuple[object, ...] = (None, None, None)
        self._report: object = None
        self._scene: tuple[object, ...] = ()

    def __getstate__(self) -> int:
        return self._threads

    def __setstate__(self, threads: int) -> None:
        self.__init__(threads)  # type: ignore[misc]

    def of(
        self, constants: Array, program: Array, samples: Samples, report: ReportBuffer
    ) -> _core.Filter:
        """Return the filter of plants that writes their reports.

        Args:
            constants: the numbers of a `plants.CONSTANTS`.
            program: see `plants.constants`.
            samples: of the plants.
            report: of them.
        """
        known, words = self._plants, samples.words
        if constants is not known[0] or program is not known[1] or words is not known[2]:
            self._forget()
            count = len(samples.plants)
            self._filter = _core.Filter(constants, program, words, count, self._threads)
            self._plants = constants, program, words
            if samples.is_apart:
                self._filter.set_states(*samples.states)
        if report.words is not self._report:
            self._report = report.words
            self._filter.set_report(*report.words)
        return self._filter

    def see(self, *scene: Array | None) -> None:
        """Filter these scenes from now on: kind, parameters, priority, own margin, atlas, rows.

        The last two may be None: no map, and no rows that were made beforehand.
        """
        if len(self._scene) == len(scene) and all(map(is_, scene, self._scene)):
            return
        self._filter.set_scene(*scene)
        self._scene = scene
