// Which region of a scene a region of the next scene was: of all of its kind that were `BESIDE` it, the
// nearest to the robot.
#pragma once
#include <cmath>
#include <vector>

#include <hcbf/layout.hpp>
#include <hcbf/shape_terms.hpp>
#include <hcbf/shapes.hpp>

namespace hcbf::nearness {

constexpr double BESIDE = 0.5;  // how near to its place a region without a name was [m]

struct Scenes {  // of N plants
  Matrix<const Index> kind;     // (N, m)
  Cube<const double> blocks;    // (N, m, WIDTH)
};

// The middle of a region at time t [m]; 0 of one without end.
inline shapes::Place place(Index kind, const double* c, double t) {
  const Bounds ends = shapes::bounds(kind, c);
  const double x = 0.5 * (ends.low_x + ends.high_x) + c[layout::VELOCITY_X] * t;
  const double y = 0.5 * (ends.low_y + ends.high_y) + c[layout::VELOCITY_Y] * t;
  if (!(std::isfinite(x) && std::isfinite(y))) return {0.0, 0.0};
  return {x, y};
}

// Writes which regions before explain those without a name of their own. `earlier` (N, k): h of the
// regions before, propagated [m]; `t` (N,) [s]; `found` (N, m): −1 where one is missing, written to.
inline void find_beside(const Scenes& before, const Scenes& now, Matrix<const double> earlier,
                        Vector<const double> t, Matrix<Index> found) {
  const Index count = before.kind.columns;
  std::vector<char> taken(count);
  std::vector<shapes::Place> places(count);
  for (Index i = 0; i < found.rows; ++i) {
    std::fill(taken.begin(), taken.end(), false);
    for (Index k = 0; k < found.columns; ++k)
      if (found(i, k) >= 0) taken[found(i, k)] = true;
    for (Index j = 0; j < count; ++j) places[j] = place(before.kind(i, j), before.blocks[i][j].data, t[i]);
    for (Index k = 0; k < found.columns; ++k) {
      const Index kind = now.kind(i, k);
      if (found(i, k) >= 0 || !shape_terms::is_region(kind)) continue;
      const auto [x, y] = place(kind, now.blocks[i][k].data, t[i]);
      double least = INFINITY;
      for (Index j = 0; j < count; ++j) {
        if (taken[j] || before.kind(i, j) != kind || earlier(i, j) >= least) continue;
        if (std::abs(places[j].x - x) <= BESIDE && std::abs(places[j].y - y) <= BESIDE)
          least = earlier(i, j), found(i, k) = j;
      }
    }
  }
}

}  // namespace hcbf::nearness
