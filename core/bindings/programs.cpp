#include <array>
#include <vector>

#include <hcbf/dense.hpp>
#include <hcbf/least_cost.hpp>
#include <hcbf/stage_rows.hpp>

#include "planar_program.hpp"

namespace hcbf {

namespace {

using polygon::Point, polygon::Polygon;

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

auto arrays_of(dense::Rows rows) {
  const std::size_t count = rows.b.size(), columns = rows.columns;
  return std::pair(array_of<2>(std::move(rows.a), {count, columns}), array_of<1>(std::move(rows.b), {count}));
}

void bind_planar(nb::module_& m) {
  nb::class_<PlanarProgram>(m, "PlanarProgram", "A program of two inputs with its prices and U.")
      .def(nb::init<Index, bool, Index, bool, bool, double, double, bool, const Numbers<const double, 3>&,
                    const Numbers2&>(),
           "lower"_a, "by_level"_a, "lock"_a, "ranks"_a, "guided"_a, "radius"_a, "lambda_u"_a,
           "known_offset"_a, "vertices"_a, "weights"_a, "Copy what `planar.records.Settings` has.")
      .def("filter", &PlanarProgram::filter, "u_nominal"_a, "a"_a, "b"_a, "h"_a, "priority"_a, "alpha2_psi"_a,
           "answer"_a.noconvert(), Unlocked(),
           "Write u, slack, delta and statuses of N states; False where u* or a row is malformed.");
  m.def("least_cost", [](const Numbers2& soft, bool one_sided, const Numbers2& rows, const Numbers1& lower,
                         double radius) {
    const Point z = least_cost::least_cost(view(soft), one_sided, view(rows), view(lower), radius);
    return std::pair(z.x, z.y);
  }, "soft"_a, "one_sided"_a, "rows"_a, "lower"_a, "radius"_a,
  "Return a minimiser z of the cost of rows `soft` (s, 5) a, t, w, least over rows z >= lower.");
  m.def("polygon_cut", [](const Numbers2& corners, std::pair<double, double> n, double d, double radius) {
    const auto points = polygon::points(view(corners));
    Polygon polygon{{points.begin(), points.end()}, {}};
    polygon::cut(polygon, {{n.first, n.second}, d}, radius);
    const double* numbers = &polygon.corners[0].x;
    return array_of<2>({numbers, numbers + 2 * polygon.corners.size()}, {polygon.corners.size(), 2});
  }, "corners"_a, "n"_a, "d"_a, "radius"_a, "Return the corners of a polygon cut to n u >= d.");
  m.def("polygon_minimum", [](const Numbers2& corners, const Numbers2& a, const Numbers1& t,
                              std::pair<double, double> u_nominal, double radius) {
    const auto points = polygon::points(view(corners));
    const Polygon polygon{{points.begin(), points.end()}, {}};
    Polygon chord;
    polygon::LeastSquares problem;
    for (Index k = 0; k < view(t).size; ++k) problem.add(view(a)(k, 0), view(a)(k, 1), view(t)[k]);
    const Point u = polygon::minimise(polygon, problem, {u_nominal.first, u_nominal.second}, radius, chord);
    return std::pair(u.x, u.y);
  }, "corners"_a, "a"_a, "t"_a, "u_nominal"_a, "radius"_a,
  "Return the point of a polygon that minimises |a u - t|²; of several, the nearest to u*.");
}

void bind_rows(nb::module_& m) {
  m.attr("TOLERANCE_NOMINAL") = tolerances::NOMINAL;
  m.attr("TOLERANCE_ZERO_GRADIENT") = tolerances::ZERO_GRADIENT;
  m.attr("TOLERANCE_MET") = tolerances::MET;
  m.def("well_formed", [](const Numbers2& a, const Numbers1& b, const Numbers1& h, const Integers& priority) {
    return cbf_rows::well_formed({view(a), view(b), view(h), view(priority), {}});
  }, "a"_a, "b"_a, "h"_a, "priority"_a,
  "Return whether the rows of one state are finite, with priorities 1, 2, … without a gap.");
  m.def("has_no_gap", [](const Integers& priority) { return cbf_rows::has_no_gap(view(priority)); },
        "priority"_a, "Return whether priorities are 1, 2, … without a gap.");
  m.def("row_weight", [](const Numbers1& table, Index priority, double h) {
    return weights::weight_of(view(table), priority, h);
  }, "table"_a, "priority"_a, "h"_a, "Return λ_δ(h) of one row; infinity for one of a strict level.");
  m.def("violation", [](const Numbers2& a, const Numbers1& b, const Numbers1& u, double radius) {
    std::vector<double> slack(b.size());
    result::violation(view(a), view(b), view(u), radius, {slack.data(), view(b).size});
    return array_of<1>(std::move(slack), {b.size()});
  }, "a"_a, "b"_a, "u"_a, "radius"_a,
  "Return each row's violation at u, with what rounding leaves set to 0.");
  m.def("stage_rows", [](const Numbers1& table, bool by_level, const Integers& priority, const Numbers1& h,
                         const Numbers<Index, 1>& stage, const Numbers<bool, 1>& strict,
                         const Numbers<double, 1>& weight) {
    stage_rows::staged(view(table), by_level, view(priority), view(h), view(stage), view(strict),
                       view(weight));
  }, "table"_a, "by_level"_a, "priority"_a, "h"_a, "stage"_a.noconvert(), "strict"_a.noconvert(),
  "weight"_a.noconvert(), "Write each row's stage, whether the stage meets it, and its weight.");
}

void bind_dense(nb::module_& m) {
  using dense::Scale;
  m.def("unit_rows", [](const Numbers2& a, const Numbers1& b, double least) {
    return arrays_of(dense::scaled_rows(view(a), view(b), least, Scale::UNIT));
  }, "a"_a, "b"_a, "least"_a,
  "Return the rows a x >= b scaled to unit norm, without those of norm `least` or below.");
  m.def("level_rows", [](const Numbers2& a, const Numbers1& b, double least) {
    return arrays_of(dense::scaled_rows(view(a), view(b), least, Scale::BY_POWER));
  }, "a"_a, "b"_a, "least"_a,
  "Return the rows a x >= b scaled by powers of two to norms from 1/2 to 1, without constants.");
  m.def("whiten", [](const Numbers2& a, const Numbers1& target, const Numbers1& centre) {
    const std::size_t n = centre.size();
    std::vector<double> factor(n * n), y(n);
    const Index size = view(centre).size;
    dense::whiten(view(a), view(target), view(centre), {factor.data(), size, size}, {y.data(), size});
    return std::pair(array_of<2>(std::move(factor), {n, n}), array_of<1>(std::move(y), {n}));
  }, "a"_a, "target"_a, "centre"_a, "Return R and y: |z - c|² + |a z - t|² is |R z - y|² and a constant.");
  m.def("image_of_rows", [](const Numbers2& rows, const Numbers2& factor) {
    std::vector<double> image(rows.data(), rows.data() + rows.size());
    dense::image_of_rows({image.data(), view(rows).rows, view(rows).columns}, view(factor));
    return array_of<2>(std::move(image), {rows.shape(0), rows.shape(1)});
  }, "rows"_a, "factor"_a, "Return rows R⁻¹ (k, n): the rows as they act on y = R z.");
  m.def("back_substitute", [](const Numbers2& factor, const Numbers1& y) {
    std::vector<double> z(y.data(), y.data() + y.size());
    dense::back_substitute(view(factor), {z.data(), view(y).size});
    return array_of<1>(std::move(z), {y.size()});
  }, "factor"_a, "y"_a, "Return z (n,) with R z = y.");
  m.def("meets", [](const Numbers2& a, const Numbers1& lower, const Numbers1& x, double tolerance) {
    return dense::meets(view(a), view(lower), view(x), tolerance);
  }, "a"_a, "lower"_a, "x"_a, "tolerance"_a,
  "Return whether x misses no row by more than tolerance (1 + max|x|); NaN fails.");
  m.def("with_slack", [](const Numbers2& rows, const Numbers1& lower, const Numbers2& a,
                         const Numbers1& target, const Numbers1& least) {
    return arrays_of(dense::with_slack(view(rows), view(lower), view(a), view(target), view(least)));
  }, "rows"_a, "lower"_a, "a"_a, "target"_a, "least"_a,
  "Return the rows on (z, s) of rows z >= lower, a z + s >= target and s >= least.");
  m.def("steepness", [](const Numbers2& a, const Numbers2& basis) {
    const std::size_t count = a.shape(0);
    std::vector<double> whole(count), within(count);
    dense::steepness(view(a), view(basis), {whole.data(), view(a).rows}, {within.data(), view(a).rows});
    return std::pair(array_of<1>(std::move(whole), {count}), array_of<1>(std::move(within), {count}));
  }, "a"_a, "basis"_a, "Return how steep the rows are (k,), and how steep in the directions of a basis.");
  m.def("violated", [](const Numbers2& a, const Numbers1& b, const Numbers1& u,
                       const Numbers<bool, 1>& violates) {
    dense::violated(view(a), view(b), view(u), view(violates));
  }, "a"_a, "b"_a, "u"_a, "violates"_a.noconvert(), "Write which rows a u >= b u violates, rounding aside.");
}

}  // namespace

void bind_programs(nb::module_& m) {
  bind_planar(m);
  bind_rows(m);
  bind_dense(m);
}

}  // namespace hcbf
