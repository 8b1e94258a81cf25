// From u* to u: margins, rows, guidance, program, status, one plant after the other.
//
// Of planar double integrators all of it happens here. Of other models rows, alarms and braking inputs
// were made beforehand, and the states checked.
#pragma once
#include <algorithm>
#include <cmath>
#include <vector>

#include <hcbf/axle_step.hpp>
#include <hcbf/cascade.hpp>
#include <hcbf/general_rows.hpp>
#include <hcbf/guidance_row.hpp>
#include <hcbf/map_rows.hpp>
#include <hcbf/mapped.hpp>
#include <hcbf/monitor.hpp>
#include <hcbf/plants.hpp>
#include <hcbf/reason.hpp>
#include <hcbf/rows.hpp>
#include <hcbf/state_check.hpp>
#include <hcbf/status.hpp>
#include <hcbf/work.hpp>

namespace hcbf::step {

using plants::Constants, plants::One, plants::Plants, polygon::Point, program_records::Settings, work::Work;
using rows::ALPHA2_PSI, rows::B, rows::H, rows::PSI;

// What a call returns: nothing to do, u* is not finite, a scene is not of these plants, a warning is due.
enum Said : Index { DONE, NOT_FINITE, MISSHAPED, ASKS };

inline bool is_finite(Vector<const double> values) {
  return std::all_of(values.begin(), values.end(), [](double each) { return std::isfinite(each); });
}

// Returns what is wrong with the arrays, `DONE` for nothing; nothing is written.
inline Said check(const Constants& c, const Plants& plants) {
  for (Index i = 0; i < plants.reports.size; ++i)
    if (!is_finite({plants.reports.tail(i), plants.n_u})) return NOT_FINITE;
  return fits(plants, c.guided && c.has_way) ? DONE : MISSHAPED;
}

// Checks the state, unless that was done where rows were made.
inline void look(const Constants& c, const One& p) {
  if (p.own.rows == 0 && !c.made) p.report.reason = state_check::believe(p.plant, p.input);
  if (c.drives && p.report.reason != 0) axle_step::carry_on(c.axle, p.plant);
}

// Takes condition k out: every input meets it.
inline void leave_out(Work& w, Index k) {
  rows::leave_out(0, k, {w.a.data, 1, w.a.rows, w.a.columns}, {w.rows.data, 4, 1, w.rows.columns});
}

// Writes the margins and rows of a planar double integrator, users' own barriers left out.
inline void make_planar_rows(const Constants& c, const One& p, Work& w) {
  const Index m = p.count();
  for (Index k = 0; k < m; ++k) w.strict[k] = !axle_step::is_on_speed(p.kind[k]) && p.priority[k] == 1;
  if (c.drives) return axle_step::make_rows(c, p, w);
  const plants::Plant& plant = p.plant;
  const margins::Known known = axle_step::known_of(plant, plant.x, plant.model, plant.lag);
  margins::derive(c.uncertainty, p.kind, p.parameters, known, c.period, work::reserved(w.margin));
  for (Index k = 0; k < m; ++k) w.margin(margins::MARGIN, k) += p.own_margin[k];
  axle_step::write_rows(p, plant.x, c.rows, w.margin, w.a, w.rows);
}

// Copies the rows that were made beforehand.
inline void take_rows(const Constants& c, const One& p, Work& w) {
  for (Index k = 0; k < p.count(); ++k) {
    if (p.kind[k] == layout::NONE) {
      leave_out(w, k);
      w.strict[k] = false;
      continue;
    }
    if (!c.made && p.kind[k] != layout::CUSTOM) continue;
    const Vector<const double> row = p.own[k];
    for (Index j = 0; j < w.a.columns; ++j) w.a(k, j) = row[general_rows::WIDTH + j];
    for (Index q = 0; q < 4; ++q) w.rows(q, k) = row[q];  // b, h, alpha2(psi) and psi
    w.margin(margins::MARGIN, k) = row[general_rows::MARGIN];
    w.margin(margins::LEANING, k) = row[general_rows::LEANING];
    w.strict[k] = row[general_rows::PLACED] != 0.0 && p.priority[k] == 1;
    if (c.drives) axle_step::turn_row(c, p, w, k);
  }
}

// Writes the margins and the rows.
inline void make_rows(const Constants& c, const One& p, Work& w) {
  const Index m = p.count();
  for (Index k = 0; k < m; ++k) w.priority[k] = p.priority[k];
  if (c.made)
    std::fill(w.margin.data, w.margin.data + 4 * m, 0.0);
  else
    make_planar_rows(c, p, w);
  if (p.own.rows > 0) take_rows(c, p, w);
  if (!(c.rounding > 0.0)) return;
  for (Index k = 0; k < m; ++k) {
    if (p.priority[k] != 1) continue;
    double size = 0.0;
    for (Index j = 0; j < w.a.columns; ++j) size += std::abs(w.a(k, j));
    w.rows(B, k) += c.rounding * size;
  }
}

// Returns whether the safety rows are finite; where they are not, takes them out.
inline bool are_finite(const One& p, Work& w) {
  bool finite = true;
  for (Index k = 0; k < p.count(); ++k) {
    double whole = w.rows(B, k) + w.rows(H, k);
    for (Index j = 0; j < w.a.columns; ++j) whole += w.a(k, j);
    finite &= std::isfinite(whole);
    finite &= std::isfinite(w.rows(ALPHA2_PSI, k) + w.margin(margins::MARGIN, k));
  }
  if (!finite)
    for (Index k = 0; k < p.count(); ++k) leave_out(w, k), w.margin(margins::MARGIN, k) = 0.0;
  return finite;
}

// Returns whether a plant is brought to rest: it or its path is unknown, or for an alarm.
inline bool stops(Index why, bool brakes) { return why != 0 && (why < reason::FIRST_ALARM || brakes); }

// Writes the input of U nearest to what stops the plant's model, to 0 where no state is known.
// `DoubleIntegrator.brake` has -v/T for a single plant; those of other models stand in `stop`.
inline void wish_to_stop(const Constants& c, const Settings& settings, const One& p, Vector<double> u) {
  if (c.made) return state_check::copy(p.stop, u);
  Point wanted{0.0, 0.0};
  if (p.plant.known && c.period > 0.0) wanted = {-p.plant.x[2] / c.period, -p.plant.x[3] / c.period};
  const Point nearest = polygon::nearest(polygon::points(settings.vertices[0]), wanted);
  u[0] = nearest.x, u[1] = nearest.y;
}

// Writes a row of guidance behind the safety rows.
inline void lead(Work& w, Index last, double a_x, double a_y, double b) {
  w.a(last, 0) = a_x, w.a(last, 1) = a_y;
  w.rows(B, last) = b, w.rows(H, last) = w.rows(ALPHA2_PSI, last) = 0.0;
}

// Lets guidance act: a program that has a last rank gets its row, the others' u* is shaped by it.
inline void guide(const Constants& c, const One& p, Work& w) {
  const plants::Plant& plant = p.plant;
  const auto [a_x, a_y, b] = plant.way;
  if (!c.guided) {
    const auto shaped = guidance_row::shape(w.u[0], w.u[1], a_x, a_y, b);
    w.u[0] = shaped.x, w.u[1] = shaped.y;
    return;
  }
  const Index last = p.count();
  guidance_row::insert(w.priority.part(0, last), static_cast<Index>(plant.reachable),
                       static_cast<Index>(plant.zone), c.through, w.priority);
  lead(w, last, a_x, a_y, b);
}

// Lets the row of guidance, where there is one, request nothing.
inline void guide_nowhere(const Constants& c, const One& p, Work& w) {
  const Index last = p.count();
  if (w.priority.size <= last) return;
  guidance_row::insert(w.priority.part(0, last), 0, 0, c.through, w.priority);
  lead(w, last, 0.0, 0.0, -1.0);
}

// Decides on the program's nominal input: u*, guided or not, or the input that brakes.
inline void ask(const Constants& c, const Settings& settings, const One& p, Work& w) {
  plants::Plant& plant = p.plant;
  Index& why = p.report.reason;
  if (!are_finite(p, w) && why == 0) why = reason::BARRIERS;
  if (c.drives) axle_step::turn_memory(plant, p.input.data);
  if (why == 0) {
    const bool exact = c.settles == 0.0 && !c.drives;
    if (!c.made) monitor::watch(plant, p.input, c.radius, c.uncertainty.confidence, exact, c.observed);
    why = plant.alarm;
    if (why == 0 && plant.moves != 0) why = reason::MOVES;
    if (plant.lost != 0 && !stops(why, c.brakes)) why = reason::GOAL;
  } else {
    plant.follows = 0;
  }
  p.report.model_error = std::sqrt(plant.watched.error);
  p.report.reachable = 0.0;
  if (stops(why, c.brakes)) {
    wish_to_stop(c, settings, p, w.u);
    guide_nowhere(c, p, w);
  } else {
    state_check::copy(p.u_nominal, w.u);
    if (c.has_way) {
      p.report.reachable = plant.reachable;
      if (c.drives) axle_step::turn_to_way(plant, w.u.data);
      guide(c, p, w);
    }
  }
  if (c.drives && c.by_level) axle_step::split_ranks(p, w);
}

// Makes the braking input the answer, as it is: the rows say nothing, or no solver answered. After an
// alarm, and where guidance finds no path, the state is valid: braking may bring the plant to a region,
// and the program's answer to the braking input keeps it away.
inline void apply(Work& w) {
  state_check::copy(w.u, w.answer.u[0]);
  for (Index k = 0; k < w.priority.size; ++k) w.answer.slack(0, k) = w.answer.delta(0, k) = 0.0;
  w.answer.fallbacks[0] = 0;
}

// Returns whether a body is beyond an edge of rank 1, or faster than a limit of rank 1.
inline bool is_unsafe(const Constants& c, const One& p, const Work& w) {
  const plants::Plant& plant = p.plant;
  const Vector<const double> h = w.rows[H];
  const double body = c.uncertainty.body;
  axle_step::Placed axle;
  if (c.drives) axle = axle_step::place(c, plant);
  for (Index k = 0; k < p.count(); ++k) {
    if (p.priority[k] != 1) continue;
    double reach = 0.0, nearest = h[k];
    const double *x = plant.x, *lag = plant.lag;
    if (c.made) {
      if (w.strict[k]) reach = p.own(k, general_rows::REACH);
      if (h[k] < reach || p.own(k, general_rows::FAST) != 0.0) return true;
      continue;
    }
    if (c.drives) {
      if (w.strict[k]) reach = body;  // a is not the gradient of h
      nearest = axle_step::of_body(c, p, w, k), x = axle.x, lag = axle.lag;
    } else if (body > 0.0 && w.strict[k]) {
      reach = body * std::sqrt(w.a(k, 0) * w.a(k, 0) + w.a(k, 1) * w.a(k, 1));
    }
    const double limit = p.parameters(k, layout::V_MAX);
    if (nearest < reach || status::speeds(p.kind[k], limit, h[k], x, lag)) return true;
  }
  return false;
}

// Writes the report of one condition.
inline void report_row(const Constants& c, const One& p, const Work& w, Index k, bool believed) {
  report::Row& row = p.rows[k];
  if (p.kind[k] == layout::NONE) {
    row = {0.0, 0.0, 0.0, INFINITY, INFINITY, 0.0};
    return;
  }
  row = {w.answer.slack(0, k), w.answer.delta(0, k), w.margin(margins::MARGIN, k), NAN, NAN, 0.0};
  if (p.own.rows > 0 && p.kind[k] == layout::CUSTOM) row.margin += p.own(k, general_rows::DIP);
  if (!believed) return;
  row.h = w.rows(H, k), row.psi = w.rows(PSI, k);
  if (c.made)
    row.conditioning = p.own(k, general_rows::CONDITIONING);
  else if (w.a(k, 0) != 0.0 || w.a(k, 1) != 0.0)
    row.conditioning = 1.0;
}

// Writes the report of one plant.
inline void conclude(const Constants& c, const One& p, Work& w) {
  const Index m = p.count();
  const Vector<double> u = w.answer.u[0];
  const Index why = p.report.reason;
  if (stops(why, c.brakes)) {
    const bool unsure = why < reason::FIRST_ALARM || why == reason::MOTION || why == reason::RESPONSE;
    if (unsure && why != reason::GOAL) apply(w);
    w.answer.status[0] = result::BACKUP;
  }
  double furthest = 0.0, change2 = 0.0, asked2 = 0.0;
  for (Index j = 0; j < u.size; ++j) {
    if (c.rounding > 0.0) u[j] = static_cast<float>(u[j]);
    const double change = u[j] - p.u_nominal[j];
    furthest = std::max(furthest, std::abs(change));
    change2 += change * change;
    asked2 += p.u_nominal[j] * p.u_nominal[j];
    p.u_safe[j] = p.input[j] = u[j];
  }
  const Vector<double> slack = w.answer.slack[0].part(0, m);
  p.report.proved = 0;
  bool violated = false;
  const bool believed = why == 0 || why >= reason::FIRST_ALARM || why == reason::GOAL;
  if (believed) {
    const auto lack = status::shortfall(w.strict, w.rows[H], w.margin[margins::MARGIN], w.margin[margins::LEANING],
                                        w.rows[PSI], c.dip, c.sway, c.rows.alpha1);
    violated = status::is_violated(p.plant.judged, lack, p.plant.elapsed, c.settles);
    p.report.proved = !status::lacks(lack);
  }
  if (c.drives)
    for (Index k = 0; k < m; ++k) violated |= p.priority[k] == 1 && slack[k] > 0.0;
  const bool moved = furthest > tolerances::NOMINAL * (1.0 + c.radius);
  p.report.status = status::conclude(w.answer.status[0], moved, is_unsafe(c, p, w), violated, slack);
  p.report.intervention = std::sqrt(change2);
  p.report.fallbacks = w.answer.fallbacks[0];
  p.report.deadlock = status::stands(p.plant.x[2] * p.plant.x[2] + p.plant.x[3] * p.plant.x[3], asked2);
  for (Index k = 0; k < m; ++k) report_row(c, p, w, k, believed);
}

// What one plant's step needs besides; it is kept, and used again for the next one.
struct Room {
  Work work;
  mapped::Nearby nearby;         // the conditions of a plant on a map
  std::vector<double> own;       // their rows that were made beforehand
  std::vector<report::Row> rows;  // their report
};

// Returns a plant with the nearby pieces of its map, as they were found last.
inline One with_pieces(const One& p, Room& room) {
  const mapped::Scene scene = room.nearby.scene();
  const Index count = scene.kind.size, width = p.own.columns;
  return {scene.kind, scene.parameters, scene.priority, scene.own_margin,
          {room.own.data(), p.own.rows > 0 ? count : 0, width}, p.plant, p.input, p.stop,
          p.report, p.u_nominal, p.u_safe, {room.rows.data(), count + p.rows.size - p.count()}};
}

// Finds the nearby pieces of a plant's map.
inline void find_pieces(const Constants& c, const One& p, Vector<const double> atlas, Room& room) {
  axle_step::Placed at;
  if (c.drives) at = axle_step::place(c, p.plant);
  const margins::Known known = c.drives ? axle_step::known_of(p.plant, at.x, at.model, at.lag)
                                        : axle_step::known_of(p.plant, p.plant.x, p.plant.model, p.plant.lag);
  mapped::nearby(c.uncertainty, c.drives ? c.axle_rows : c.rows, c.drives ? c.axle_rows.u_max : c.radius,
                 {p.kind, p.parameters, p.priority, p.own_margin, p.kind}, atlas, known, room.nearby);
  room.rows.resize(room.nearby.kind.size() + p.rows.size - p.count());
  room.own.clear();
  if (p.own.rows == 0) return;
  for (const Index k : room.nearby.source) room.own.insert(room.own.end(), p.own[k].begin(), p.own[k].end());
}

// Poses the program of one plant, and returns it with the plant's U.
inline Settings pose(const Constants& c, Settings settings, const One& p, Work& w) {
  w.fit(p.count(), p.rows.size, p.u_nominal.size, c.radius, c.corners);
  make_rows(c, p, w);
  if (c.drives) {
    axle::corners(c.axle, p.plant.x, p.plant.heading, c.period, w.corners);
    settings.vertices = {w.corners, 1, 4, 2};
  }
  ask(c, settings, p, w);
  return settings;
}

// Filters one plant with what is nearby.
inline void filter_nearby(const Constants& c, const Settings& program, const One& p, Work& w) {
  const Settings settings = pose(c, program, p, w);
  cascade::filter_range(settings, {w.u.data, 1, 2}, w.problem(w.a, w.rows[B]), w.answer, w.polygons, 0, 1);
  if (c.drives && p.report.reason == 0) axle_step::slide(c, settings, p, w);
  conclude(c, p, w);
}

// Filters one plant, and returns whether a warning is due. `atlas`: where the pieces of maps are; empty
// without a map.
inline bool filter(const Constants& c, const Settings& program, const One& p, Vector<const double> atlas,
                   Room& room) {
  look(c, p);
  if (atlas.size == 0) {
    filter_nearby(c, program, p, room.work);
  } else {
    find_pieces(c, p, atlas, room);
    const One part = with_pieces(p, room);
    filter_nearby(c, program, part, room.work);
    map_rows::tell(room.nearby.scene().source, part.rows, p.rows.part(0, p.count()));
  }
  return p.report.reason != 0;
}

// Concludes what `pose` began. `answered`: whether a solver's answer is in `w`; if not, the plant is
// brought to rest.
inline void close(const Constants& c, const Settings& settings, bool answered, const One& p, Work& w) {
  if (!answered) {
    if (!stops(p.report.reason, c.brakes)) {
      p.report.reason = reason::SOLVER;
      wish_to_stop(c, settings, p, w.u);
    }
    apply(w);
  }
  conclude(c, p, w);
}

}  // namespace hcbf::step
