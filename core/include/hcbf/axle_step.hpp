// What the filter does otherwise for a differential drive; see `axle_rows`.
//
// What is at rest binds the axle, what moves and users' own conditions the point before it. U is a
// rectangle along the heading. Where rows on what is at rest keep a robot from its nominal input, it
// requests what a robot that moves in every direction would do there: so it turns along a wall instead
// of stopping before it.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/axle.hpp>
#include <hcbf/axle_rows.hpp>
#include <hcbf/cascade.hpp>
#include <hcbf/margins.hpp>
#include <hcbf/plants.hpp>
#include <hcbf/polygon.hpp>
#include <hcbf/rows.hpp>
#include <hcbf/zone.hpp>

namespace hcbf::axle_step {

using plants::Constants, plants::One, plants::Plant, polygon::Point, plants::Work, program_records::Settings;

constexpr double FACING = -0.2;    // the cosine between heading and path below which guidance turns first
constexpr double TURNING = 2.0;    // gain with which it turns to its path where u* leads back from it [1/s]
constexpr double SOON = 0.1;       // and how soon [s]
constexpr double MOVED = 1e-9;  // a smaller change of an input is none, and the robot does not slide [m/s^2]
constexpr double ASIDE = 0.2;      // how hard a guided one turns off an edge that it slides along: parallel
                                   // to it, or not quite, it cannot drive yet, and would turn ever slower
constexpr double STEADY = 10.0;    // how much more a turn counts than a change of speed, backing from an edge

struct Turn {  // of a vector in the plane
  double cos, sin;
  explicit Turn(double angle) : cos(std::cos(angle)), sin(std::sin(angle)) {}
  Turn(double cos_, double sin_) : cos(cos_), sin(sin_) {}
  Turn back() const { return {cos, -sin}; }
  void operator()(double* pair) const {
    const double one = pair[0], other = pair[1];
    pair[0] = cos * one - sin * other, pair[1] = sin * one + cos * other;
  }
};

// Whether a condition binds the point: it moves, or is a user's own.
inline bool moves(Index kind, Vector<const double> parameters) {
  if (rows::is_on_speed(kind)) return false;
  const bool still = parameters[layout::VELOCITY_X] == 0.0 && parameters[layout::VELOCITY_Y] == 0.0;
  return kind == layout::CUSTOM || !still;
}

// What is known of the axle.
struct Placed {
  double x[4], model[4], lag[4];
};

inline Placed place(const Constants& c, const Plant& plant) {
  Placed at;
  double body[4];
  for (Index k = 0; k < 4; ++k) body[k] = plant.model[k] + plant.lag[k];
  axle::place(c.axle, plant.x, plant.heading, at.x);
  axle::place(c.axle, plant.model, plant.heading, at.model);
  axle::place(c.axle, body, plant.heading, at.lag);
  for (Index k = 0; k < 4; ++k) at.lag[k] -= at.model[k];
  return at;
}

inline margins::Known known_of(const Plant& plant, const double* x, const double* model, const double* lag) {
  return {x, plant.time, model, lag, {plant.covariance[0], 4, 4}, plant.growth};
}

// Returns b of a zone: braking alone changes the speed, turning the position besides. x: (4,) of the
// axle; settings: of rows, with the braking for u_max.
inline double zone_row(const axle::Axle& axle, Vector<const double> c, const Work& w, Index k,
                       const double* x, const RowSettings& settings) {
  const double later = std::hypot(x[2], x[3]) + axle.braking * settings.period;
  const double hardest = std::hypot(axle.braking, later * axle.turn);
  const double kept = w.rows(rows::H, k) - w.margin(margins::MARGIN, k);
  const double closing = c[layout::AWAY_X] * x[2] + c[layout::AWAY_Y] * x[3];
  return zone::row(kept, w.margin(margins::RATE, k), closing, x[2], x[3], c[layout::V_MAX], settings, hardest)
      .b;
}

// Writes a row on the point as one in u: its velocity turns with the heading besides.
inline void turn_row(const Constants& c, const One& p, Work& w, Index k) {
  double *n = &w.a(k, 0), &b = w.rows(rows::B, k);
  w.straight(k, 0) = n[0], w.straight(k, 1) = n[1], w.straight(k, 2) = b;
  const auto row = axle_rows::of_point(c.axle, p.plant.x, p.plant.heading, c.period, n[0], n[1], b);
  n[0] = row.ax, n[1] = row.ay, b = row.b;
}

// Writes margins and rows of what moves, which bind the point.
inline void make_rows_of_point(const Constants& c, const One& p, Work& w) {
  const auto binds = [&p](Index k) {
    return moves(p.kind[k], p.parameters[k]) && p.kind[k] != layout::CUSTOM;
  };
  const Index m = p.kind.size;
  bool some = false;
  for (Index k = 0; k < m; ++k) some |= binds(k);
  if (!some) return;
  const Plant& plant = p.plant;
  margins::derive(c.uncertainty, p.kind, p.parameters, known_of(plant, plant.x, plant.model, plant.lag),
                  c.period, w.other_margin);
  for (Index k = 0; k < m; ++k) w.other_margin(margins::MARGIN, k) += p.own_margin[k] + c.axle.look_ahead;
  rows::of_state(p.kind, p.parameters, w.other_margin, plant.x, plant.time, c.rows, w.other_a, w.other_rows);
  for (Index k = 0; k < m; ++k) {
    if (!binds(k)) continue;
    for (Index q = 0; q < 4; ++q) w.margin(q, k) = w.other_margin(q, k), w.rows(q, k) = w.other_rows(q, k);
    w.a(k, 0) = w.other_a(k, 0), w.a(k, 1) = w.other_a(k, 1);
    turn_row(c, p, w, k);
  }
}

// Writes margins, rows and U of one plant; those of users' own conditions are made later.
inline void make_rows(const Constants& c, const One& p, Work& w) {
  const Plant& plant = p.plant;
  const Placed at = place(c, plant);
  margins::derive(c.uncertainty, p.kind, p.parameters, known_of(plant, at.x, at.model, at.lag), c.period,
                  w.margin);
  for (Index k = 0; k < p.kind.size; ++k) {
    w.margin(margins::QUICKENING, k) += c.jerk;
    w.margin(margins::MARGIN, k) += p.own_margin[k];
  }
  RowSettings settings = c.axle_rows;
  axle_rows::limit_axle(c.axle, plant.x, plant.heading, settings);
  rows::of_state(p.kind, p.parameters, w.margin, at.x, plant.time, settings, w.a, w.rows);
  settings.u_max = c.axle.braking;  // of the speed: what turns it changes no speed
  for (Index k = 0; k < p.kind.size; ++k) {
    const Vector<const double> block = p.parameters[k];
    double &n_x = w.a(k, 0), &n_y = w.a(k, 1), &b = w.rows(rows::B, k);
    if (p.kind[k] == layout::SPEED_LIMIT) {
      const double kept = w.rows(rows::H, k) - w.margin(margins::MARGIN, k);
      b = rows::speed_row(kept, w.margin(margins::RATE, k), at.x[2], at.x[3], block[layout::V_MAX],
                          settings).b;
    }
    if (p.kind[k] == layout::ZONE) b = zone_row(c.axle, block, w, k, at.x, settings);
    w.straight(k, 0) = n_x, w.straight(k, 1) = n_y, w.straight(k, 2) = b;
    if (rows::is_on_speed(p.kind[k])) continue;  // n is along the heading, and e·u alone changes the speed
    const auto row = axle_rows::of_axle(c.axle, plant.x, plant.heading, c.period, n_x, n_y, b);
    n_x = row.ax, n_y = row.ay, b = row.b;
  }
  make_rows_of_point(c, p, w);
}

// Lets a plant that is not valid go on turning, as its model goes on.
inline void carry_on(const axle::Axle& axle, Plant& plant) {
  plant.heading = plant.headed;
  if (!plant.known || !(plant.elapsed > 0.0)) return;
  const double turned = axle::speeds(axle, plant.x, plant.headed).turning * plant.elapsed;
  plant.heading += turned;
  const Turn turn(turned);
  turn(plant.x + 2), turn(plant.model + 2), turn(plant.accepted + 2);
}

// Turns what was expected of the point's velocity with the heading since the last sample: commands are
// held in the robot's own axes. `input`: (2,) behind the plant.
inline void turn_memory(Plant& plant, double* input) {
  const Turn turn(plant.heading - plant.headed);
  turn(plant.expected), turn(input);
  plant.headed = plant.heading;
}

// Writes the corners (4, 2) of the U that a plant has at its heading, and returns them as a program reads them.
inline Cube<const double> corners(const Constants& c, const One& p, double* out) {
  axle::corners(c.axle, p.plant.x, p.plant.heading, c.period, out);
  return {out, 1, 4, 2};
}

// Lets what is at rest come before what moves in rank 1: where both cannot be, the robot stays out. A
// robot that a region runs into has not entered it.
inline void split_ranks(const One& p, Work& w) {
  for (Index k = 0; k < w.priority.size; ++k) {
    bool later = w.priority[k] > 1;
    if (k < p.kind.size && p.priority[k] == 1) later = moves(p.kind[k], p.parameters[k]);
    w.priority[k] += later;
  }
}

// Whether a condition is on the place, by a unit normal; an own one may be anything.
inline bool is_edge(Index kind) { return !rows::is_on_speed(kind) && kind != layout::CUSTOM; }

// Answers once more where rows changed u, with what a robot free to move would do for u*. One that is
// guided turns off a single edge besides, and turns to a path that lies behind it. One that backs from
// it turns as it would: a row has the turn times v, so that the turn was given away, to and fro, for a
// hair of speed. `settings`: of the program, with the plant's U; the answer is written to.
inline void slide(const Constants& c, Settings settings, const One& p, Work& w) {
  const Index m = p.kind.size, total = w.priority.size;
  const double heading = p.plant.heading;
  const Vector<double> u = w.answer.u;
  const Point first = polygon::nearest(polygon::points(settings.vertices[0]), {w.u[0], w.u[1]});
  if (std::abs(u[0] - first.x) + std::abs(u[1] - first.y) <= MOVED) return;
  const double far = 4.0 * settings.radius + 2.0 * std::max(std::abs(w.u[0]), std::abs(w.u[1]));
  const double square[8] = {-far, -far, far, -far, far, far, -far, far};
  double corners[8], asked[2] = {w.u[0], w.u[1]};
  const Matrix<double> a = w.other_a;
  const Vector<double> b = w.other_rows[rows::B];
  const auto take_rows = [&](Index from) {
    for (Index k = from; k < total; ++k) a(k, 0) = w.a(k, 0), a(k, 1) = w.a(k, 1), b[k] = w.rows(rows::B, k);
  };
  for (Index k = 0; k < m; ++k)
    a(k, 0) = w.straight(k, 0), a(k, 1) = w.straight(k, 1), b[k] = w.straight(k, 2);
  take_rows(m);
  const auto answer = [&](const double* vertices) {
    settings.vertices = {vertices, 1, 4, 2};
    w.answer.status = cascade::filter_state<double>(
        settings, polygon::points(settings.vertices[0]), settings.weights[0], {asked[0], asked[1]},
        {a, b, w.rows[rows::H], w.priority, w.rows[rows::ALPHA2_PSI]}, u, w.answer.slack, w.answer.delta,
        w.polygons);
  };
  std::copy(settings.vertices.data, settings.vertices.data + 8, corners);
  answer(square);
  asked[0] = u[0], asked[1] = u[1];
  bool held = false;
  Index edges = 0, edge = 0;
  for (Index k = 0; k < m; ++k)
    if (a(k, 0) * asked[0] + a(k, 1) * asked[1] - b[k] <= MOVED) {
      held = true;
      if (is_edge(p.kind[k])) ++edges, edge = k;
    }
  if (edges == 1 && m < total) {  // between two it would turn from both
    asked[0] += ASIDE * a(edge, 0);
    asked[1] += ASIDE * a(edge, 1);
  }
  take_rows(0);
  const Turn turn(heading);
  const bool backs = edges == 1 && axle::speeds(c.axle, p.plant.x, heading).forward < 0.0;
  if (backs) {  // the request has what guidance may have
    for (Index k = m; k < total; ++k) a(k, 0) = a(k, 1) = 0.0, b[k] = -1.0;
  } else if (held) {  // guidance drives ahead, and turns along what is at rest and not back to its path
    for (Index k = m; k < total; ++k) {
      double ahead = turn.cos * a(k, 0) + turn.sin * a(k, 1);
      const double aside = turn.cos * a(k, 1) - turn.sin * a(k, 0);
      b[k] -= aside * (turn.cos * asked[1] - turn.sin * asked[0]);
      ahead = std::max(0.0, ahead);  // backing to a path behind it, it would turn from it, too
      a(k, 0) = ahead * turn.cos, a(k, 1) = ahead * turn.sin;
    }
  }
  const auto to_axes = [&turn](double* pair, double share) { turn.back()(pair), pair[1] *= share; };
  if (backs) {
    for (Index k = 0; k < total; ++k) to_axes(&a(k, 0), 1.0 / STEADY);
    to_axes(asked, STEADY);
    for (Index k = 0; k < 4; ++k) to_axes(corners + 2 * k, STEADY);
  }
  answer(corners);
  if (backs) {
    u[1] /= STEADY;
    turn(u.data);
  }
}

// Lets guidance turn robots that face away from their path, by the point before the axle. Where u* leads
// back from the path, it would turn the robot from there, too, as far as the row of guidance can be met
// by going on ahead: to and fro, for ever. There guidance alone turns it. `plant.way`, the row (a, b) of
// guidance, is written to; `u`: (2,) u* [m/s^2]; `gain`: k of that row [1/s]; `ahead`: l of the axle [m].
inline void face(Plant& plant, const double* u, double gain, double ahead) {
  double* way = plant.way;
  const double cos = std::cos(plant.heading), sin = std::sin(plant.heading);
  const double along = cos * way[0] + sin * way[1], across = cos * way[1] - sin * way[0];
  plant.turns = way[0] * u[0] + way[1] * u[1] < std::min(way[2], 0.0);
  if (plant.turns) {
    const double turning = cos * plant.x[3] - sin * plant.x[2];
    plant.turn = (TURNING * ahead * std::atan2(across, along) - turning) / SOON;
  }
  if (!(along < FACING)) return;
  const double speed = way[2] / gain + way[0] * plant.x[2] + way[1] * plant.x[3];
  const double side = across >= 0.0 ? 1.0 : -1.0;
  way[0] = -side * sin, way[1] = side * cos;
  way[2] = gain * (speed - way[0] * plant.x[2] - way[1] * plant.x[3]);
}

// Lets u (2,) turn a plant to its path where u* leads back from there.
inline void turn_to_way(const Plant& plant, double* u) {
  if (!plant.turns) return;
  const Turn turn(plant.heading);
  const double ahead = turn.cos * u[0] + turn.sin * u[1];
  u[0] = ahead * turn.cos - plant.turn * turn.sin, u[1] = ahead * turn.sin + plant.turn * turn.cos;
}

// Whether h of a condition is that of the point, not of the axle: then it is no less than h less l.
inline double of_body(const Constants& c, const One& p, const Work& w, Index k) {
  const double h = w.rows(rows::H, k);
  return w.strict[k] && moves(p.kind[k], p.parameters[k]) ? h - c.axle.look_ahead : h;
}

}  // namespace hcbf::axle_step
