#include <hcbf/axle.hpp>
#include <hcbf/constants.hpp>
#include <hcbf/reduced_order.hpp>
#include <hcbf/vehicles.hpp>

#include "structs.hpp"

namespace hcbf {

namespace {

using States = Matrix<const double>;
using Inputs = Matrix<const double>;
using Written = Matrix<double>;

void bind_reduced_order(nb::module_& m) {
  m.def("damped_drifts", [](const States& x, double drag, const Written& f) {
    for (Index i = 0; i < x.rows; ++i) reduced_order::damped_drift(x[i], drag, f[i]);
  }, "x"_a, "drag"_a, "f"_a, "Write (N, n) the drifts (v, -c v) of N states.");
  m.def("damped_steps", [](const States& x, const Inputs& u, double dt, double drag, const Written& after) {
    for (Index i = 0; i < x.rows; ++i)
      reduced_order::damped_step(x[i], u[i], dt, drag, after[i]);
  }, "x"_a, "u"_a, "dt"_a, "drag"_a, "after"_a, "Write (N, n) the states after dt.");
  m.def("double_integrator_step", [](const Vector<const double>& x, const Vector<const double>& u, double dt,
                                     double v_max) {
    const auto [px, py, vx, vy] = reduced_order::double_integrator_step(x, u, dt, v_max);
    return std::tuple(px, py, vx, vy);
  }, "x"_a, "u"_a, "dt"_a, "v_max"_a,
  "Return the state of a double integrator after dt, its speed capped at v_max.");
}

void bind_vehicles(nb::module_& m) {
  m.def("unicycle_inputs", [](const States& x, const Cube<double>& g) {
    for (Index i = 0; i < x.rows; ++i) vehicles::unicycle_inputs(x[i].data, g[i].data);
  }, "x"_a, "g"_a, "Write g (N, 3, 2) at N states.");
  m.def("unicycle_steps", [](const States& x, const Inputs& u, double dt, const Written& after) {
    for (Index i = 0; i < x.rows; ++i)
      vehicles::unicycle_step(x[i].data, u[i].data, dt, after[i].data);
  }, "x"_a, "u"_a, "dt"_a, "after"_a, "Write (N, 3) the states after dt.");
  m.def("bicycle_drifts", [](const States& x, double rear, const Written& f) {
    for (Index i = 0; i < x.rows; ++i) vehicles::bicycle_rate(x[i].data, 0, 0, rear, f[i].data);
  }, "x"_a, "rear"_a, "f"_a, "Write f (N, 4) at N states.");
  m.def("bicycle_inputs", [](const States& x, double rear, const Cube<double>& g) {
    for (Index i = 0; i < x.rows; ++i) vehicles::bicycle_inputs(x[i].data, rear, g[i].data);
  }, "x"_a, "rear"_a, "g"_a, "Write g (N, 4, 2) at N states.");
  m.def("bicycle_steps", [](const States& x, const Inputs& u, double dt, double rear, const Written& after) {
    for (Index i = 0; i < x.rows; ++i)
      vehicles::bicycle_step(x[i].data, u[i].data, dt, rear, after[i].data);
  }, "x"_a, "u"_a, "dt"_a, "rear"_a, "after"_a, "Write (N, 4) the states after dt.");
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
  bind_reduced_order(m);
  bind_vehicles(m);
  bind_axle(m);
}

}  // namespace hcbf
