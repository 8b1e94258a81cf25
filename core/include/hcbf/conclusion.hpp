// The report of one plant, from its program's answer: what it lacks, its status, its rows.
//
// The proposition of docs/guarantees.md starts from h >= m and psi >= 0 of every strict condition on
// the position. A step at which both hold is *proved*. One at which they do not is VIOLATED, whatever
// the cause: a conflict, a push, a fix, changed barriers.
//
// There is one exception. m may also be consumed: by the tracking error of a robot beside its model,
// and by the errors of a scan. With e the part of m that they may consume without notice, such a step
// is not proved, but VIOLATED only where h < m - e, or d/dt(h - m) + alpha1(h - m + e) stays below
// zero for longer than the robot takes to follow, or a change left it so. A change counts where one
// of the two falls below its value before. Of a robot that is its model, e = 0.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/axle_step.hpp>
#include <hcbf/general_rows.hpp>
#include <hcbf/plants.hpp>
#include <hcbf/rows.hpp>
#include <hcbf/state_check.hpp>
#include <hcbf/tolerances.hpp>

namespace hcbf::conclusion {

using plants::Constants, plants::One, plants::Work;
using program_records::FilterStatus;
using rows::H, rows::PSI;

// What the strict conditions on the position lack at one sample.
struct Shortfall {
  double kept;             // the least h - m [m]
  double headway;          // the least psi [m/s]
  double kept_at_most;     // as `kept`, with m - e for m
  double headway_at_most;  // likewise
};

// Returns what strict conditions lack; usual rows may dip between samples by what they reserve.
// `strict`: (m,) which conditions are of rank 1 and on the position; `usable`: (m,) what of m the
// tracking error and errors of measurement may consume; `dip`: what usual rows reserve against dips
// between samples, 0 for held rows; `tracking`: what of the constant part a robot may consume that is not
// its model; `alpha1`: (4,).
inline Shortfall shortfall(Vector<const Index> strict, Vector<const double> h, Vector<const double> margin,
                           Vector<const double> usable, Vector<const double> psi, double dip, double tracking,
                           const class_k::ClassK& alpha1) {
  Shortfall short_{INFINITY, INFINITY, INFINITY, INFINITY};
  for (Index k = 0; k < strict.size; ++k) {
    if (!strict[k]) continue;
    const double kept = h[k] - margin[k] + dip, used = usable[k] + tracking;
    double spare = psi[k];
    if (dip > 0.0) spare += class_k::value(alpha1, kept) - class_k::value(alpha1, kept - dip);
    short_.kept = std::min(short_.kept, kept), short_.headway = std::min(short_.headway, spare);
    if (used > 0.0) spare += class_k::value(alpha1, kept + used) - class_k::value(alpha1, kept);
    short_.kept_at_most = std::min(short_.kept_at_most, kept + used);
    short_.headway_at_most = std::min(short_.headway_at_most, spare);
  }
  return short_;
}

// Returns whether h is below m, or psi below zero.
inline bool lacks(const Shortfall& at) { return at.kept < -margins::SHORT || at.headway < -margins::SHORT; }

// Returns whether a step is VIOLATED for what its strict conditions lack, and remembers. `period`: T
// [s], 0 where it is not known; `settles`: how long a robot takes to follow [s], 0 for its model.
inline bool is_violated(Memory& memory, const Shortfall& now, double period, double settles) {
  bool fell = memory.change == CHANGED;
  if (memory.change == COMPARED)
    fell = now.kept_at_most < memory.kept - margins::SHORT ||
           now.headway_at_most < memory.headway - margins::SHORT;
  memory.unproved = lacks(now) && (fell || memory.unproved != 0);
  memory.change = 0, memory.kept = now.kept, memory.headway = now.headway;
  const bool fast = now.headway_at_most < -margins::SHORT;
  memory.closing = fast ? memory.closing + period : 0.0;
  const bool exact = settles == 0.0 || period == 0.0;
  const bool lasts = fast && (exact || memory.closing > settles);
  return memory.unproved != 0 || now.kept_at_most < -margins::SHORT || lasts;
}

// Returns the status of a step. A guidance row that is relaxed is no violation, and an input that only
// guidance moved is SAFE. `status`: the program's; `moved`: whether u is not u*; `unsafe`: whether a
// strict h is below zero; `slack`: (m,) of the safety rows.
inline Index status_of(Index status, bool moved, bool unsafe, bool violated, Vector<const double> slack) {
  if (status == FilterStatus::BACKUP) return status;
  if (unsafe) return FilterStatus::UNSAFE;
  const bool met = std::all_of(slack.data, slack.data + slack.size, [](double each) { return each == 0.0; });
  if (met) status = moved ? FilterStatus::SAFE : FilterStatus::NOMINAL;
  return violated ? std::max<Index>(status, FilterStatus::VIOLATED) : status;
}

// Returns whether a body is faster than a speed limit, or than that of a zone in which it is. Rows read
// the model's velocity, and reserve what the body may differ while it follows; right after a limit
// begins, or under commands that nobody knows, only its own velocity shows. h and x (4,) are of one
// point: the axle of a differential drive, all others' own. `limit`: L [m/s]; `lag`: (4,) the body's
// state minus the model's.
inline bool speeds(Index kind, double limit, double h, const double* x, const double* lag) {
  if (kind != layout::SPEED_LIMIT && kind != layout::ZONES && kind != layout::ZONE) return false;
  const double model2 = x[2] * x[2] + x[3] * x[3];
  const double away = 2.0 * limit * h - limit * limit + model2;  // of a zone, times what brakes before it
  return away < 1e-9 && margins::is_fast(limit, x, lag);
}

// Returns whether a body is beyond an edge of rank 1, or faster than a limit of rank 1.
inline bool is_unsafe(const Constants& c, const One& p, const Work& w) {
  const plants::Plant& plant = p.plant;
  const Vector<const double> h = w.rows[H];
  const double body = c.uncertainty.body;
  axle_step::Placed axle;
  if (c.drives) axle = axle_step::place(c, plant);
  for (Index k = 0; k < p.kind.size; ++k) {
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
    if (nearest < reach || speeds(p.kind[k], limit, h[k], x, lag)) return true;
  }
  return false;
}

// Writes the report of one condition.
inline void report_row(const Constants& c, const One& p, const Work& w, Index k, bool is_valid) {
  report::Row& row = p.rows[k];
  if (p.kind[k] == layout::NONE) {
    row = {0.0, 0.0, 0.0, INFINITY, INFINITY, 0.0};
    return;
  }
  row = {w.answer.slack[k], w.answer.delta[k], w.margin(margins::MARGIN, k), NAN, NAN, 0.0};
  if (p.own.rows > 0 && p.kind[k] == layout::CUSTOM) row.margin += p.own(k, general_rows::DIP);
  if (!is_valid) return;
  row.h = w.rows(H, k), row.psi = w.rows(PSI, k);
  if (c.made)
    row.conditioning = p.own(k, general_rows::CONDITIONING);
  else if (w.a(k, 0) != 0.0 || w.a(k, 1) != 0.0)
    row.conditioning = 1.0;
}

// Writes the report of one plant. `furthest`: the greatest difference of an entry of u from u*.
inline void conclude(const Constants& c, const One& p, double furthest, const Work& w) {
  const Index m = p.kind.size, why = p.report.reason;
  const Vector<double> slack = w.answer.slack.part(0, m);
  p.report.proved = 0;
  bool violated = false;
  const bool is_valid = why == 0 || why >= reason::FIRST_ALARM || why == reason::GOAL;
  if (p.report.verified != 0) {
    p.report.proved = 1;
  } else if (is_valid) {
    const auto lack =
        shortfall(w.strict, w.rows[H], w.margin[margins::MARGIN], w.margin[margins::USABLE], w.rows[PSI],
                  c.dip, c.tracking, c.rows.alpha1);
    violated = is_violated(p.plant.judged, lack, p.plant.elapsed, c.settles);
    p.report.proved = !lacks(lack);
  }
  if (c.drives)
    for (Index k = 0; k < m; ++k) violated |= p.priority[k] == 1 && slack[k] > 0.0;
  const bool moved = furthest > tolerances::NOMINAL * (1.0 + c.radius);
  p.report.status = status_of(w.answer.status, moved, is_unsafe(c, p, w), violated, slack);
  p.report.fallbacks = w.answer.fallbacks;
  for (Index k = 0; k < m; ++k) report_row(c, p, w, k, is_valid);
}

}  // namespace hcbf::conclusion
