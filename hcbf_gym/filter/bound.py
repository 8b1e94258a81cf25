"""The compiled filter of N plants, bound to the arrays that it reads and writes."""

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.filter.report import ReportBuffer
from hcbf_gym.filter.samples import Samples

SceneArrays = tuple[Integers, Array, Integers, Array, Array | None]
"""Kind, parameters, priority, own margin and atlas of N scenes; without a map there is no atlas."""

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
        """Bind everything anew."""
        self._filter: _core.Filter | None = None
        self._plants: tuple[Array, Array, Array] | None = None
        self._report: object = None
        self._scene: tuple[Integers | Array | None, ...] = (None,) * 6

    def __getstate__(self) -> int:
        return self._threads

    def __setstate__(self, threads: int) -> None:
        self._threads = threads
        self._forget()

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
        compiled, known = self._filter, self._plants
        if compiled is None or known is None or program is not known[1]:
            self._forget()
            compiled = _core.Filter(constants, program, samples.words, self._threads)
            if samples.is_apart:
                compiled.set_states(*samples.states)
            self._filter, self._plants = compiled, (constants, program, samples.words)
        if report.words is not self._report:
            self._report = report.words
            compiled.set_report(*report.words)
        return compiled

    def see(self, compiled: _core.Filter, scene: SceneArrays, own: Array) -> None:
        """Let the filter read these scenes, and rows that were made beforehand."""
        kind, parameters, priority, own_margin, atlas = scene
        a, b, c, d, e, f = self._scene
        same = kind is a and parameters is b and priority is c and own_margin is d
        if not (same and atlas is e and own is f):
            compiled.set_scene(*scene, own)
            self._scene = *scene, own
