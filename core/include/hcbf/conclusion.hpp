// The report of one plant, from its program's answer.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/axle_step.hpp>
#include <hcbf/general_rows.hpp>
#include <hcbf/plants.hpp>
#include <hcbf/posing.hpp>
#include <hcbf/reason.hpp>
#include <hcbf/status.hpp>
#include <hcbf/tolerances.hpp>
#include <hcbf/work.hpp>

namespace hcbf::conclusion {

using plants::Constants, plants::One, work::Work;
using rows::H, rows::PSI;

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
  if (posing::stops(why, c.brakes)) {
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
    const auto lack =
        status::shortfall(w.strict, w.rows[H], w.margin[margins::MARGIN], w.margin[margins::USABLE],
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

}  // namespace hcbf::conclusion
