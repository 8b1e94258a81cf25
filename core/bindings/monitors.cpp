#include <hcbf/monitor.hpp>
#include <hcbf/nearness.hpp>

#include "records.hpp"

// As the named tuples of `filtering.model_monitor` hold them.
namespace nanobind::detail {
using hcbf::Cube, hcbf::Index, hcbf::Matrix, hcbf::Vector;
namespace monitors = hcbf::model_monitor;
template <>
struct type_caster<monitors::Watched>
    : tuple_caster<monitors::Watched, double, double, double, Vector<const double>, Vector<const bool>> {};
template <>
struct type_caster<monitors::Sample>
    : tuple_caster<monitors::Sample, Matrix<const double>, Matrix<const double>, Matrix<const double>,
                   Cube<const double>, Cube<const double>> {};
template <>
struct type_caster<monitors::Arrival>
    : tuple_caster<monitors::Arrival, Matrix<double>, Cube<double>, Matrix<double>, Vector<bool>,
                   Matrix<double>, Matrix<double>> {};
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
