// From u* to u, in five stages: sample, rows, guidance, program, report. A plant whose state is not valid brakes
// at once: no row is made and no program asked.
//
// Of planar double integrators all of it is made here. Of other models rows, alarms and braking inputs were made
// beforehand, and the states checked.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <hcbf/axle_step.hpp>
#include <hcbf/cascade.hpp>
#include <hcbf/conclusion.hpp>
#include <hcbf/constants.hpp>
#include <hcbf/gatekeeper.hpp>
#include <hcbf/general_rows.hpp>
#include <hcbf/guidance_row.hpp>
#include <hcbf/map_rows.hpp>
#include <hcbf/monitor.hpp>
#include <hcbf/plants.hpp>
#include <hcbf/rows.hpp>
#include <hcbf/state_check.hpp>

namespace hcbf::step {

using plants::Constants, plants::One, plants::Plants, plants::Work, polygon::Point, program_records::Settings;
using constants::ASKING, constants::STANDING;
using rows::ALPHA2_PSI, rows::B, rows::H, rows::PSI;

// What a call returns: nothing to do, u* is not finite, a scene is not of these plants, a warning is due.
enum Answer : Index { DONE, NOT_FINITE, MISSHAPED, ASKS };

// What one plant's step needs besides; it is kept, and used again for the next one.
struct Room {
  Work work;
  map_rows::Pieces map;
  manoeuvres::Own laws{};  // the user's manoeuvres
};

// Returns what is wrong with the arrays, `DONE` for nothing; nothing is written. Scenes are to be of as many
// plants and rows as there is room for, in sound ranks: nothing else here checks an index.
inline Answer check(const Constants& c, const Plants& p) {
  const Index count = p.kind.rows, m = p.kind.columns;
  for (Index i = 0; i < p.reports.size; ++i)
    if (!are_finite({p.reports.tail(i), p.n_u})) return NOT_FINITE;
  if (p.sensed.size != count || p.reports.size != count || p.rows.rows != count) return MISSHAPED;
  if (p.rows.columns < m + (c.guided && c.has_way)) return MISSHAPED;
  if (p.own.layers > 0 && (p.own.layers != count || p.own.rows != m)) return MISSHAPED;
  if (p.parameters.layers != count || p.parameters.rows != m || p.parameters.columns != layout::WIDTH)
    return MISSHAPED;
  if (p.priority.rows != count || p.priority.columns != m) return MISSHAPED;
  if (p.own_margin.rows != count || p.own_margin.columns != m) return MISSHAPED;
  if (p.ends.rows > 0 && (p.ends.rows != count || p.ends.columns != m)) return MISSHAPED;
  for (Index k = 0; k < count * m; ++k) {
    const Index rank = p.priority.data[k];
    const bool is_none = p.kind.data[k] == layout::NONE;
    if (is_none ? rank != 0 : rank < 1 || rank > layout::LOWEST_RANK) return MISSHAPED;
  }
  return DONE;
}

// Returns plant i of N.
inline One plant_of(const Plants& p, Index i) {
  double *behind = p.sensed.tail(i), *reported = p.reports.tail(i);
  return {p.kind[i], p.parameters[i], p.priority[i], p.own_margin[i],
          p.own.layers > 0 ? p.own[i] : Matrix<const double>{nullptr, 0, 0},
          p.sensed[i], {behind, p.n_u}, {behind + p.n_u, p.n_u},
          p.reports[i], {reported, p.n_u}, {reported + p.n_u, p.n_u}, p.rows[i],
          p.ends.rows > 0 ? p.ends[i] : Vector<const double>{nullptr, 0}};
}

// Returns the program of plant i; `numbers` holds the corners of U, and behind them the weights of all
// plants or of one a plant.
inline Settings program_of(const Constants& c, Vector<const double> numbers, Index i) {
  const Index end = 2 * c.corners;
  const bool weighs = numbers.size - end > c.weights;  // each plant by its own
  return {c.lower,  c.by_level, c.lock,         c.ranks,
          c.guided, c.radius,   c.lambda_u,     c.known_offset,
          {numbers.data, 1, c.corners, 2},
          {numbers.data + end + (weighs ? c.weights * i : 0), 1, c.weights}};
}

// Makes room for the conditions of a plant, and a row of guidance where its report has one.
inline void fit(const Constants& c, const One& p, Work& w) {
  const Index m = p.kind.size, total = p.rows.size, n_u = p.u_nominal.size;
  const std::array<Index, 4> shape{m, total, n_u, c.corners};
  if (shape == w.shape && c.radius == w.polygons.radius) return;
  w.shape = shape;
  const auto room = [](auto& of, Index size) {
    if (static_cast<Index>(of.size()) < size) of.resize(2 * size);
    return of.data();
  };
  double* at = room(w.numbers, 2 * n_u + total * (2 * n_u + 4 + 4 + 3 + 2) + 8 * m);
  const auto take = [&at](Index size) { return std::exchange(at, at + size); };
  w.u = {take(n_u), n_u}, w.a = {take(total * n_u), total, n_u};
  w.rows = {take(4 * total), 4, total}, w.margin = {take(4 * m), 4, m};
  w.straight = {take(3 * total), total, 3};
  w.other_a = {take(total * n_u), total, n_u}, w.other_rows = {take(4 * total), 4, total};
  w.other_margin = {take(4 * m), 4, m};
  w.answer = {{take(n_u), n_u}, {take(total), total}, {take(total), total}, 0, 0};
  Index* code = room(w.codes, total + m);
  w.priority = {code, total}, w.strict = {code + total, m};
  w.polygons.grow(c.radius, c.corners, total);
}

// Copies the rows that were made beforehand.
inline void take_rows(const Constants& c, const One& p, Work& w) {
  for (Index k = 0; k < p.kind.size; ++k) {
    if (p.kind[k] == layout::NONE) {
      rows::leave_out(k, w.a, w.rows);
      w.strict[k] = false;
      continue;
    }
    if (!c.made && p.kind[k] != layout::CUSTOM) continue;
    const Vector<const double> row = p.own[k];
    for (Index j = 0; j < w.a.columns; ++j) w.a(k, j) = row[general_rows::WIDTH + j];
    for (Index q = 0; q < 4; ++q) w.rows(q, k) = row[q];  // b, h, alpha2(psi) and psi
    w.margin(margins::MARGIN, k) = row[general_rows::MARGIN];
    w.margin(margins::USABLE, k) = row[general_rows::USABLE];
    w.strict[k] = row[general_rows::PLACED] != 0.0 && p.priority[k] == 1;
    if (c.drives) axle_step::turn_row(c, p, w, k);
  }
}

// Writes the margins and the rows, and returns whether these are finite; where they are not, takes them out.
inline bool make_rows(const Constants& c, const One& p, Work& w) {
  const Index m = p.kind.size;
  const plants::Plant& plant = p.plant;
  std::copy_n(p.priority.data, m, w.priority.data);
  if (c.made) {
    std::fill_n(w.margin.data, 4 * m, 0.0);
  } else {
    for (Index k = 0; k < m; ++k) w.strict[k] = !rows::is_on_speed(p.kind[k]) && p.priority[k] == 1;
    if (c.drives) {
      axle_step::make_rows(c, p, w);
    } else {
      const margins::Known known{plant.x,   plant.time,   plant.model, plant.lag, {plant.covariance[0], 4, 4},
                                 plant.growth};
      margins::derive(c.uncertainty, p.kind, p.parameters, known, c.period, w.margin);
      for (Index k = 0; k < m; ++k) w.margin(margins::MARGIN, k) += p.own_margin[k];
      rows::of_state(p.kind, p.parameters, w.margin, plant.x, plant.time, c.rows, w.a, w.rows);
    }
  }
  if (p.own.rows > 0) take_rows(c, p, w);
  bool finite = true;
  for (Index k = 0; k < m; ++k) {
    double size = 0.0, whole = w.rows(H, k);
    for (Index j = 0; j < w.a.columns; ++j) size += std::abs(w.a(k, j)), whole += w.a(k, j);
    if (c.rounding > 0.0 && p.priority[k] == 1) w.rows(B, k) += c.rounding * size;
    finite &= std::isfinite(whole + w.rows(B, k)) &&
              std::isfinite(w.rows(ALPHA2_PSI, k) + w.margin(margins::MARGIN, k));
  }
  if (!finite)
    for (Index k = 0; k < m; ++k) rows::leave_out(k, w.a, w.rows), w.margin(margins::MARGIN, k) = 0.0;
  return finite;
}

// Returns whether a plant is brought to rest: it or its path is unknown, or for an alarm.
inline bool stops(const Constants& c, const One& p) {
  return p.report.reason != 0 && (p.report.reason < reason::FIRST_ALARM || c.brakes);
}

// Writes the input of U nearest to what stops the plant's model, to 0 where no state is known.
// `DoubleIntegrator.brake` has -v/T for a single plant; those of other models stand in `stop`.
inline void wish_to_stop(const Constants& c, const Settings& settings, const One& p, Vector<double> u) {
  if (c.made) return copy(p.stop, u);
  Point wanted{0.0, 0.0};
  if (p.plant.known && c.period > 0.0) wanted = {-p.plant.x[2] / c.period, -p.plant.x[3] / c.period};
  const Point nearest = polygon::nearest(polygon::points(settings.vertices[0]), wanted);
  u[0] = nearest.x, u[1] = nearest.y;
}

// Writes u in the type of the environment's actions, and by how much it differs from u*; returns the
// greatest difference of an entry.
inline double give(const Constants& c, const One& p, Vector<double> u) {
  double furthest = 0.0, change2 = 0.0, asked2 = 0.0;
  for (Index j = 0; j < u.size; ++j) {
    if (c.rounding > 0.0) u[j] = static_cast<float>(u[j]);
    const double change = u[j] - p.u_nominal[j];
    furthest = std::max(furthest, std::abs(change));
    change2 += change * change;
    asked2 += p.u_nominal[j] * p.u_nominal[j];
    p.u_safe[j] = p.input[j] = u[j];
  }
  const double speed2 = p.plant.x[2] * p.plant.x[2] + p.plant.x[3] * p.plant.x[3];
  p.report.intervention = std::sqrt(change2);
  p.report.deadlock = speed2 < STANDING * STANDING && asked2 > ASKING * ASKING;
  return furthest;
}

// Lets guidance act: a program that has a last rank gets its row, the others' u* is shaped by it. `leads`: whether
// it requests anything.
inline void guide(const Constants& c, const One& p, bool leads, Work& w) {
  const plants::Plant& plant = p.plant;
  const guidance_row::Row way{plant.way[0], plant.way[1], plant.way[2]};
  const auto [a_x, a_y, b] = leads ? way : guidance_row::NOTHING;
  const Index last = p.kind.size;
  if (leads && !c.guided) {
    const auto shaped = guidance_row::shape(w.u[0], w.u[1], a_x, a_y, b);
    w.u[0] = shaped.x, w.u[1] = shaped.y;
  } else if (w.priority.size > last) {
    const auto reachable = static_cast<Index>(leads ? plant.reachable : 0.0);
    const auto zone = static_cast<Index>(leads ? plant.zone : 0.0);
    guidance_row::insert(w.priority.part(0, last), reachable, zone, c.through, w.priority);
    w.a(last, 0) = a_x, w.a(last, 1) = a_y;
    w.rows(B, last) = b, w.rows(H, last) = w.rows(ALPHA2_PSI, last) = 0.0;
  }
}

// Poses the program of one plant, whose state is valid, and returns it with the plant's U. Its nominal input is
// u*, guided or not, or the input that brakes.
inline Settings pose(const Constants& c, Settings settings, const One& p, Work& w) {
  plants::Plant& plant = p.plant;
  Index& why = p.report.reason;
  fit(c, p, w);
  if (c.drives) settings.vertices = axle_step::corners(c, p, w.corners);
  if (!make_rows(c, p, w)) why = reason::BARRIERS;
  if (c.drives) axle_step::turn_memory(plant, p.input.data);
  if (why == 0) {
    const bool exact = c.settles == 0.0 && !c.drives;
    if (!c.made) monitor::watch(plant, p.input, c.radius, c.uncertainty.confidence, exact, c.observed);
    why = plant.alarm;
    if (why == 0 && plant.moves != 0) why = reason::MOVES;
    if (plant.lost != 0 && !stops(c, p)) why = reason::GOAL;
  } else {
    plant.follows = 0;
  }
  const bool braked = stops(c, p), leads = !braked && c.has_way;
  p.report.model_error = std::sqrt(plant.inputs.error), p.report.reachable = leads ? plant.reachable : 0.0;
  if (braked)
    wish_to_stop(c, settings, p, w.u);
  else
    copy(p.u_nominal, w.u);
  if (leads && c.drives) axle_step::turn_to_way(plant, w.u.data);
  if (leads || braked) guide(c, p, leads, w);
  if (c.drives && c.by_level) axle_step::split_ranks(p, w);
  return settings;
}

// Concludes what `pose` began. `answered`: whether the program's answer is in `w`; if not, the plant is brought to
// rest.
inline void close(const Constants& c, const Settings& settings, bool answered, const One& p, Work& w) {
  if (!answered && !stops(c, p)) {
    p.report.reason = reason::SOLVER;
    wish_to_stop(c, settings, p, w.u);
  }
  // After an alarm, and where guidance finds no path, the state is valid: braking may bring the plant to a region,
  // and the program's answer to the braking input keeps it away. Elsewhere rows say nothing.
  const Index why = p.report.reason;
  const bool unsure = why < reason::FIRST_ALARM || why == reason::MOTION || why == reason::RESPONSE;
  const bool braked = stops(c, p);
  if (!answered || (braked && unsure && why != reason::GOAL)) {
    copy(w.u, w.answer.u), w.answer.fallbacks = 0;
    std::fill_n(w.answer.slack.data, w.priority.size, 0.0), std::fill_n(w.answer.delta.data, w.priority.size, 0.0);
  }
  if (braked) w.answer.status = program_records::BACKUP;
  conclusion::conclude(c, p, give(c, p, w.answer.u), w);
}

// Brings a plant to rest whose state is not valid, or lets a gatekeeper's manoeuvre go on.
inline void brake(const Constants& c, Settings settings, const One& p, const manoeuvres::Own& laws) {
  double corners[8];
  if (c.drives) {
    settings.vertices = axle_step::corners(c, p, corners);
    axle_step::turn_memory(p.plant, p.input.data);
  }
  p.plant.follows = 0;
  wish_to_stop(c, settings, p, p.u_safe);
  if (c.gates) gatekeeper::go_on(c, settings, p, laws, p.u_safe);
  give(c, p, p.u_safe);
  p.report.model_error = std::sqrt(p.plant.inputs.error), p.report.reachable = p.report.fallbacks = 0.0;
  p.report.status = program_records::BACKUP, p.report.proved = 0;
  for (Index k = 0; k < p.kind.size; ++k) {
    const double h = p.kind[k] == layout::NONE ? INFINITY : NAN;
    p.rows[k] = {0.0, 0.0, 0.0, h, h, 0.0};
  }
}

// Returns whether the state of a plant is valid, so that its problem can be posed; else it is brought to rest.
inline bool is_posed(const Constants& c, const Settings& program, const One& p, const manoeuvres::Own& laws) {
  if (p.own.rows == 0 && !c.made) p.report.reason = state_check::check(p.plant, p.input);
  if (p.report.reason == 0) return true;
  if (c.drives) axle_step::carry_on(c.axle, p.plant);
  brake(c, program, p, laws);
  return false;
}

// Filters one plant, and returns whether a warning is due. `atlas`: where the pieces of maps are; empty
// without a map.
inline bool filter(const Constants& c, const Settings& program, const One& given, Vector<const double> atlas,
                   Room& room) {
  if (!is_posed(c, program, given, room.laws)) return true;
  const bool on_map = atlas.size > 0;
  if (on_map) map_rows::find(c, given, atlas, room.map);
  const One p = on_map ? map_rows::with_pieces(given, room.map) : given;
  Work& w = room.work;
  const Settings settings = pose(c, program, p, w);
  w.answer.fallbacks = 0;
  if (c.gates) {
    const gatekeeper::Answer through = gatekeeper::filter(c, settings, p, room.laws, w);
    close(c, settings, true, p, w);
    gatekeeper::conclude(through, p);
  } else {
    w.answer.status = cascade::filter_state<double>(
        settings, polygon::points(settings.vertices[0]), settings.weights[0], {w.u[0], w.u[1]},
        {w.a, w.rows[B], w.rows[H], w.priority, w.rows[ALPHA2_PSI]}, w.answer.u, w.answer.slack, w.answer.delta,
        w.polygons);
    if (c.drives && p.report.reason == 0) axle_step::slide(c, settings, p, w);
    close(c, settings, true, p, w);
  }
  if (on_map) map_rows::merge(room.map, given);
  return p.report.reason != 0;
}

}  // namespace hcbf::step
