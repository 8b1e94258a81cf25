"""The compiled filter of N plants, bound to the arrays that it reads and writes."""

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.filter import solvers
from hcbf_gym.filter.configured import Configured
from hcbf_gym.filter.report import ReportBuffer
from hcbf_gym.filter.samples import Samples

SceneArrays = tuple[Integers, Array, Integers, Array, Array | None, Array]
"""Kind, parameters, priority, own margin, atlas and ends of paths of N scenes; without a map there
is no atlas."""

DONE, NOT_FINITE, MISSHAPED, ASKS = range(4)
"""What a step returns: nothing is to be done, u* is not finite, the scene is not of these plants,
or a warning is due."""


class Bound:
    """Binds arrays where they are others than before, so that a step passes none.

    Args:
        made: settings of the filter.
        samples: of the plants.
        report: of them.
        threads: how many cores filter parts of a batch at once.
    """

    def __init__(self, made: Configured, samples: Samples, report: ReportBuffer, threads: int):
        self._made, self._samples, self.report, self._threads = made, samples, report, threads
        self._forget()

    def _forget(self) -> None:
        """Bind everything at the next step."""
        self._core: _core.Filter | None = None
        self._words: object = None
        self._scene: tuple[Integers | Array | None, ...] = (None,) * 7

    def __getstate__(self) -> dict[str, object]:
        """Return what a copy needs, which binds its own arrays."""
        names = ("_made", "_samples", "report", "_threads")
        return {name: getattr(self, name) for name in names}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)
        self._forget()

    def core(self) -> _core.Filter:
        """Return the compiled filter, bound to the plants and their reports."""
        core, made = self._core, self._made
        if core is None:
            core = _core.Filter(made.words, made.program, self._samples.words, self._threads)
            if self._samples.is_apart:
                core.set_states(*self._samples.states)
            if made.gate is not None:
                core.set_laws(made.gate.input)
            self._core = core
        if self.report.words is not self._words:
            self._words = self.report.words
            core.set_report(*self.report.words)
        return core

    def filter(self, scene: SceneArrays, own: Array) -> int:
        """Filter the plants by the compiled program or a solver; return what is to be done.

        Args:
            scene: of the plants.
            own: rows that were made beforehand.
        """
        core = self.core()
        kind, parameters, priority, own_margin, atlas, ends = scene
        a, b, c, d, e, f, g = self._scene
        same = kind is a and parameters is b and priority is c and own_margin is d
        if not (same and atlas is e and ends is f and own is g):
            core.set_scene(*scene, own)
            self._scene = *scene, own
        if self._made.solver is None:
            return core.filter()
        return solvers.answer(self._made.solver, core, self._made.count)


def arrays_of(scene: BarrierSet) -> SceneArrays:
    """Return the scenes as compiled code reads them."""
    numbers = scene.kind, scene.parameters, scene.priority, scene.own_margin
    return (*numbers, scene.atlas.numbers, scene.ends)
