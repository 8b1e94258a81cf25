"""The ages of the scans in N scenes, and their margins, which grow with the age."""

import math
from typing import NamedTuple

from hcbf_gym.arrays import Mask
from hcbf_gym.barriers.mapped import SeenRegion
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.filter.samples import Samples
from hcbf_gym.models import clocks
from hcbf_gym.models.clocks import SEEN_FOR


class _Scan(NamedTuple):
    """A scan in a scene, of things that may have moved since."""

    scene: int  # index of N
    place: int  # index of m
    region: SeenRegion


class ScanAges:
    """Reserves what may have come nearer since scans were taken, until the next sample.

    Attributes:
        has_scans: whether a scene has a scan whose margin grows.
        clock_zero: when the plants' time was 0, on the clock of the scans' stamps [s].
    """

    def __init__(self, samples: Samples, period: float | None):
        self._samples, self._period = samples, period or 0.0
        self.has_scans, self.clock_zero = False, 0.0
        self._scenes = BarrierSet([()])
        self._scans: list[_Scan] = []
        self._first_times: dict[tuple[int, SeenRegion], float] = {}  # of scans without a stamp [s]

    def forget(self, mask: Mask) -> None:
        """Let scans without a stamp count from the next sample of the masked plants (N,)."""
        self._first_times = {k: time for k, time in self._first_times.items() if not mask[k[0]]}

    def go_on_from(self, other: "ScanAges") -> None:
        """Let scans count from the same times as in other scenes."""
        self._scenes, self._scans, self.has_scans = other._scenes, other._scans, other.has_scans
        self._first_times = other._first_times

    def set_scenes(self, scenes: BarrierSet) -> None:
        """Look for scans of things that may move in changed scenes."""
        self._scenes, held = scenes, scenes.atlas.held.items()
        self._scans = [
            _Scan(i, k, one)
            for (i, k), one in held
            if isinstance(one, SeenRegion) and one.speed > 0.0
        ]
        self.has_scans = bool(self._scans)
        self._first_times = self._first_times if self.has_scans else {}

    def update(self) -> str:
        """Write the margins of scans at their ages; return what is wrong with a stamp, or ""."""
        first_times, self._first_times, wrong = self._first_times, {}, ""
        for i, k, region in self._scans:
            now = float(self._samples.time[i]) + self.clock_zero
            if not math.isfinite(now):
                continue
            stamp = region.stamp
            if stamp is None:
                stamp = self._first_times[i, region] = first_times.get((i, region), now)
            age = now - stamp
            if not clocks.is_accepted(age, SEEN_FOR):
                wrong = f"the scan {region.name!r}: {clocks.refusal(age, SEEN_FOR)}"
            self._scenes.own_margin[i, k] = region.margin_at(now + self._period - stamp)
        return wrong
