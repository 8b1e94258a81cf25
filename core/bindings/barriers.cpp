// Class-K functions, shapes, and the rows of barriers.
#include <algorithm>

#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <hcbf/axle_rows.hpp>
#include <hcbf/general_rows.hpp>
#include <hcbf/mapped.hpp>
#include <hcbf/rows.hpp>
#include <hcbf/shape_terms.hpp>
#include "structs.hpp"

namespace hcbf {
namespace {

using Line = Vector<const double>;
using Table = Matrix<const double>;
using Stack = Cube<const double>;
using Kinds = Matrix<const Index>;
using Written = Vector<double>;
using WrittenTable = Matrix<double>;
using WrittenStack = Cube<double>;
using Atlas = Vector<const double>;  // without numbers where there is no map

void bind_class_k(nb::module_& m) {
  m.def("class_k_value", &class_k::value<double>, "c"_a,
      "h"_a, "Return α(h) of the function with the numbers c (4,).");
  m.def(
      "class_k_values",
      [](const class_k::ClassK& c, const Line& h, const Written& out) {
        for (Index k = 0; k < h.size; ++k) out[k] = class_k::value(c, h[k]);
      },
      "c"_a, "h"_a, "out"_a, "Write α(h) (m,) of h (m,).");
  m.def("class_k_slope", &class_k::slope<double>, "c"_a,
      "h"_a, "Return dα/dh.");
  m.def("class_k_gain_at", &class_k::gain_at, "period"_a, "gain"_a, "Return the gain at a period T [s].");
  m.attr("GAIN") = class_k::GAIN;
  m.attr("LONGEST_HOLD") = mapped::LONGEST_HOLD;
  m.def("class_k_inverse", &class_k::inverse, "c"_a,
      "y"_a, "Return the h of which α(h) = y.");
}

// Binds what writes a shape's block as `disc_write`; the arguments are those of `write`.
template <class... Given>
void bind_write(nb::module_& m, std::string kind, Index (*write)(double*, Given...)) {
  std::replace(kind.begin(), kind.end(), '-', '_');
  m.def((kind + "_write").c_str(),
        [write](const Written& c, std::decay_t<Given>... given) { return write(c.data, given...); },
        "Write a shape into the block c (WIDTH,) and return its kind.");
}

template <class... Shapes>
void bind_writes(nb::module_& m, List<Shapes...>) {
  nb::dict codes;
  ((bind_write(m, Shapes::KIND, Shapes::write), codes[Shapes::KIND] = Shapes::CODE), ...);
  m.attr("SHAPES") = codes;
}

void bind_shapes(nb::module_& m) {
  bind_writes(m, shapes::All{});
  m.def(
      "shape_jet",
      [](Index kind, const Line& c, double x, double y) {
        const PlanarJet at = shapes::jet(kind, c.data, x, y);
        return std::tuple(at.h, at.gx, at.gy, at.distance, at.tx, at.ty);
      },
      "kind"_a, "c"_a, "x"_a, "y"_a,
      "Return H, ∇H (x, y), d and t (x, y) at a point of a shape's frame, where ∇²H = t tᵀ / d.");
  m.def(
      "shape_core",
      [](Index kind, const Line& c, double x, double y, double reach) {
        const Core core = shapes::core(kind, c.data, x, y, shapes::jet(kind, c.data, x, y), reach);
        return std::tuple(core.distance, core.radius, core.is_point);
      },
      "kind"_a, "c"_a, "x"_a, "y"_a, "reach"_a,
      "Return the distance from the core of a shape, its radius, and whether it is a point.");
  m.def(
      "shape_bounds",
      [](Index kind, const Line& c) {
        const Bounds box = shapes::bounds(kind, c.data);
        return std::tuple(box.low_x, box.low_y, box.high_x, box.high_y);
      },
      "kind"_a, "c"_a, "Return least x and y and greatest x and y of a region at time 0.");
}

void bind_values(nb::module_& m) {
  m.def("zone_value", &zone::value<double>, "limit"_a, "away"_a, "vx"_a, "vy"_a,
        "Return h of a speed zone at a distance from it and a velocity.");
  m.def("speed_limit_value", &speed_limit::value<double>, "v_max"_a, "vx"_a, "vy"_a, "Return h of a speed limit.");
  m.def("barrier_values", &shape_terms::values, "kind"_a, "parameters"_a, "atlas"_a.none(), "x"_a, "t"_a, "h"_a, Unlocked(),
      "Write h (N, m) of N states, in N scenes or all in one.");
  m.def("barrier_sense", &shape_terms::sense, "kind"_a, "parameters"_a, "atlas"_a.none(), "x"_a, "t"_a, "h"_a, "sensed"_a,
      Unlocked(), "Write h (N, m) and what a policy sees of each barrier, (N, m, 4): h, unit ∇h, ∂h/∂t.");
}

void bind_rows(nb::module_& m) {
  m.def("planar_rows", &rows::rows, "kind"_a, "parameters"_a, "margin"_a, "x"_a, "t"_a, "settings"_a, "a"_a,
      "out"_a, Unlocked(),
      "Write the rows of N states: a (N, m, 2), and (4, N, m) b, h, α₂(ψ) and ψ.");
  m.def(
      "held_row",
      [](double kept, double rate, double quickening, double speed, double sideways, double distance,
         const RowSettings& settings) {
        const auto row =
            rows::held_row(kept, rate, quickening, speed, sideways, distance, settings);
        return std::tuple(row.b, row.alpha2_psi, row.psi, row.lost);
      },
      "kept"_a, "rate"_a, "quickening"_a, "speed"_a, "sideways"_a, "distance"_a, "settings"_a,
      "Return b, α₂(ψ) and ψ of a row on the position for a held input, and how much less h gains than a·u.");
  m.def("row_late", &rows::late<double>, "kept"_a, "rate"_a, "lost"_a, "most"_a,
        "Return what a row requests where ψ < 0: to stop at h = m at a constant rate, if U can.");
  m.def("row_support", &rows::support<double>, "settings"_a, "ax"_a, "ay"_a,
      "Return the most that an input of U gives of a·u, −∞ where U is not known.");
  m.def("row_half_step", &rows::half_step, "settings"_a, "Return ½ ū T², the most that a held input moves h by.");
  m.def("row_reach", &rows::reach_of<double>, "speed"_a, "settings"_a, "Return how far the barrier's frame sees the robot get in one period.");
  m.def("row_beside_core", &rows::beside_core<double>, "radius"_a, "settings"_a, "Return what h keeps so that no held input reaches the core of a region.");
}

void bind_axle_rows(nb::module_& m) {
  m.def(
      "axle_row",
      [](const axle::Axle& axle, const Line& x, double heading, double period, double nx, double ny, double b) {
        const auto row = axle_rows::of_axle(axle, x.data, heading, period, nx, ny, b);
        return std::tuple(row.ax, row.ay, row.b);
      },
      "axle"_a, "x"_a, "heading"_a, "period"_a, "nx"_a, "ny"_a, "b"_a,
      "Return a (2,) and b of a row in the point's acceleration, of one on the axle's mean one.");
  m.def(
      "axle_point_row",
      [](const axle::Axle& axle, const Line& x, double heading, double period, double nx, double ny, double b) {
        const auto row = axle_rows::of_point(axle, x.data, heading, period, nx, ny, b);
        return std::tuple(row.ax, row.ay, row.b);
      },
      "axle"_a, "x"_a, "heading"_a, "period"_a, "nx"_a, "ny"_a, "b"_a,
      "Return a (2,) and b of a row on the point: its velocity turns with the heading besides.");
}

void bind_general_rows(nb::module_& m) {
  m.def(
      "general_rows",
      [](const Kinds& kind, const Stack& parameters, const Kinds& degree, const Stack& jets, const Table& x,
         const Line& t, const Table& f, const Stack& g, const Stack& jacobian, const Table& alphas,
         const WrittenStack& out) {
        const auto* alpha = reinterpret_cast<const class_k::ClassK*>(alphas.data);
        const general_rows::Scene scene{kind, parameters, degree};
        const general_rows::Terms terms{f, g, jacobian};
        return general_rows::write_rows(scene, jets, x, t, terms,
                                        alpha[0], alpha[1], alpha[2], out);
      },
      "kind"_a, "parameters"_a, "degree"_a, "jets"_a, "x"_a, "t"_a, "f"_a, "g"_a, "jacobian"_a, "alphas"_a,
      "out"_a, Unlocked(),
      "Write the rows (N, m, WIDTH + n_u) of N states, and return whether a ψ_1 of one is below zero.");
  m.def("function_rows", &general_rows::take_rows, "made"_a, "degrees"_a, "alpha2"_a, "out"_a,
      "Write rows of functions (N, m, WIDTH + n_u), and return whether a ψ_1 of one is below zero.");
  m.def(
      "recover_row",
      [](const Table& alphas, double most, const Written& row) {
        const auto* alpha = reinterpret_cast<const class_k::ClassK*>(alphas.data);
        general_rows::recover(alpha[0], alpha[1], most, row.data);
      },
      "alphas"_a, "most"_a, "row"_a,
      "Let a row (WIDTH + n_u,) of degree 2 with ψ_1 < 0 request a stop; an input of U gives `most` of a·u.");
}

// Where Python and C++ have the same numbers, as MODULE.NAME of `hcbf_gym.barriers`; the columns of shapes
// are compared block by block.
std::vector<std::pair<std::string, Index>> columns() {
  using namespace layout;
  using namespace general_rows;
  // clang-format off
  return {
      {"layout.SPEED_LIMIT", SPEED_LIMIT}, {"layout.CUSTOM", CUSTOM}, {"layout.MAPPED", MAPPED},
      {"layout.ZONES", ZONES}, {"layout.ZONE", ZONE}, {"layout.NONE", NONE},
      {"layout.LOWEST_RANK", LOWEST_RANK}, {"layout.VELOCITY_X", VELOCITY_X},
      {"layout.VELOCITY_Y", VELOCITY_Y}, {"layout.V_MAX", V_MAX}, {"layout.PIECES", PIECES},
      {"layout.KEPT", KEPT}, {"layout.AWAY", AWAY}, {"layout.AWAY_X", AWAY_X}, {"layout.AWAY_Y", AWAY_Y},
      {"layout.WIDTH", layout::WIDTH}, {"layout.ELSEWHERE", ELSEWHERE}, {"rows.B", B}, {"rows.H", H},
      {"rows.ALPHA2_PSI", ALPHA2_PSI}, {"rows.PSI", PSI}, {"rows.MARGIN", MARGIN}, {"rows.RATE", RATE},
      {"rows.QUICKENING", QUICKENING}, {"rows.USABLE", USABLE}, {"rows.REACH", REACH}, {"rows.FAST", FAST},
      {"rows.DIP", DIP}, {"rows.CONDITIONING", CONDITIONING}, {"rows.PLACED", PLACED},
      {"rows.WIDTH", general_rows::WIDTH},
      {"shapes.convex_polygon.MAX_VERTICES", ConvexPolygon::MAX_VERTICES},
      {"shapes.convex_polygon.USED", ConvexPolygon::USED}};
  // clang-format on
}

}  // namespace

void bind_barriers(nb::module_& m) {
  m.attr("ZONE_BRAKING") = zone::BRAKING;
  m.attr("VANISHED") = general_rows::VANISHED;
  bind_class_k(m);
  bind_shapes(m);
  bind_values(m);
  bind_rows(m);
  bind_axle_rows(m);
  bind_general_rows(m);
  m.def("barrier_columns", &columns,
        "Return the names in hcbf_gym.barriers of places in blocks, and their numbers.");
}

}  // namespace hcbf
