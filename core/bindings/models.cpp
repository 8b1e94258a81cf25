#include <hcbf/axle.hpp>
#include <hcbf/constants.hpp>
#include <hcbf/reduced_order.hpp>
#include <hcbf/vehicles.hpp>

#include "records.hpp"

namespace hcbf {

namespace {

using States = Numbers<const double, 2>;
using Inputs = Numbers<const double, 2>;
using Written = Numbers<double, 2>;

void bind_reduced_order(nb::module_& m) {
  m.def("damped_drifts", [](const States& x, double drag, const Written& f) {
    for (Index i = 0; i < view(x).rows; ++i) reduced_order::damped_drift(view(x)[i], drag, view(f)[i]);
  }, "x"_a, "drag"_a, "f"_a.noconvert(), "Write (N, n) the drifts (v, -c v) of N states.");
  m.def("damped_steps", [](const States& x, const Inputs& u, double dt, double drag, const Written& after) {
    for (Index i = 0; i < view(x).rows; ++i)
      reduced_order::damped_step(view(x)[i], view(u)[i], dt, drag, view(after)[i]);
  }, "x"_a, "u"_a, "dt"_a, "drag"_a, "after"_a.noconvert(), "Write (N, n) the states after dt.");
  m.def("double_integrator_step", [](const Numbers<const double, 1>& x, const Numbers<const double, 1>& u, double dt,
                                     double v_max) {
    const auto [px, py, vx, vy] = reduced_order::double_integrator_step(view(x), view(u), dt, v_max);
    return std::tuple(px, py, vx, vy);
  }, "x"_a, "u"_a, "dt"_a, "v_max"_a,
  "Return the state of a double integrator after dt, its speed capped at v_max.");
}

void bind_vehicles(nb::module_& m) {
  m.def("unicycle_inputs", [](const States& x, const Numbers<double, 3>& g) {
    for (Index i = 0; i < view(x).rows; ++i) vehicles::unicycle_inputs(view(x)[i].data, view(g)[i].data);
  }, "x"_a, "g"_a.noconvert(), "Write g (N, 3, 2) at N states.");
  m.def("unicycle_steps", [](const States& x, const Inputs& u, double dt, const Written& after) {
    for (Index i = 0; i < view(x).rows; ++i)
      vehicles::unicycle_step(view(x)[i].data, view(u)[i].data, dt, view(after)[i].data);
  }, "x"_a, "u"_a, "dt"_a, "after"_a.noconvert(), "Write (N, 3) the states after dt.");
  m.def("bicycle_drifts", [](const States& x, double rear, const Written& f) {
    for (Index i = 0; i < view(x).rows; ++i) vehicles::bicycle_rate(view(x)[i].data, 0, 0, rear, view(f)[i].data);
  }, "x"_a, "rear"_a, "f"_a.noconvert(), "Write f (N, 4) at N states.");
  m.def("bicycle_inputs", [](const States& x, double rear, const Numbers<double, 3>& g) {
    for (Index i = 0; i < view(x).rows; ++i) vehicles::bicycle_inputs(view(x)[i].data, rear, view(g)[i].data);
  }, "x"_a, "rear"_a, "g"_a.noconvert(), "Write g (N, 4, 2) at N states.");
  m.def("bicycle_steps", [](const States& x, const Inputs& u, double dt, double rear, const Written& after) {
    for (Index i = 0; i < view(x).rows; ++i)
      vehicles::bicycle_step(view(x)[i].data, view(u)[i].data, dt, rear, view(after)[i].data);
  }, "x"_a, "u"_a, "dt"_a, "rear"_a, "after"_a.noconvert(), "Write (N, 4) the states after dt.");
}

using Limits = std::tuple<double, double, double, double>;

axle::Axle axle_of(const Limits& limits) {
  const auto [look_ahead, forward, turn, braking] = limits;
  return {look_ahead, forward, turn, braking};
}

void bind_axle(nb::module_& m) {
  m.def("axle_across", [](const Limits& limits) { return axle::across(axle_of(limits)); }, "axle"_a,
        "Return the greatest acceleration of the point across the heading.");
  m.def("axle_speeds", [](const Limits& limits, const Numbers<const double, 1>& x, double heading) {
    const auto now = axle::speeds(axle_of(limits), x.data(), heading);
    return std::pair(now.forward, now.turning);
  }, "axle"_a, "x"_a, "heading"_a, "Return v and ω of the point's state x (4,).");
  m.def("axle_place", [](const Limits& limits, const Numbers<const double, 1>& x, double heading,
                         const Numbers<double, 1>& out) {
    axle::place(axle_of(limits), x.data(), heading, out.data());
  }, "axle"_a, "x"_a, "heading"_a, "out"_a.noconvert(), "Write position and velocity (4,) of the axle.");
  m.def("axle_corners", [](const Limits& limits, const Numbers<const double, 1>& x, double heading, double period,
                           const Written& out) {
    axle::corners(axle_of(limits), x.data(), heading, period, out.data());
  }, "axle"_a, "x"_a, "heading"_a, "period"_a, "out"_a.noconvert(), "Write the corners (4, 2) of U at one state.");
}

}  // namespace

void bind_models(nb::module_& m) {
  m.attr("GRAVITY") = constants::GRAVITY;
  m.attr("FARTHEST") = constants::FARTHEST;
  m.attr("STANDING") = constants::STANDING;
  m.attr("ASKING") = constants::ASKING;
  bind_reduced_order(m);
  bind_vehicles(m);
  bind_axle(m);
}

}  // namespace hcbf
