#include <hcbf/model_monitor.hpp>
#include <hcbf/monitor.hpp>
#include <hcbf/nearness.hpp>

#include "records.hpp"

namespace hcbf {

namespace {

using Mask = Numbers<const bool, 1>;
using States = Numbers<const double, 2>;
using Terms = Numbers<const double, 3>;

// As the named tuples of `filtering.model_monitor` hold them.
using Watched = std::tuple<double, double, double, Numbers<const double, 1>, Mask>;
using Sample = std::tuple<States, States, States, Terms, Terms>;
using Arrival = std::tuple<Numbers<double, 2>, Numbers<double, 3>, Numbers<double, 2>, Numbers<bool, 1>,
                           Numbers<double, 2>, Numbers<double, 2>>;

model_monitor::Watched view(const Watched& watched) {
  const auto& [period, radius, confidence, largest, steered] = watched;
  return {period, radius, confidence, hcbf::view(largest), hcbf::view(steered)};
}

model_monitor::Sample view(const Sample& sample) {
  const auto& [body, model, f, g, g_model] = sample;
  return {hcbf::view(body), hcbf::view(model), hcbf::view(f), hcbf::view(g), hcbf::view(g_model)};
}

model_monitor::Arrival view(const Arrival& arrival) {
  const auto& [chosen, to_input, u, other, body, model] = arrival;
  return {hcbf::view(chosen), hcbf::view(to_input), hcbf::view(u),
          hcbf::view(other), hcbf::view(body), hcbf::view(model)};
}

void bind_monitor(nb::module_& m) {
  m.def("monitor_watch", [](const Words& plant, double radius, double confidence, bool exact, bool observed) {
    const auto sensed = records<plants::Plant>(plant);
    monitor::watch(sensed[0], {sensed.tail(0), 2}, radius, confidence, exact, observed);
  }, "plant"_a.noconvert(), "radius"_a, "confidence"_a, "exact"_a, "observed"_a,
  "Compare a valid sample of a planar double integrator with the one before, and raise its alarms.");
}

void bind_model_monitor(nb::module_& m) {
  m.def("model_arrivals", [](const Watched& watched, const Words& plants, const Mask& believed,
                             const States& x, const Terms& g, const Arrival& arrival) {
    return model_monitor::arrivals(view(watched), records<plants::Plant>(plants), hcbf::view(believed),
                                   hcbf::view(x), hcbf::view(g), view(arrival));
  }, "watched"_a, "plants"_a.noconvert(), "believed"_a, "x"_a, "g"_a, "arrival"_a.noconvert(),
  "Write the inputs that seem to have arrived, and return whether any differs from the chosen one.");
  m.def("model_observe", [](const Watched& watched, const Words& plants, const Mask& believed,
                            const Terms& covariance, const std::tuple<Sample, Sample>& samples,
                            const Arrival& arrival, const Numbers<double, 3>& sums) {
    const auto& [now, last] = samples;
    model_monitor::observe(view(watched), records<plants::Plant>(plants), hcbf::view(believed),
                           hcbf::view(covariance), {view(now), view(last), view(arrival), hcbf::view(sums)});
  }, "watched"_a, "plants"_a.noconvert(), "believed"_a, "covariance"_a, "samples"_a, "arrival"_a.noconvert(),
  "sums"_a.noconvert(), "Account for a sample of N plants of any model, and raise their alarms.");
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
  bind_model_monitor(m);
  bind_nearness(m);
}

}  // namespace hcbf
