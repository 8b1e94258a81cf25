#include <array>
#include <optional>
#include <vector>

#include <nanobind/stl/optional.h>

#include <hcbf/general_cascade.hpp>

#include "planar_program.hpp"

namespace hcbf {

namespace {

using program_records::Lock, program_records::Lower;

using Numbers1 = Numbers<const double, 1>;
using Numbers2 = Numbers<const double, 2>;
using Integers = Numbers<const Index, 1>;

// An array for Python that owns its numbers.
template <int N>
auto array_of(std::vector<double> numbers, std::array<std::size_t, N> shape) {
  auto* kept = new std::vector<double>(std::move(numbers));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
  return nb::ndarray<nb::numpy, double, nb::ndim<N>>(kept->data(), N, shape.data(), owner);
}

void bind_planar(nb::module_& m) {
  nb::class_<PlanarProgram>(m, "PlanarProgram", "A program of two inputs with its prices and U.")
      .def(nb::init<Index, bool, Index, bool, bool, double, double, bool, const Numbers<const double, 3>&,
                    const Numbers2&>(),
           "lower"_a, "by_level"_a, "lock"_a, "ranks"_a, "guided"_a, "radius"_a, "lambda_u"_a,
           "known_offset"_a, "vertices"_a, "weights"_a, "Copy the settings of a program.")
      .def("filter", &PlanarProgram::filter, "u_nominal"_a, "a"_a, "b"_a, "h"_a, "priority"_a, "alpha2_psi"_a,
           "answer"_a.noconvert(), Unlocked(),
           "Write u, slack, delta and statuses of N states; False where u* or a row is malformed.");
}

// A solver of Python's: `project(centre, a, lower, nonempty)` returns the point, or None.
polyhedron::Solver solver_of(nb::object solve) {
  if (solve.is_none()) return {};
  return [solve = std::move(solve)](const projection::Projection<double>& problem, bool nonempty,
                                    std::vector<double>& x) {
    const std::size_t n = problem.centre.size(), count = problem.b.size();
    const nb::object found = solve(array_of<1>(problem.centre, {n}), array_of<2>(problem.a, {count, n}),
                                   array_of<1>(problem.b, {count}), nonempty);
    if (found.is_none()) return false;
    const auto point = nb::cast<Numbers1>(found);
    x.assign(point.data(), point.data() + point.size());
    return true;
  };
}

// A program of any number of inputs with its prices and U; its arrays are copies.
class GeneralProgram {
 public:
  GeneralProgram(Index lower, bool by_level, Index lock, bool ranks, double radius, double lambda_u,
                 bool known_offset, const Numbers2& weights, const Numbers2& a, const Numbers1& b)
      : weights_(weights.data(), weights.data() + weights.size()),
        a_(a.data(), a.data() + a.size()),
        b_(b.data(), b.data() + b.size()),
        program_{{static_cast<Lower>(lower), by_level, static_cast<Lock>(lock), ranks, false, radius,
                  lambda_u, known_offset, {}, view(weights)}, view(a), view(b)} {
    program_.settings.weights.data = weights_.data();
    program_.a.data = a_.data(), program_.b.data = b_.data();
  }
  GeneralProgram(const GeneralProgram&) = delete;

  // Filters one state into `answer`, u, slack, delta and status one after the other; returns how many
  // projections took twice a double's digits. `project` takes what rounding leaves outside U into it.
  Index filter(const Numbers1& u_nominal, const Numbers2& a, const Numbers1& b, const Numbers1& h,
               const Integers& priority, const Numbers1& alpha2_psi, nb::object solver, nb::object project,
               const Numbers<double, 1>& answer) const {
    const Index m = b.size();
    std::vector<double> u(u_nominal.data(), u_nominal.data() + u_nominal.size());
    double *slack = answer.data() + u.size(), *delta = slack + m;
    const auto inside = [&](std::vector<double>& point) {
      const auto found = nb::cast<Numbers1>(project(array_of<1>(point, {point.size()})));
      point.assign(found.data(), found.data() + found.size());
    };
    const auto [status, fallbacks] = general_cascade::filter_state(
        program_, {view(a), view(b), view(h), view(priority), view(alpha2_psi)}, solver_of(std::move(solver)),
        inside, u, {slack, m}, {delta, m});
    std::copy(u.begin(), u.end(), answer.data());
    delta[m] = status;
    return fallbacks;
  }

 private:
  std::vector<double> weights_, a_, b_;
  general_cascade::Program program_;
};

void bind_general(nb::module_& m) {
  nb::class_<GeneralProgram>(m, "GeneralProgram", "A program of any number of inputs with its prices and U.")
      .def(nb::init<Index, bool, Index, bool, double, double, bool, const Numbers2&, const Numbers2&,
                    const Numbers1&>(),
           "lower"_a, "by_level"_a, "lock"_a, "ranks"_a, "radius"_a, "lambda_u"_a, "known_offset"_a,
           "weights"_a, "a"_a, "b"_a, "Copy a plan, its prices and U, the inputs with a u >= b.")
      .def("filter", &GeneralProgram::filter, "u_nominal"_a, "a"_a, "b"_a, "h"_a, "priority"_a,
           "alpha2_psi"_a, "solver"_a.none(), "project"_a, "answer"_a.noconvert(),
           "Write u, slack, delta and the status of a state; return how many problems were hard.");
  m.def("nearest_point", [](const Numbers2& a, const Numbers1& b, const Numbers1& centre) {
    std::vector<double> x(centre.data(), centre.data() + centre.size());
    const bool found = projection::nearest_point(view(a), view(b), x);
    return found ? std::optional(array_of<1>(x, {x.size()})) : std::nullopt;
  }, "a"_a, "b"_a, "centre"_a, "Return the x with a x >= b nearest to a centre, None if there is none.");
}

void bind_rows(nb::module_& m) {
  m.attr("ZERO_GRADIENT") = tolerances::ZERO_GRADIENT;
  m.def("well_formed", [](const Numbers2& a, const Numbers1& b, const Numbers1& h, const Integers& priority) {
    return program_records::well_formed({view(a), view(b), view(h), view(priority), {}});
  }, "a"_a, "b"_a, "h"_a, "priority"_a,
  "Return whether the rows of one state are finite, with priorities 1, 2, … without a gap.");
  m.def("has_no_gap", [](const Integers& priority) { return program_records::has_no_gap(view(priority)); },
        "priority"_a, "Return whether priorities are 1, 2, … without a gap.");
  m.def("row_weight", [](const Numbers1& table, Index priority, double h) {
    return cascade::weight_of(view(table), priority, h);
  }, "table"_a, "priority"_a, "h"_a, "Return λ_δ(h) of one row; infinity for one of a strict level.");
  m.def("violation", [](const Numbers2& a, const Numbers1& b, const Numbers1& u, double radius) {
    std::vector<double> slack(b.size());
    cascade::violation(view(a), view(b), view(u), radius, {slack.data(), view(b).size});
    return array_of<1>(std::move(slack), {b.size()});
  }, "a"_a, "b"_a, "u"_a, "radius"_a,
  "Return each row's violation at u, with what rounding leaves set to 0.");
}

}  // namespace

void bind_programs(nb::module_& m) {
  bind_planar(m);
  bind_rows(m);
  bind_general(m);
}

}  // namespace hcbf
