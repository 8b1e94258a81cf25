// Classes of a map as barriers, and the pieces that get a row at one state.
//
// A class is one condition, h its least over all pieces. A filter makes one row for each piece within the
// braking horizon. docs/rows.md proves that pieces beyond it need none: whatever input of U is held for a
// period, h ≥ m and ψ ≥ 0 at its end.
#pragma once
#include <algorithm>
#include <cmath>
#include <vector>

#include <hcbf/arrays.hpp>
#include <hcbf/class_k.hpp>
#include <hcbf/shapes.hpp>
#include <hcbf/layout.hpp>
#include <hcbf/margins.hpp>
#include <hcbf/pieces.hpp>
#include <hcbf/shape_terms.hpp>
#include <hcbf/zone.hpp>

namespace hcbf::mapped {

constexpr double LONGEST_HOLD = 0.2;  // within which rows of no known period look ahead [s]: none is longer

// m conditions of one plant, with classes of maps or with their nearby pieces.
struct Scene {
  Vector<const Index> kind;         // (m,) as `layout` has it
  Matrix<const double> parameters;  // (m, WIDTH)
  Vector<const Index> priority;     // (m,)
  Vector<const double> own_margin;  // (m,) its own margin
  Vector<const Index> source;       // (m,) to which condition of the whole scene each belongs
};

// Room for the conditions of one state, which a next state uses again.
struct Nearby {
  std::vector<Index> kind, priority, source;
  std::vector<double> parameters, own_margin;

  void clear() {
    kind.clear(), priority.clear(), source.clear();
    parameters.clear(), own_margin.clear();
  }

  // Adds the condition k of a scene as one of another kind, and returns its block (WIDTH,), to be written.
  double* add(const Scene& scene, Index k, Index as) {
    kind.push_back(as), priority.push_back(scene.priority[k]), source.push_back(k);
    own_margin.push_back(scene.own_margin[k]);
    parameters.resize(parameters.size() + layout::WIDTH);
    return parameters.data() + parameters.size() - layout::WIDTH;
  }

  Scene scene() const {
    const Index m = static_cast<Index>(kind.size());
    return {{kind.data(), m},
            {parameters.data(), m, layout::WIDTH},
            {priority.data(), m},
            {own_margin.data(), m},
            {source.data(), m}};
  }
};

// The common part of the braking horizons of all classes of a map.
struct Horizon {
  double base;      // how far a row's margin and one period lead [m]
  double stopping;  // from which distance α₁ lets the robot approach as fast as it may by then [m]
  double later;     // its speed then [m/s]
  double over;      // what a speed limit reserves [m/s]

  // The braking horizon of condition k [m].
  double reach(const Scene& scene, Index k) const {
    if (scene.kind[k] == layout::MAPPED) return base + (stopping + scene.own_margin[k]);
    const double limit = scene.parameters(k, layout::V_MAX), kept = over + scene.own_margin[k];
    return base + (scene.parameters(k, layout::KEPT) + zone::reach(limit, kept, later));
  }
};

// `most`: the most that a row on the position reserves [m]; for the others see `nearby`.
inline Horizon horizon(const Uncertainty& settings, const RowSettings& rows, double radius,
                       const margins::Known& known, double most) {
  const double* x = known.x;
  const double fastest = margins::fastest_drift(settings, known.covariance, known.growth);
  const double over = margins::of_speed(settings, known.lag, known.covariance);
  const bool held = rows.held != 0.0;
  const double period = held ? rows.period : LONGEST_HOLD, u_max = held ? rows.u_max : radius;
  const double speed = std::sqrt(x[2] * x[2] + x[3] * x[3]), later = speed + u_max * period;
  const double passed = (speed + fastest) * period + u_max * period * period;  // with a corner's rounding
  const double stopping = class_k::inverse(rows.alpha1, later + fastest);
  return {most + passed, stopping, later, over};
}

// Writes the block (WIDTH,) of one zone: its limit, the distance to it less `kept`, and its gradient.
inline void see_zone(const double* piece, const double* x, double limit, double kept, double* block) {
  const auto jet = ConvexPolygon::jet(piece, x[0], x[1]);
  std::fill_n(block, layout::WIDTH, 0.0);
  block[layout::V_MAX] = limit;
  if (jet.h > kept) {
    block[layout::AWAY] = jet.h - kept;
    block[layout::AWAY_X] = jet.gx, block[layout::AWAY_Y] = jet.gy;
  }
}

// Writes the conditions of a state, classes of a map replaced by their nearby pieces. `settings`: of
// the margins; `rows`: of the rows; `radius`: the largest norm of an input [m/s²]; `scene`: the
// conditions, whose `source` is not read; `atlas`: where the pieces are.
inline void nearby(const Uncertainty& settings, const RowSettings& rows, double radius, const Scene& scene,
                   Vector<const double> atlas, const margins::Known& known, Nearby& out) {
  const double most = margins::most(settings, known), *x = known.x;
  const Horizon ahead = horizon(settings, rows, radius, known, most);
  out.clear();
  for (Index k = 0; k < scene.kind.size; ++k) {
    const double* c = scene.parameters[k].data;
    if (!shape_terms::is_mapped(scene.kind[k])) {
      std::copy_n(c, layout::WIDTH, out.add(scene, k, scene.kind[k]));
      continue;
    }
    const bool region = scene.kind[k] == layout::MAPPED;
    const auto take = [&](Index piece) {
      double* block = out.add(scene, k, region ? ConvexPolygon::CODE : layout::ZONE);
      if (region) {
        std::copy_n(&atlas[piece], layout::WIDTH, block);
      } else {
        see_zone(&atlas[piece], x, c[layout::V_MAX], c[layout::KEPT] + most, block);
      }
    };
    pieces::visit_near(atlas, static_cast<Index>(c[layout::PIECES]), x[0], x[1], ahead.reach(scene, k), take);
  }
}

// The least h of a class of a map over states `path` (k, 4) close to one another; `distance` (k,) is room.
inline double least_along(Index kind, const double* c, Vector<const double> atlas, Matrix<const double> path,
                          Vector<double> distance) {
  pieces::along(atlas, static_cast<Index>(c[layout::PIECES]), path, distance);
  double least = INFINITY;
  for (Index s = 0; s < path.rows; ++s)
    least = std::min(least, shape_terms::of_map(kind, c, distance[s], path(s, 2), path(s, 3)));
  return least;
}

}  // namespace hcbf::mapped
