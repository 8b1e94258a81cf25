"""The ages of the scans in N scenes, and the margins of scans, which grow with their age."""

import math
from typing import NamedTuple

from hcbf_gym.arrays import Mask
from hcbf_gym.barriers.mapped import SeenRegion
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.filter.samples import Samples, WrongAge
from hcbf_gym.models import clocks
from hcbf_gym.models.clocks import SEEN_FOR


class _Scan(NamedTuple):
    """A scan of things that may have moved since."""

    plant: int  # the index of its scene, below N
    condition: int  # its index in the scene, below m
    region: SeenRegion


class ScanAges:
    """Grows the margins of scans by what may have come nearer, until the next sample.

    Attributes:
        has_scans: whether a scene has a scan whose margin grows.
        clock_zero: the plants' time 0, on the clock of the scans' stamps [s].
    """

    def __init__(self, samples: Samples, period: float | None):
        self._samples, self._period = samples, period or 0.0
        self.has_scans, self.clock_zero = False, 0.0
        self._scenes = BarrierSet([()])
        self._scans: list[_Scan] = []
        # (plant, scan without a stamp) → the time at which it was seen first [s]
        self._first_times: dict[tuple[int, SeenRegion], float] = {}

    def forget(self, mask: Mask) -> None:
        """Let scans without a stamp count from the next sample of the masked plants (N,)."""
        first_times = self._first_times.items()
        self._first_times = {key: time for key, time in first_times if not mask[key[0]]}

    def go_on_from(self, other: "ScanAges") -> None:
        """Let scans count from the same times as in another filter's scenes."""
        self._scenes, self._scans, self.has_scans = other._scenes, other._scans, other.has_scans
        self._first_times = other._first_times

    def set_scenes(self, scenes: BarrierSet) -> None:
        """Find the scans of things that may move in changed scenes."""
        self._scenes = scenes
        self._scans = [
            _Scan(plant, condition, region)
            for (plant, condition), region in scenes.atlas.held.items()
            if isinstance(region, SeenRegion) and region.speed > 0.0
        ]
        self.has_scans = bool(self._scans)
        self._first_times = self._first_times if self.has_scans else {}

    def update(self) -> WrongAge | None:
        """Write the margins of scans at their ages; return an age that is not accepted, or None."""
        first_times, self._first_times = self._first_times, {}
        wrong_age = None
        for plant, condition, region in self._scans:
            now = float(self._samples.time[plant]) + self.clock_zero
            if not math.isfinite(now):
                continue
            stamp = region.stamp
            if stamp is None:
                stamp = first_times.get((plant, region), now)
                self._first_times[plant, region] = stamp
            age = now - stamp
            if not clocks.is_accepted(age, SEEN_FOR):
                wrong_age = WrongAge(f"the scan {region.name!r}", age, SEEN_FOR)
            margin = region.margin_at(now + self._period - stamp)
            self._scenes.own_margin[plant, condition] = margin
        return wrong_age
