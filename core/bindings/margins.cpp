// What rows reserve, and the pieces of maps.
#include "bindings.hpp"

#include <hcbf/mapped.hpp>
#include <hcbf/margins.hpp>
#include <hcbf/pieces.hpp>

namespace hcbf {
namespace {

using Line = Numbers<const double, 1>;
using Table = Numbers<const double, 2>;
using Stack = Numbers<const double, 3>;

// `models.plant.Uncertainty` and `RowSettings.packed`, each as an array of its numbers.
const Uncertainty& uncertainty(const Line& numbers) {
  return *reinterpret_cast<const Uncertainty*>(numbers.data());
}
const RowSettings& row_settings_of(const Line& numbers) {
  return *reinterpret_cast<const RowSettings*>(numbers.data());
}

void reserved(const Line& settings, const Numbers<const Index, 2>& kind, const Stack& parameters,
              const Table& x, const Line& t, const Table& model, const Table& lag, const Stack& covariance,
              const Line& growth, double period, const Numbers<double, 3>& out) {
  const auto at = [](const Table& states, Index i) { return view(states)[i].data; };
  for (Index i = 0; i < view(x).rows; ++i) {
    const margins::Known known{at(x, i),   t.data()[i],         at(model, i),
                               at(lag, i), view(covariance)[i], growth.data()[i]};
    margins::derive(uncertainty(settings), view(kind)[i], view(parameters)[i], known, period,
                    margins::reserved(view(out), i));
  }
}

auto nearby(const Line& settings, const Line& rows, double radius, const Numbers<const Index, 1>& kind,
            const Table& parameters, const Numbers<const Index, 1>& priority, const Line& own_margin,
            const Line& atlas, const Line& x, const Line& model, const Line& lag, const Table& covariance,
            double growth) {
  const mapped::Scene scene{view(kind), view(parameters), view(priority), view(own_margin), view(kind)};
  const margins::Known known{x.data(), 0.0, model.data(), lag.data(), view(covariance), growth};
  mapped::Nearby found;
  mapped::nearby(uncertainty(settings), row_settings_of(rows), radius, scene, view(atlas), known, found);
  const std::size_t m = found.kind.size(), width = layout::WIDTH;
  return std::tuple(owned<Index>(std::move(found.kind), {m}),
                    owned<double>(std::move(found.parameters), {m, width}),
                    owned<Index>(std::move(found.priority), {m}),
                    owned<double>(std::move(found.own_margin), {m}),
                    owned<Index>(std::move(found.source), {m}));
}

auto packed(const Table& blocks, double x, double y, double yaw, Index inner) {
  std::vector<double> numbers = pieces::packed(view(blocks), x, y, yaw, inner);
  const std::size_t size = numbers.size();
  return owned<double>(std::move(numbers), {size});
}

// Writes h and its gradient (k, 3) at a point of the pieces with the given blocks.
void jets(const Line& atlas, const Numbers<const Index, 1>& blocks, double x, double y,
          const Numbers<double, 2>& out) {
  for (Index k = 0; k < view(blocks).size; ++k) {
    const PlanarJet jet = convex_polygon::jet(&view(atlas)[view(blocks)[k]], x, y);
    double* to = view(out)[k].data;
    to[0] = jet.h, to[1] = jet.gx, to[2] = jet.gy;
  }
}

}  // namespace

void bind_margins(nb::module_& m) {
  m.def("margins_reserved", &reserved, "settings"_a, "kind"_a, "parameters"_a, "x"_a, "t"_a, "model"_a,
        "lag"_a, "covariance"_a, "growth"_a, "period"_a, nb::arg("out").noconvert(), Unlocked(),
        "Write m, ṁ, m̈ and leaning (4, N, m) of the rows of N planar double integrators.");
  m.def("map_nearby", &nearby, "settings"_a, "rows"_a, "radius"_a, "kind"_a, "parameters"_a, "priority"_a,
        "own_margin"_a, "atlas"_a, "x"_a, "model"_a, "lag"_a, "covariance"_a, "growth"_a,
        "Return kind, parameters, priority, own margin and source of the conditions near a state.");
  m.def("pieces_packed", &packed, "blocks"_a, "x"_a, "y"_a, "yaw"_a, "inner"_a,
        "Return the numbers (L,) of polygons with the blocks (P, WIDTH), the first `inner` in buckets.");
  m.def(
      "pieces_nearest",
      [](const Line& atlas, Index at, double x, double y) {
        const pieces::Nearest found = pieces::nearest(view(atlas), at, x, y);
        return std::pair(found.distance, found.block);
      },
      "atlas"_a, "at"_a, "x"_a, "y"_a,
      "Return the signed distance from the nearest piece [m] and where its block begins, −1 for none.");
  m.def(
      "pieces_near",
      [](const Line& atlas, Index at, double x, double y, double reach, const Numbers<Index, 1>& found) {
        return pieces::near(view(atlas), at, x, y, reach, view(found));
      },
      "atlas"_a, "at"_a, "x"_a, "y"_a, "reach"_a, nb::arg("found").noconvert(),
      "Write the blocks of the pieces no farther than `reach` [m], and return how many there are.");
  m.def(
      "pieces_jet",
      [](const Line& atlas, Index at, double x, double y) {
        const pieces::Slope there = pieces::jet(view(atlas), at, x, y);
        return std::tuple(there.h, there.gx, there.gy);
      },
      "atlas"_a, "at"_a, "x"_a, "y"_a,
      "Return the signed distance from the nearest piece [m] and its gradient.");
  m.def("pieces_jets", &jets, "atlas"_a, "blocks"_a, "x"_a, "y"_a, nb::arg("out").noconvert(),
        "Write the signed distances from the pieces with the given blocks [m] and their gradients (k, 3).");
  m.def(
      "pieces_distances",
      [](const Line& atlas, Index at, const Table& points, const Numbers<double, 1>& out) {
        pieces::distances(view(atlas), at, view(points), view(out));
      },
      "atlas"_a, "at"_a, "points"_a, nb::arg("out").noconvert(), Unlocked(),
      "Write the signed distances (N,) of points (N, 2) from the nearest piece [m].");
}

}  // namespace hcbf
