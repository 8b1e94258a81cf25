#include <hcbf/monitor.hpp>
#include <hcbf/nearness.hpp>

#include "records.hpp"

namespace nanobind::detail {
using hcbf::Cube, hcbf::Index, hcbf::Matrix;
template <>
struct type_caster<hcbf::nearness::Scenes>
    : tuple_caster<hcbf::nearness::Scenes, Matrix<const Index>, Cube<const double>> {};
}  // namespace nanobind::detail

namespace hcbf {

namespace {

void bind_monitor(nb::module_& m) {
  m.def("monitor_watch", [](const Words& plant, double radius, double confidence, bool exact, bool observed) {
    const auto sensed = records<plants::Plant>(plant);
    monitor::watch(sensed[0], {sensed.tail(0), 2}, radius, confidence, exact, observed);
  }, "plant"_a, "radius"_a, "confidence"_a, "exact"_a, "observed"_a,
  "Compare a valid sample of a planar double integrator with the one before, and raise its alarms.");
}

void bind_nearness(nb::module_& m) {
  m.def("nearness_find_beside", &nearness::find_beside, "before"_a, "now"_a, "earlier"_a, "t"_a, "found"_a,
  "Write which regions of the scenes before were those of the scenes now.");
}

}  // namespace

void bind_monitors(nb::module_& m) {
  bind_monitor(m);
  bind_nearness(m);
}

}  // namespace hcbf
