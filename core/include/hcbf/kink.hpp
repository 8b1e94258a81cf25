// One kink of a sum of one-sided penalties: its minimum, and where the cost falls from there.
//
// The kink of a row is the line a u = b - m inside a cell. It leaves the cell at a point A and
// enters it at a point B:
//
//              last up * A * first down
//      n u > d         | |         n u < d        (counter-clockwise from B to A above,
//             first up * B * last down             from A to B below)
#pragma once
#include <hcbf/program_records.hpp>

namespace hcbf::kink {

using namespace program_records;
using polygon::Corners;

// The part of a kink that is in a cell, from A to B = A + (dx, dy).
template <class Number>
struct Chord {
  PointOf<Number> a, to_b;
  Index first_up = 0, last_up = 0, first_down = 0, last_down = 0;
  PointOf<Number> at(Number t) const { return {a.x + t * to_b.x, a.y + t * to_b.y}; }
};

// Returns where a line that crosses a cell does so.
template <class Number>
Chord<Number> chord_of(Corners<Number> cell, const LineOf<Number>& line) {
  Chord<Number> chord{};
  for (Index i = 0; i < cell.size; ++i) {
    const Index j = i + 1 < cell.size ? i + 1 : 0;
    const bool here = line.above(cell[i]) > 0.0, there = line.above(cell[j]) > 0.0;
    if (here && !there) chord.last_up = i, chord.first_down = j;
    if (there && !here) chord.last_down = i, chord.first_up = j;
  }
  const auto crossing = [&](const PointOf<Number>& start, const PointOf<Number>& end) {
    const Number here = line.above(start), there = line.above(end);
    return polygon::between(start, end, here / (here - there));
  };
  chord.a = crossing(cell[chord.last_up], cell[chord.first_down]);
  const PointOf<Number> b = crossing(cell[chord.last_down], cell[chord.first_up]);
  chord.to_b = {b.x - chord.a.x, b.y - chord.a.y};
  return chord;
}

template <class Number>
struct Slopes {
  Number forward, backward;
};

// Returns half the directional derivatives of the cost at u towards d and towards -d.
//
// A row at its kink pays if the direction leads into its violation. Where it has no least slack,
// nothing jumps there, and what little it pays counts: it may hold back a flatter row.
template <class Number>
Slopes<Number> slopes(const PointOf<Number>& u, const PointOf<Number>& d, const CostOf<Number>& cost,
                      double radius) {
  Number forward = cost.lambda_u * ((u.x - cost.u_nominal.x) * d.x + (u.y - cost.u_nominal.y) * d.y);
  Number backward = -forward;
  for (const RowOf<Number>& row : cost.rows) {
    if (row.state == State::MET) continue;
    const Number gain = row.value(d), lack = row.lack(u), over = lack - row.least;
    const Number rounding = row.least > 0.0 ? tolerances::THIN * radius * (abs(row.a.x) + abs(row.a.y))
                                            : tolerances::SURELY_MET * (abs(row.b) + row.norm * radius);
    if (row.state == State::PAID || over > rounding) {
      forward -= row.weight * lack * gain;
      backward += row.weight * lack * gain;
    } else if (over > -rounding) {
      forward -= row.weight * row.least * min(gain, 0.0);
      backward += row.weight * row.least * max(gain, 0.0);
    }
  }
  return {forward, backward};
}

// Where on the kink its minimum is.
enum class Place { INSIDE, AT_A, AT_B };

template <class Number>
struct Least {
  Number t;  // from 0 at A to 1 at B
  Place place;
};

// Returns the minimiser on a chord.
template <class Number>
Least<Number> minimise_along(const Chord<Number>& chord, Index own, const CostOf<Number>& cost,
                             double radius) {
  const auto slopes_at = [&](Number t) { return slopes(chord.at(t), chord.to_b, cost, radius); };
  Number start = slopes_at(0.0).forward;
  if (start >= 0.0) return {0.0, Place::AT_A};
  Number end = slopes_at(1.0).backward;
  if (end >= 0.0) return {1.0, Place::AT_B};
  Number low = 0.0, high = 1.0;
  for (Index k = 0; k < cost.rows.size; ++k) {
    const RowOf<Number>& row = cost.rows[k];
    const Number gain = row.value(chord.to_b);
    if (k == own || row.state != State::OPEN || gain == 0.0) continue;
    const Number t = row.excess(chord.a) / gain;
    if (!(low < t && t < high)) continue;
    const auto [forward, backward] = slopes_at(t);
    if (forward < 0.0)
      low = t, start = forward;
    else if (backward < 0.0)
      high = t, end = backward;
    else
      return {t, Place::INSIDE};
  }
  // between two neighbouring kinks the slope is a straight line
  return {start + end < 0.0 ? low + (high - low) * start / (start + end) : low, Place::INSIDE};
}

// Returns the cell's next corner from A or B on the side `sign` of a kink: the first whose
// sign n u exceeds sign d by more than rounding.
template <class Number>
PointOf<Number> along_border(Corners<Number> cell, const LineOf<Number>& line, const Chord<Number>& chord,
                             bool at_a, int sign, double radius) {
  Index corner = at_a ? (sign > 0 ? chord.last_up : chord.first_down)
                      : (sign > 0 ? chord.first_up : chord.last_down);
  const Index step = at_a == (sign > 0) ? cell.size - 1 : 1;
  for (Index tried = 0; tried < cell.size; ++tried) {
    if (sign * line.above(cell[corner]) > tolerances::THIN * radius) break;
    corner = (corner + step) % cell.size;
  }
  return cell[corner];
}

// Returns whether the slope of an open row's cost jumps at a point.
template <class Number>
bool kinks_at(const RowOf<Number>& row, const PointOf<Number>& u, double radius) {
  if (row.state != State::OPEN || row.least == 0.0) return false;
  return abs(row.value(u) - row.b + row.least) <= tolerances::THIN * radius * row.norm;
}

// Returns whether the direction e leads from a point on the border into the cell.
template <class Number>
bool enters(Corners<Number> cell, const PointOf<Number>& u, const PointOf<Number>& e, double thin) {
  for (Index i = 0; i < cell.size; ++i) {
    const PointOf<Number> from = cell[i], to = cell[i + 1 < cell.size ? i + 1 : 0];
    const Number x = to.x - from.x, y = to.y - from.y, length = hypot(x, y);
    const Number distance = (x * (u.y - from.y) - y * (u.x - from.x)) / length;
    if (distance <= thin && x * e.y - y * e.x < -tolerances::OUTWARD * length) return false;
  }
  return true;
}

template <class Number>
struct Settled {
  PointOf<Number> u;   // the minimiser on the kink
  int side;  // 1 or -1 where the cost falls towards n u above or below d, 0 for neither
};

// Minimises on the kink of row `own`, and finds where the cost falls from there. The kink crosses
// the cell; the other rows' states are known to be PAID or MET, or OPEN.
template <class Number>
Settled<Number> settle(Corners<Number> cell, const LineOf<Number>& line, Index own,
                       const CostOf<Number>& cost, double radius) {
  const Chord<Number> chord = chord_of(cell, line);
  const auto [t, place] = minimise_along(chord, own, cost, radius);
  const PointOf<Number> u = chord.at(t);
  Number steepest = 0.0;
  int side = 0;
  const auto descends = [&](const PointOf<Number>& e, int sign) {
    const Number slope = slopes(u, e, cost, radius).forward;
    if (slope < steepest) steepest = slope, side = sign;
  };
  for (const int sign : {1, -1}) {
    PointOf<Number> e{sign * line.n.x, sign * line.n.y};
    if (place != Place::INSIDE) {
      const PointOf<Number> corner = along_border<Number>(cell, line, chord, place == Place::AT_A, sign, radius);
      const Number length = hypot(corner.x - u.x, corner.y - u.y);
      e = {(corner.x - u.x) / length, (corner.y - u.y) / length};
    }
    descends(e, sign);
    for (Index k = 0; k < cost.rows.size; ++k) {
      const RowOf<Number>& row = cost.rows[k];
      if (k == own || !kinks_at(row, u, radius)) continue;
      e = {-row.a.y / row.norm, row.a.x / row.norm};
      const Number along = sign * polygon::dot(e, line.n);
      if (abs(along) <= tolerances::THIN) continue;
      if (along < 0.0) e = {-e.x, -e.y};
      if (place == Place::INSIDE || enters(cell, u, e, tolerances::THIN * radius)) descends(e, sign);
    }
  }
  return {u, side};
}

}  // namespace hcbf::kink
