#include <hcbf/cover.hpp>
#include <hcbf/surfaces.hpp>

#include "bindings.hpp"

namespace hcbf {

namespace {

using Cells = Matrix<const bool>;
using Corners = std::tuple<Index, Index, Index, Index>;

void bind_cover(nb::module_& m) {
  m.def("cover_cells", [](const Cells& cells, const Corners& window, const Matrix<cover::Number>& owner,
                          Index first) {
    const auto [r0, c0, r1, c1] = window;
    cover::Pieces pieces;
    {
      const nb::gil_scoped_release unlocked;
      pieces = cover::cover(cells, {r0, c0, r1, c1}, owner, first);
    }
    const std::size_t count = pieces.count.size();
    return std::pair(owned<Index>(std::move(pieces.corners), {count, cover::MOST_CORNERS, 2}),
                     owned<Index>(std::move(pieces.count), {count}));
  }, "cells"_a, "window"_a, "owner"_a, "first"_a,
  "Cover the true cells of a window that no piece owns; return corners (P, 8, 2) and sizes (P,).");

  m.def("cover_boxes", [](const Cells& cells) {
    const auto all = cells;
    std::vector<std::array<cover::Crossing, 4>> corners;
    {
      const nb::gil_scoped_release unlocked;
      std::vector<cover::Number> owner(all.rows * all.columns, -1);
      const cover::Window whole{0, 0, all.rows, all.columns};
      for (const auto& box : cover::rectangles(all, whole, {owner.data(), all.rows, all.columns}, 0))
        corners.push_back(box.corners());
    }
    const std::size_t count = corners.size();
    return owned<Index>(std::move(corners), {count, 4, 2});
  }, "cells"_a, "Return the corners (R, 4, 2) of rectangles that are just the true cells.");

  m.def("cover_grow", &cover::grow, "corners"_a, "sizes"_a, "Move the corners (P, 8, 2) of pieces outwards.", Unlocked());
}

void bind_surfaces(nb::module_& m) {
  m.attr("SURFACE_CLOSE") = surfaces::CLOSE;
  m.attr("SURFACE_EDGE") = surfaces::EDGE;
  m.def("surface_pieces", [](const Matrix<const double>& points, double tolerance, double depth) {
    const auto* first = reinterpret_cast<const surfaces::Point*>(points.data);
    const Vector<const surfaces::Point> all{first, points.rows};
    std::vector<surfaces::Piece> pieces;
    {
      const nb::gil_scoped_release unlocked;
      pieces = surfaces::pieces(all, tolerance, depth);
    }
    const std::size_t count = pieces.size();
    return owned<double>(std::move(pieces), {count, 4, 2});
  }, "points"_a, "tolerance"_a, "depth"_a,
  "Return rectangles (P, 4, 2) along the surfaces that points show.");
}

}  // namespace

void bind_maps(nb::module_& m) {
  bind_cover(m);
  bind_surfaces(m);
}

}  // namespace hcbf
