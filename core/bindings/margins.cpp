// What rows reserve, and the pieces of maps.
#include "structs.hpp"

#include <hcbf/mapped.hpp>
#include <hcbf/margins.hpp>
#include <hcbf/pieces.hpp>

namespace hcbf {
namespace {

using Line = Vector<const double>;
using Table = Matrix<const double>;
using Stack = Cube<const double>;

void reserved(const Uncertainty& settings, const Matrix<const Index>& kind, const Stack& parameters,
              const Table& x, const Line& t, const Table& model, const Table& lag, const Stack& covariance,
              const Line& growth, double period, const Cube<double>& out) {
  const Index m = out.columns, all = out.rows * m;
  for (Index i = 0; i < x.rows; ++i)
    margins::derive(settings, kind[i], parameters[i],
                    {x[i].data, t[i], model[i].data, lag[i].data, covariance[i], growth[i]}, period,
                    {out.data + i * m, 4, all});
}

auto nearby(const Uncertainty& settings, const RowSettings& rows, double radius, const Vector<const Index>& kind,
            const Table& parameters, const Vector<const Index>& priority, const Line& own_margin,
            const Line& atlas, const Line& x, const Line& model, const Line& lag, const Table& covariance,
            double growth) {
  const mapped::Scene scene{kind, parameters, priority, own_margin, kind};
  const margins::Known known{x.data, 0.0, model.data, lag.data, covariance, growth};
  mapped::Nearby found;
  mapped::nearby(settings, rows, radius, scene, atlas, known, found);
  const std::size_t m = found.kind.size(), width = layout::WIDTH;
  return std::tuple(owned<Index>(std::move(found.kind), {m}),
                    owned<double>(std::move(found.parameters), {m, width}),
                    owned<Index>(std::move(found.priority), {m}),
                    owned<double>(std::move(found.own_margin), {m}),
                    owned<Index>(std::move(found.source), {m}));
}

auto packed(const Table& blocks, double x, double y, double yaw, Index inner) {
  std::vector<double> numbers = pieces::packed(blocks, x, y, yaw, inner);
  const std::size_t size = numbers.size();
  return owned<double>(std::move(numbers), {size});
}

// Writes h and its gradient (k, 3) at a point of the pieces with the given blocks.
void jets(const Line& atlas, const Vector<const Index>& blocks, double x, double y,
          const Matrix<double>& out) {
  for (Index k = 0; k < blocks.size; ++k) {
    const PlanarJet jet = ConvexPolygon::jet(&atlas[blocks[k]], x, y);
    double* to = out[k].data;
    to[0] = jet.h, to[1] = jet.gx, to[2] = jet.gy;
  }
}

}  // namespace

void bind_margins(nb::module_& m) {
  m.def("margins_reserved", &reserved, "settings"_a, "kind"_a, "parameters"_a, "x"_a, "t"_a, "model"_a,
        "lag"_a, "covariance"_a, "growth"_a, "period"_a, "out"_a, Unlocked(),
        "Write m, ṁ, m̈ and usable (4, N, m) of the rows of N planar double integrators.");
  m.def("margin_of_deviation", &margins::reserved, "settings"_a, "deviation"_a,
        "Return what is reserved for a standard deviation.");
  m.def("map_nearby", &nearby, "settings"_a, "rows"_a, "radius"_a, "kind"_a, "parameters"_a, "priority"_a,
        "own_margin"_a, "atlas"_a, "x"_a, "model"_a, "lag"_a, "covariance"_a, "growth"_a,
        "Return kind, parameters, priority, own margin and source of the conditions near a state.");
  m.def("pieces_packed", &packed, "blocks"_a, "x"_a, "y"_a, "yaw"_a, "inner"_a,
        "Return the numbers (L,) of polygons with the blocks (P, WIDTH), the first `inner` in buckets.");
  m.def(
      "pieces_nearest",
      [](const Line& atlas, Index at, double x, double y) {
        const pieces::Nearest found = pieces::nearest(atlas, at, x, y);
        return std::pair(found.distance, found.block);
      },
      "atlas"_a, "at"_a, "x"_a, "y"_a,
      "Return the signed distance from the nearest piece [m] and where its block begins, −1 for none.");
  m.def("pieces_near", &pieces::near, "atlas"_a, "at"_a, "x"_a, "y"_a, "reach"_a, "found"_a,
      "Write the blocks of the pieces no farther than `reach` [m], and return how many there are.");
  m.def(
      "pieces_jet",
      [](const Line& atlas, Index at, double x, double y) {
        const pieces::Slope there = pieces::jet(atlas, at, x, y);
        return std::tuple(there.h, there.gx, there.gy);
      },
      "atlas"_a, "at"_a, "x"_a, "y"_a,
      "Return the signed distance from the nearest piece [m] and its gradient.");
  m.def("pieces_jets", &jets, "atlas"_a, "blocks"_a, "x"_a, "y"_a, "out"_a,
        "Write the signed distances from the pieces with the given blocks [m] and their gradients (k, 3).");
  m.def("pieces_distances", &pieces::distances, "atlas"_a, "at"_a, "points"_a, "out"_a, Unlocked(),
      "Write the signed distances (N,) of points (N, 2) from the nearest piece [m].");
}

}  // namespace hcbf
