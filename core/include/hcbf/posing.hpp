// The problem of one plant, as a program solves it: margins, rows, guidance, and the nominal input.
//
// Of planar double integrators all of it is made here. Of other models rows, alarms and braking inputs
// were made beforehand, and the states checked.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/axle_step.hpp>
#include <hcbf/general_rows.hpp>
#include <hcbf/guidance_row.hpp>
#include <hcbf/monitor.hpp>
#include <hcbf/plants.hpp>
#include <hcbf/reason.hpp>
#include <hcbf/rows.hpp>
#include <hcbf/state_check.hpp>
#include <hcbf/work.hpp>

namespace hcbf::posing {

using plants::Constants, plants::One, polygon::Point, program_records::Settings, work::Work;
using rows::ALPHA2_PSI, rows::B, rows::H, rows::PSI;

// Checks the state, unless that was done where rows were made.
inline void look(const Constants& c, const One& p) {
  if (p.own.rows == 0 && !c.made) p.report.reason = state_check::check(p.plant, p.input);
  if (c.drives && p.report.reason != 0) axle_step::carry_on(c.axle, p.plant);
}

// Takes condition k out: every input meets it.
inline void leave_out(Work& w, Index k) {
  rows::leave_out(0, k, {w.a.data, 1, w.a.rows, w.a.columns}, {w.rows.data, 4, 1, w.rows.columns});
}

// Writes the margins and rows of a planar double integrator, users' own barriers left out.
inline void make_planar_rows(const Constants& c, const One& p, Work& w) {
  const Index m = p.count();
  for (Index k = 0; k < m; ++k) w.strict[k] = !rows::is_on_speed(p.kind[k]) && p.priority[k] == 1;
  if (c.drives) return axle_step::make_rows(c, p, w);
  const plants::Plant& plant = p.plant;
  const margins::Known known{plant.x, plant.time, plant.model, plant.lag, {plant.covariance[0], 4, 4},
                             plant.growth};
  margins::derive(c.uncertainty, p.kind, p.parameters, known, c.period, work::reserved(w.margin));
  for (Index k = 0; k < m; ++k) w.margin(margins::MARGIN, k) += p.own_margin[k];
  rows::of_state(p.kind, p.parameters, w.margin, plant.x, plant.time, c.rows, w.a, w.rows);
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
    w.margin(margins::USABLE, k) = row[general_rows::USABLE];
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
inline bool have_rows(const One& p, Work& w) {
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

// Decides on the program's nominal input: u*, guided or not, or the input that brakes. The state is valid.
inline void ask(const Constants& c, const Settings& settings, const One& p, Work& w) {
  plants::Plant& plant = p.plant;
  Index& why = p.report.reason;
  if (!have_rows(p, w)) why = reason::BARRIERS;
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
  p.report.model_error = std::sqrt(plant.inputs.error);
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

// Makes room for a plant, and gives its program the U that a differential drive has at its heading.
inline void fit(const Constants& c, Settings& settings, const One& p, Work& w) {
  w.fit(p.count(), p.rows.size, p.u_nominal.size, c.radius, c.corners);
  if (!c.drives) return;
  axle::corners(c.axle, p.plant.x, p.plant.heading, c.period, w.corners);
  settings.vertices = {w.corners, 1, 4, 2};
}

// Poses the program of one plant, and returns it with the plant's U.
inline Settings pose(const Constants& c, Settings settings, const One& p, Work& w) {
  fit(c, settings, p, w);
  make_rows(c, p, w);
  ask(c, settings, p, w);
  return settings;
}

// Brings a plant to rest whose state is not valid: no rows are made, and no program is asked.
inline void brake(const Constants& c, Settings settings, const One& p, Work& w) {
  fit(c, settings, p, w);
  p.plant.follows = 0;
  if (c.drives) axle_step::turn_memory(p.plant, p.input.data);
  p.report.model_error = std::sqrt(p.plant.inputs.error), p.report.reachable = 0.0;
  wish_to_stop(c, settings, p, w.answer.u[0]);
}

}  // namespace hcbf::posing
