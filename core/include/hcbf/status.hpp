// The status of a step, and whether rank 1 is proved.
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

#include <hcbf/constants.hpp>
#include <hcbf/class_k.hpp>
#include <hcbf/layout.hpp>
#include <hcbf/margins.hpp>
#include <hcbf/memory.hpp>
#include <hcbf/result.hpp>

namespace hcbf::status {

using result::FilterStatus;

// What came in unforeseen: barriers that are compared with those before; any others, or a state after
// none.
enum News : Index { COMPARED = 1, NEWS = 2 };

using constants::ASKING, constants::STANDING;

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
// between samples, 0 for held rows; `sway`: what of the constant part a robot may consume that is not
// its model; `alpha1`: (4,).
inline Shortfall shortfall(Vector<const bool> strict, Vector<const double> h, Vector<const double> margin,
                           Vector<const double> usable, Vector<const double> psi, double dip, double sway,
                           const class_k::ClassK& alpha1) {
  Shortfall short_{INFINITY, INFINITY, INFINITY, INFINITY};
  for (Index k = 0; k < strict.size; ++k) {
    if (!strict[k]) continue;
    const double kept = h[k] - margin[k] + dip, used = usable[k] + sway;
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
  bool fell = memory.news == NEWS;
  if (memory.news == COMPARED)
    fell = now.kept_at_most < memory.kept - margins::SHORT ||
           now.headway_at_most < memory.headway - margins::SHORT;
  memory.unproved = lacks(now) && (fell || memory.unproved != 0);
  memory.news = 0, memory.kept = now.kept, memory.headway = now.headway;
  const bool fast = now.headway_at_most < -margins::SHORT;
  memory.closing = fast ? memory.closing + period : 0.0;
  const bool exact = settles == 0.0 || period == 0.0;
  const bool lasts = fast && (exact || memory.closing > settles);
  return memory.unproved != 0 || now.kept_at_most < -margins::SHORT || lasts;
}

// Returns the status of a step. A guidance row that is relaxed is no violation, and an input that only
// guidance moved is SAFE. `status`: the program's; `moved`: whether u is not u*; `unsafe`: whether a
// strict h is below zero; `slack`: (m,) of the safety rows.
inline Index conclude(Index status, bool moved, bool unsafe, bool violated, Vector<const double> slack) {
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

// Returns 1 where a plant is at rest though u* requests motion, by the squares of both.
inline double stands(double speed2, double asked2) {
  return speed2 < STANDING * STANDING && asked2 > ASKING * ASKING ? 1.0 : 0.0;
}

}  // namespace hcbf::status
