#include <hcbf/axle.hpp>
#include <hcbf/constants.hpp>
#include <hcbf/reduced_order.hpp>

#include "structs.hpp"

namespace hcbf {

namespace {

using Written = Matrix<double>;

void bind_double_integrator(nb::module_& m) {
  m.def("double_integrator_step", [](const Vector<const double>& x, const Vector<const double>& u, double dt,
                                     double v_max) {
    const auto [px, py, vx, vy] = reduced_order::double_integrator_step(x, u, dt, v_max);
    return std::tuple(px, py, vx, vy);
  }, "x"_a, "u"_a, "dt"_a, "v_max"_a,
  "Return the state of a double integrator after dt, its speed capped at v_max.");
}

void bind_axle(nb::module_& m) {
  m.def("axle_across", &axle::across, "axle"_a,
        "Return the greatest acceleration of the point across the heading.");
  m.def("axle_speeds", [](const axle::Axle& axle, const Vector<const double>& x, double heading) {
    const auto now = axle::speeds(axle, x.data, heading);
    return std::pair(now.forward, now.turning);
  }, "axle"_a, "x"_a, "heading"_a, "Return v and ω of the point's state x (4,).");
  m.def("axle_place", [](const axle::Axle& axle, const Vector<const double>& x, double heading,
                         const Vector<double>& out) {
    axle::place(axle, x.data, heading, out.data);
  }, "axle"_a, "x"_a, "heading"_a, "out"_a, "Write position and velocity (4,) of the axle.");
  m.def("axle_corners", [](const axle::Axle& axle, const Vector<const double>& x, double heading, double period,
                           const Written& out) {
    axle::corners(axle, x.data, heading, period, out.data);
  }, "axle"_a, "x"_a, "heading"_a, "period"_a, "out"_a, "Write the corners (4, 2) of U at one state.");
}

}  // namespace

void bind_models(nb::module_& m) {
  m.attr("GRAVITY") = constants::GRAVITY;
  m.attr("FARTHEST") = constants::FARTHEST;
  m.attr("STANDING") = constants::STANDING;
  m.attr("ASKING") = constants::ASKING;
  bind_double_integrator(m);
  bind_axle(m);
}

}  // namespace hcbf
