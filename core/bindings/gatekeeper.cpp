#include <hcbf/clearance.hpp>
#include <hcbf/manoeuvres.hpp>

#include <nanobind/stl/vector.h>

#include "bindings.hpp"

namespace hcbf {

polygon::Point gate_input(const void* laws, Index which, const double* x, Index begun) {
  const nb::gil_scoped_acquire locked;
  const auto& call = *static_cast<const nb::object*>(laws);
  const auto [ux, uy] =
      nb::cast<std::pair<double, double>>(call(which, nb::make_tuple(x[0], x[1], x[2], x[3]), begun));
  return {ux, uy};
}

void bind_gatekeeper(nb::module_& m) {
  m.def(
      "clears",
      [](Index kind, const Numbers<const double, 1>& c, const std::vector<double>& p) {
        return clearance::holds(kind, c.data(), {p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8]});
      },
      "kind"_a, "c"_a, "path"_a,
      "Return whether h ≥ m + sτ along p + rτ + ½uτ², τ in [0, T]; path: p, r, u, T, m and s.");
  m.def(
      "manoeuvre",
      [](Matrix<const double> corners, double period, std::pair<double, double> target, Index samples,
         const Numbers<const double, 1>& x) {
        const manoeuvres::Plant plant{polygon::points(corners), period, {}};
        manoeuvres::State state{{x.data()[0], x.data()[1], x.data()[2], x.data()[3]}, 0.0};
        std::vector<double> pieces;
        const auto note = [&](const manoeuvres::State& at, const polygon::Point& u, double span) {
          pieces.insert(pieces.end(), {at.x[0], at.x[1], at.x[2], at.x[3], u.x, u.y, span});
          return true;
        };
        manoeuvres::follow(plant, {{target.first, target.second}, samples, 0, 0}, state, note);
        pieces.insert(pieces.end(), {state.x[0], state.x[1], state.x[2], state.x[3], 0.0, 0.0, 0.0});
        const std::size_t count = pieces.size() / 7;
        return owned<double>(std::move(pieces), {count, std::size_t{7}});
      },
      "corners"_a, "period"_a, "target"_a, "samples"_a, "x"_a,
      "Return (k, 7) state, input and length of each piece of a manoeuvre, and last the state at rest.");
}

}  // namespace hcbf
