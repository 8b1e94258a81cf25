#include <hcbf/monitor.hpp>
#include <hcbf/nearness.hpp>

#include "records.hpp"

namespace hcbf {

namespace {

void bind_monitor(nb::module_& m) {
  m.def("monitor_watch", [](const Words& plant, double radius, double confidence, bool exact, bool observed) {
    const auto sensed = records<plants::Plant>(plant);
    monitor::watch(sensed[0], {sensed.tail(0), 2}, radius, confidence, exact, observed);
  }, "plant"_a.noconvert(), "radius"_a, "confidence"_a, "exact"_a, "observed"_a,
  "Compare a valid sample of a planar double integrator with the one before, and raise its alarms.");
}

void bind_nearness(nb::module_& m) {
  using Scenes = std::pair<Numbers<const Index, 2>, Numbers<const double, 3>>;
  m.def("nearness_find_beside", [](const Scenes& before, const Scenes& now,
                                   const Numbers<const double, 2>& earlier,
                                   const Numbers<const double, 1>& t, const Numbers<Index, 2>& found) {
    nearness::find_beside({hcbf::view(before.first), hcbf::view(before.second)},
                          {hcbf::view(now.first), hcbf::view(now.second)}, hcbf::view(earlier), hcbf::view(t),
                          hcbf::view(found));
  }, "before"_a, "now"_a, "earlier"_a, "t"_a, "found"_a.noconvert(),
  "Write which regions of the scenes before were those of the scenes now.");
}

}  // namespace

void bind_monitors(nb::module_& m) {
  bind_monitor(m);
  bind_nearness(m);
}

}  // namespace hcbf
