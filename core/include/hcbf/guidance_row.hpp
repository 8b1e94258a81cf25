// The guidance row: keep moving down the field, as far as every safety row allows.
//
// With d the unit vector towards the point that is `look_ahead` further down the field, the row is
//
//     d u >= -k (d v - beta min(1, r / r0)),
//
// r the distance from the goal. Where it is satisfied, the speed along d does not fall below beta. It has
// the last rank of all, so that no safety row is relaxed for it.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/arrays.hpp>
#include <hcbf/field.hpp>

namespace hcbf::guidance_row {

using field::Geometry, field::Point;
using march::Rank;

constexpr double AHEAD = 2.0;  // cells along the last row from which a path is sought that goes on there

struct Pull {
  double gain;        // k [1/s]
  double speed;       // beta, the least speed along the path [m/s]
  double look_ahead;  // how far down the field the row aims [m]
  double ease;        // r0, the distance from the goal within which beta falls to zero [m]
};

// a u >= b.
struct Row {
  double a_x, a_y, b;
};

constexpr Row NOTHING{0.0, 0.0, -1.0};  // the row that requests nothing

// Returns whether a scene's field was computed: nothing else here checks an index.
inline bool has_field(Index capacity, const Geometry& geometry) {
  const Index ny = geometry.rows(), nx = geometry.columns();
  return ny >= 2 && nx >= 2 && ny * nx <= capacity;
}

// Returns where to aim where the path turns back: where the last row led, if that is as near.
//
// On the ridge between two ways round, a place decides which is the shorter by a hair, and a robot that is
// led to one and the other in turn is at rest. x: (4,); length: how far down the field the row aims [m];
// last: the row before; now: where it would aim now.
inline Point on_the_same_side(Matrix<const float> view, const Geometry& geometry, const double* goal,
                              const double* x, double length, const Row& last, Point now) {
  const double step = AHEAD * geometry.side;
  const Point aim = field::descent(view, geometry, goal, x[0] + step * last.a_x, x[1] + step * last.a_y,
                                   std::max(length - step, step));
  if (last.a_x * (aim.x - x[0]) + last.a_y * (aim.y - x[1]) <= 0.0) return now;
  const double there = field::interpolate(view, field::to_cells(aim.x, aim.y, geometry)).value;
  const double here = field::interpolate(view, field::to_cells(now.x, now.y, geometry)).value;
  return there <= here + step ? aim : now;
}

// Returns the row at one state x (4,).
//
// At the goal (2,), where the state is not finite, and where there is no field yet, it requests nothing.
// field: (capacity,) of one scene; last: the row before, zeros where there was none.
inline Row row(Vector<const float> field, const Geometry& geometry, const double* goal, const double* x,
               const Pull& pull, const Row& last) {
  const double px = x[0], py = x[1];
  if (!has_field(field.size, geometry) || !std::isfinite(px + py + x[2] + x[3])) return NOTHING;
  const auto view = field::grid(field, geometry);
  Point aim = field::descent(view, geometry, goal, px, py, pull.look_ahead);
  if (last.a_x * (aim.x - px) + last.a_y * (aim.y - py) < 0.0)
    aim = on_the_same_side(view, geometry, goal, x, pull.look_ahead, last, aim);
  double dx = aim.x - px, dy = aim.y - py;
  const double length = std::sqrt(dx * dx + dy * dy);
  if (length < 1e-6) return NOTHING;
  dx = dx / length, dy = dy / length;
  const double away_x = goal[0] - px, away_y = goal[1] - py;
  const double away = std::sqrt(away_x * away_x + away_y * away_y);
  const double speed = pull.speed * std::min(1.0, away / pull.ease);
  return {dx, dy, -pull.gain * (dx * x[2] + dy * x[3] - speed)};
}

// Returns what is at a point's cell in (capacity,) ranks, of paths or zones; 0 for none.
//
// There is none where no field was computed, or the point is not finite.
inline Index rank_at(Vector<const Rank> ranks, const Geometry& geometry, double x, double y) {
  if (!has_field(ranks.size, geometry) || !std::isfinite(x + y)) return 0;
  const auto [j, i] = field::cell_of(x, y, geometry);
  return ranks[j * geometry.columns() + i];
}

// Writes the ranks (m + 1,) of m rows and, as the last entry, of the guidance row; priority may be out's
// first part.
//
// The guidance row comes last of all. Where the goal can be reached only through a rank that the user lets
// it take, it comes right before the rows of that rank, which are then relaxed for it; so it does where
// the robot is in a zone of a map, as the nearest edge may be behind a wall.
//
// priority: (m,) of the safety rows, from 1 without a gap; reachable: through which rank the goal can be
// reached, see `march`; zone: the rank of the map's zone that the robot is in, above 1; 0 for none;
// through: the highest rank that is relaxed for guidance, above 1; 0 for none.
inline void insert(Vector<const Index> priority, Index reachable, Index zone, Index through,
                   Vector<Index> out) {
  const Index m = priority.size;
  Index lowest = 1;
  for (Index k = 0; k < m; ++k) lowest = std::max(lowest, priority[k]);
  Index place = zone > 1 ? zone : lowest + 1;
  if (through > 1 && reachable >= through) place = std::min(place, reachable);
  place = std::min(place, lowest + 1);
  out[m] = place;
  for (Index k = 0; k < m; ++k) out[k] = priority[k] >= place ? priority[k] + 1 : priority[k];
}

struct Input {
  double x, y;
};

// Returns the input nearest u* that satisfies the guidance row.
//
// This is guidance for programs with weights: they have no last rank, but whatever they guarantee holds
// for any u*, and so for this one.
inline Input shape(double ux, double uy, double ax, double ay, double b) {
  const double lack = b - ax * ux - ay * uy;
  if (lack <= 0.0) return {ux, uy};
  return {ux + lack * ax, uy + lack * ay};
}

}  // namespace hcbf::guidance_row
