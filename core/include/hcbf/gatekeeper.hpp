// The gatekeeper: an input is accepted if a verified manoeuvre follows it; docs/gatekeeper.md proves why.
//
// The program with the rows of ranks 2 and lower proposes an input. For r from the lowest rank to 1,
// manoeuvres that satisfy ranks 1 to r are looked for: one that follows the proposal; or the input of all
// rows, so that the robot slides along a region; or one that follows the state at once. From those the
// input nearest to the proposal is found by bisection, each of them verified. Where none satisfies rank 1,
// the rows of all strict conditions decide.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/cascade.hpp>
#include <hcbf/clearance.hpp>
#include <hcbf/conclusion.hpp>
#include <hcbf/manoeuvres.hpp>
#include <hcbf/margins.hpp>
#include <hcbf/plants.hpp>
#include <hcbf/rotation.hpp>

namespace hcbf::gatekeeper {

using manoeuvres::State, plants::Constants, plants::One, plants::Work, polygon::Point,
    program_records::Settings;

constexpr double DURATIONS[] = {0.1, 0.25, 0.5, 1.0};  // of an acceleration [s]
constexpr double HAIR = 1e-6;    // what is reserved for rounding [m], [m/s]
constexpr double BELOW = 1e-9;   // the share by which manoeuvres stay below a speed limit
constexpr int HALVINGS = 5;      // of the way to the proposal

// What manoeuvres of one sample are verified against.
struct Gate {
  const One& p;
  manoeuvres::Plant plant;
  Reserve reserve;
  double time;    // of the sample [s]
  double brakes;  // the deceleration that U has in every direction [m/s²]
  Index directions, laws;  // k, and how many laws are the user's
  Index rank;     // through which rank conditions are satisfied
  const double* h;  // (m,) at the sample
  bool eases;       // whether a robot that is nearer than m_accept may leave, if it comes no nearer
  mutable Index suspect;  // the condition that failed last: it fails the next manoeuvre most likely
};

// What a state is on: a manoeuvre that goes on, an input that is to be accepted, or what follows that.
enum Phase { GOES_ON, HELD, AFTER };

// What is reserved at a sample, for the errors of the state at it and at the next one.
inline Reserve reserve_of(const Constants& c, const plants::Plant& plant) {
  const Uncertainty& s = c.uncertainty;
  const Matrix<const double> covariance{plant.covariance[0], 4, 4};
  const double slip = std::hypot(plant.lag[2], plant.lag[3]), lead = std::hypot(plant.lag[0], plant.lag[1]);
  const double tracking = std::min(s.cap, s.per_velocity * slip + s.per_lead * lead);
  const double most = margins::most(s, {plant.x, plant.time, plant.model, plant.lag, covariance, plant.growth});
  const double spread = margins::reserved(s, std::sqrt(margins::largest(covariance, 0)));
  const double variance = margins::largest(covariance, 2);
  const auto vague = [&](double growth) { return margins::reserved(s, std::sqrt(variance + growth)); };
  const auto fast = [&](double growth) { return (plant.has_model != 0 ? 0.0 : c.velocity_error) + vague(growth); };
  const double speed = margins::of_speed(s, plant.lag, covariance) + vague(plant.growth) - vague(0.0);
  const double now = c.period * fast(plant.growth), next = c.period * fast(2.0 * plant.growth);
  return {most - s.cap + tracking + now,
          s.cap - tracking + 2.0 * (c.position_error + spread + now) + next + c.period * slip + HAIR,
          2.0 * fast(plant.growth) + HAIR, speed, vague(2.0 * plant.growth) - vague(plant.growth)};
}

inline bool is_speed_limit(const One& p, Index k) { return p.kind[k] == layout::SPEED_LIMIT; }

// Whether a gate verifies condition k.
inline bool is_due(const Gate& g, Index k) {
  const bool known = shape_terms::is_region(g.p.kind[k]) || is_speed_limit(g.p, k);
  return known && 1 <= g.p.priority[k] && g.p.priority[k] <= g.rank;
}

// The speed that a limit leaves to a manoeuvre that goes on, or to an input that is to be accepted [m/s];
// negative for none.
inline double allowed(const Gate& g, Index k, bool goes_on) {
  const Reserve& reserve = g.reserve;
  const double limit = g.p.parameters(k, layout::V_MAX);
  const double margin = reserve.speed + g.p.own_margin[k] + (goes_on ? 0.0 : reserve.faster);
  return std::sqrt(std::max(0.0, limit * (limit - 2.0 * margin))) - (goes_on ? 0.0 : reserve.drift);
}

// The least that is left to what is to be accepted [m/s], at least 0; infinite without a limit.
inline double fastest_of(const Gate& g) {
  double fastest = INFINITY;
  for (Index k = 0; k < g.p.kind.size; ++k)
    if (is_due(g, k) && is_speed_limit(g.p, k))
      fastest = std::min(fastest, std::max(0.0, allowed(g, k, false)));
  return fastest;
}

// The input that leads to the velocity nearest to that of `u` within the strict speed limits.
inline Point slowed(const Gate& g, const double* x, const Point& u) {
  const double vx = x[2] + u.x * g.plant.period, vy = x[3] + u.y * g.plant.period;
  const double speed = std::hypot(vx, vy), share = (1.0 - BELOW) * fastest_of(g) / speed;
  if (!(share < 1.0)) return u;
  const Point slower{(share * vx - x[2]) / g.plant.period, (share * vy - x[3]) / g.plant.period};
  return polygon::nearest<double>(g.plant.corners, slower);
}

// The path from x (4,) at a time in the frame of region k, which rests from its end on.
inline clearance::Path seen(const One& p, Index k, const double* x, const Point& u, double at, double span) {
  const double *c = p.parameters[k].data, end = p.ends.size > 0 ? p.ends[k] : INFINITY;
  const double since = std::min(at, end), moves = at < end ? 1.0 : 0.0;
  const double wx = c[layout::VELOCITY_X], wy = c[layout::VELOCITY_Y];
  return {x[0] - wx * since, x[1] - wy * since, x[2] - moves * wx, x[3] - moves * wy, u.x, u.y, span, 0.0, 0.0};
}

// Writes what is reserved of region k from a time since the sample on.
inline void reserve(const Gate& g, Index k, double since, Phase phase, clearance::Path& path) {
  const double keep = g.reserve.keep + g.p.own_margin[k];
  double more = 0.0, grows = 0.0;
  if (phase == AFTER) {
    more = g.reserve.ahead + g.reserve.drift * (since - g.plant.period), grows = g.reserve.drift;
    const double room = std::max(0.0, g.h[k] - keep);
    if (g.eases && more + grows * path.span > room) more = room, grows = 0.0;
  }
  path.margin = keep + more, path.grows = grows;
}

// Whether region k is cleared along a path at a time.
inline bool clears(const Gate& g, Index k, clearance::Path path, double at) {
  const double *c = g.p.parameters[k].data, span = path.span;
  const double left = g.p.ends.size > 0 ? g.p.ends[k] - at : INFINITY;
  if (left <= 0.0 || left >= span) return clearance::holds(g.p.kind[k], c, path);
  clearance::Path after = clearance::part(path, left, span - left);
  after.rx += c[layout::VELOCITY_X], after.ry += c[layout::VELOCITY_Y];
  path.span = left;
  return clearance::holds(g.p.kind[k], c, path) && clearance::holds(g.p.kind[k], c, after);
}

// Some of the conditions.
struct Some {
  Index first, end;
};

// Whether conditions hold while an input is held from a state on.
inline bool hold(const Gate& g, const State& state, const Point& u, double span, Phase phase, Some some) {
  const double *x = state.x, at = g.time + state.since;
  const auto is_slow = [&](double most, double after) {
    const double vx = x[2] + u.x * after, vy = x[3] + u.y * after;
    return most >= 0.0 && vx * vx + vy * vy <= most * most;
  };
  for (Index k = some.first; k < some.end; ++k) {
    if (!is_due(g, k)) continue;
    g.suspect = k;
    if (is_speed_limit(g.p, k)) {
      const double most = allowed(g, k, phase == GOES_ON);  // between the two a speed is no greater
      if (!(is_slow(most, std::min(span, g.plant.period)) && is_slow(most, span))) return false;
    } else {
      clearance::Path path = seen(g.p, k, x, u, at, span);
      reserve(g, k, state.since, phase, path);
      if (!clears(g, k, path, at)) return false;
    }
  }
  return true;
}

// Whether no region sweeps the place of a state at rest.
inline bool is_free(const Gate& g, const State& state, Phase phase, Some some) {
  // with an error of its velocity a robot is at rest so much later
  const double later = g.plant.period * std::ceil(g.reserve.drift / (g.brakes * g.plant.period));
  const double at = g.time + state.since, x[4] = {state.x[0], state.x[1], 0.0, 0.0};
  for (Index k = some.first; k < some.end; ++k) {
    if (!is_due(g, k) || is_speed_limit(g.p, k)) continue;
    g.suspect = k;
    clearance::Path path = seen(g.p, k, x, {0.0, 0.0}, at, 0.0);
    reserve(g, k, state.since + later, phase, path);
    path.grows = 0.0, path.span = clearance::passed(g.p.kind[k], g.p.parameters[k].data, path);
    if (!clears(g, k, path, at)) return false;
  }
  return true;
}

// Whether a manoeuvre from a state on satisfies the conditions until it rests where no region comes. Writes its
// first input: a law of the user's may answer the same question differently.
inline bool passes(const Gate& g, const Law& law, const State& state, Phase phase, Point& first) {
  const auto meets = [&](Some some) {
    State end = state;
    first = {0.0, 0.0};
    const auto held = [&](const State& at, const Point& u, double span) {
      if (at.since == state.since) first = u;
      return hold(g, at, u, span, phase, some);
    };
    return manoeuvres::follow(g.plant, law, end, held) && is_free(g, end, phase, some);
  };
  const Index count = g.p.kind.size;
  return meets({g.suspect, std::min(g.suspect + 1, count)}) && meets({0, count});
}

// Whether a manoeuvre passes after an input that is held for a period.
inline bool accepts(const Gate& g, State state, const Point& u, const Law& law) {
  if (!hold(g, state, u, g.plant.period, HELD, {0, g.p.kind.size})) return false;
  manoeuvres::move(state, u, g.plant.period);
  Point first;
  return passes(g, law, state, AFTER, first);
}

// The direction away from the nearest region, 0 where there is none.
inline Point away(const Gate& g, const State& state) {
  double nearest = INFINITY;
  Point direction{0.0, 0.0};
  for (Index k = 0; k < g.p.kind.size; ++k) {
    if (!is_due(g, k) || is_speed_limit(g.p, k)) continue;
    const clearance::Path path = seen(g.p, k, state.x, {0.0, 0.0}, g.time, 0.0);
    const auto at = shapes::jet(g.p.kind[k], g.p.parameters[k].data, path.x, path.y);
    if (at.h < nearest) nearest = at.h, direction = {at.gx, at.gy};
  }
  return direction;
}

// Tries manoeuvres from a state on until `attempt(law)` takes one: the last, brake, the user's, and
// accelerations away from the nearest region and in k directions.
template <class Attempt>
bool any(const Gate& g, const State& state, const Attempt& attempt) {
  const Memory& known = g.p.plant.verified;
  if (known.rank > 0 && attempt(known.law)) return true;
  if (attempt(Law{})) return true;
  for (Index i = 0; i < g.laws; ++i)
    if (attempt(Law{{0.0, 0.0}, 0, i + 1, 0})) return true;
  const double fastest = fastest_of(g);
  const double speed = std::hypot(state.x[2], state.x[3]), period = g.plant.period;
  const Point aside = away(g, state);
  for (const double duration : DURATIONS) {
    const Index samples = std::max<Index>(1, std::lround(duration / period));
    const double size = (1.0 - BELOW) * std::min(fastest, speed + g.brakes * period * samples);
    if (attempt(Law{{size * aside.x, size * aside.y}, samples, 0, 0})) return true;
    for (Index i = 0; i < g.directions; ++i) {
      const double angle = 2.0 * rotation::PI * i / g.directions;
      if (attempt(Law{{size * std::cos(angle), size * std::sin(angle)}, samples, 0, 0})) return true;
    }
  }
  return false;
}

// Whether a strict region is nearer than m_keep: rows reserve nothing for the errors of a velocity. Nor do
// they read where its path ends.
inline bool is_near(Gate g) {
  g.rank = 1;
  bool near = false;
  for (Index k = 0; k < g.p.kind.size; ++k) {
    if (!is_due(g, k) || is_speed_limit(g.p, k)) continue;
    const double *c = g.p.parameters[k].data, end = g.p.ends.size > 0 ? g.p.ends[k] : INFINITY;
    const bool moves = c[layout::VELOCITY_X] != 0.0 || c[layout::VELOCITY_Y] != 0.0;
    near |= g.h[k] < g.reserve.keep + g.p.own_margin[k] || (moves && end < g.time + g.plant.period);
  }
  return near;
}

enum Found { NONE, KEPT, ACCEPTED };

// Looks for an input at one rank: the proposal or an accepted one between it and that of all rows, or the
// first one of a manoeuvre that satisfies m_keep. `law` is what follows it.
inline Found find(const Gate& g, const State& state, const Point& proposal, const Point& of_rows, Point& u,
                  Law& law) {
  const auto is_accepted = [&](const Point& input) {
    if (!hold(g, state, input, g.plant.period, HELD, {0, g.p.kind.size})) return false;
    State after = state;
    manoeuvres::move(after, input, g.plant.period);
    u = input;
    Point first;
    return any(g, state, [&](const Law& one) { return law = one, passes(g, one, after, AFTER, first); });
  };
  if (is_accepted(proposal)) return ACCEPTED;
  bool sure = is_accepted(of_rows), some = sure;
  Law kept = law;
  if (!sure) {
    any(g, state, [&](const Law& one) {  // one that its own first input leads to, if there is one
      Point begins;
      if (!passes(g, one, state, GOES_ON, begins)) return false;
      sure = accepts(g, state, begins, manoeuvres::later(one, 1));
      if (sure || !some) kept = one, u = begins;
      some = true;
      return sure || g.p.plant.verified.sure != 0;  // what was accepted goes on
    });
    if (!some) return NONE;
    law = manoeuvres::later(kept, 1);
  }
  const Point first = u;
  double low = 0.0, high = 1.0;
  for (int n = 0; n < HALVINGS; ++n) {
    const double middle = 0.5 * (low + high);
    const Point between = polygon::between<double>(first, proposal, middle);
    if (!accepts(g, state, between, kept)) {
      high = middle;
      continue;
    }
    low = middle, u = between, law = kept, sure = true;
  }
  return sure ? ACCEPTED : KEPT;
}

// The lowest rank of the conditions that a gate verifies, at least 1.
inline Index lowest(Gate g) {
  g.rank = layout::LOWEST_RANK;
  Index rank = 1;
  for (Index k = 0; k < g.p.kind.size; ++k)
    if (is_due(g, k)) rank = std::max(rank, g.p.priority[k]);
  return rank;
}

inline Gate gate_of(const Constants& c, const Settings& settings, const One& p, const manoeuvres::Own& own,
                    const Reserve& reserved, double time,
                    const double* h) {
  const Vector<const Point> corners = polygon::points(settings.vertices[0]);
  double brakes = INFINITY;
  Point from = corners[corners.size - 1];
  for (const Point& to : corners) {
    const double length = std::hypot(to.x - from.x, to.y - from.y);
    brakes = std::min(brakes, (from.x * to.y - from.y * to.x) / length), from = to;
  }
  return {p, {corners, c.period, own}, reserved, time, brakes, c.directions, c.laws, 1, h, false, 0};
}

// Writes what the rows of lower ranks pay at u, which manoeuvres satisfy through a rank.
inline void account(const Constants& c, const Gate& g, const Point& u, Work& w) {
  w.answer.u[0] = u.x, w.answer.u[1] = u.y;
  bool pays = false;
  for (Index k = 0; k < w.priority.size; ++k) {
    const double norm = std::hypot(w.a(k, 0), w.a(k, 1)), b = w.rows(rows::B, k);
    double slack = cascade::slack_of(b - w.a(k, 0) * u.x - w.a(k, 1) * u.y, norm, b, c.radius);
    if (k < g.p.kind.size && (is_due(g, k) || g.p.priority[k] <= 1)) slack = 0.0;
    w.answer.slack[k] = w.answer.delta[k] = slack;
    pays |= slack > 0.0;
  }
  using program_records::FilterStatus;
  w.answer.status = !pays ? FilterStatus::SAFE : c.ranks ? FilterStatus::RELAXED : FilterStatus::VIOLATED;
}

inline void solve(const Settings& settings, Work& w) {
  w.answer.status = cascade::filter_state<double>(
      settings, polygon::points(settings.vertices[0]), settings.weights[0], {w.u[0], w.u[1]},
      {w.a, w.rows[rows::B], w.rows[rows::H], w.priority, w.rows[rows::ALPHA2_PSI]}, w.answer.u, w.answer.slack,
      w.answer.delta, w.polygons);
}

// Proposes an input by the program without the strict rows.
inline Point propose(const Settings& settings, const One& p, Work& w) {
  const Vector<double> strict = w.other_rows[rows::B], b = w.rows[rows::B];
  std::copy_n(b.data, b.size, strict.data);
  for (Index k = 0; k < p.kind.size; ++k)
    if (p.priority[k] == 1) b[k] = -1.0 - 2.0 * settings.radius * std::hypot(w.a(k, 0), w.a(k, 1));
  solve(settings, w);
  std::copy_n(strict.data, strict.size, b.data);
  return {w.answer.u[0], w.answer.u[1]};
}

// Through which rank manoeuvres were found, and the least status of that.
struct Answer {
  Index found, least;
};

// Answers the problem of one plant, whose state is valid; `settings` as it was posed.
inline Answer filter(const Constants& c, const Settings& settings, const One& p, const manoeuvres::Own& own,
                     Work& w) {
  Memory& memory = p.plant.verified;
  const bool followed = memory.rank > 0;
  memory.lost = 0.0;
  Gate g = gate_of(c, settings, p, own, reserve_of(c, p.plant), p.plant.time, w.rows[rows::H].data);
  const Index last = lowest(g);
  Index found = 0;
  Found how = NONE;
  Point u;
  Law law{};
  const Point proposal = slowed(g, p.plant.x, propose(settings, p, w));
  solve(settings, w);
  const Point of_rows{w.answer.u[0], w.answer.u[1]};
  const State state{{p.plant.x[0], p.plant.x[1], p.plant.x[2], p.plant.x[3]}, 0.0};
  for (g.rank = p.report.reason == reason::BARRIERS ? 0 : last; found == 0 && g.rank >= 1; --g.rank) {
    how = find(g, state, proposal, of_rows, u, law);
    if (how == NONE) continue;
    found = g.rank;
    const bool rests = std::hypot(state.x[2], state.x[3]) < constants::STANDING;
    g.eases = how == KEPT && (memory.sure == 0 || rests);
    if (g.eases) find(g, state, proposal, of_rows, u, law);
  }
  memory.sure = how == ACCEPTED || (how == KEPT && memory.sure != 0);
  memory.law = law, memory.reserve = g.reserve, memory.rank = p.report.verified = g.rank = found;
  if (found > 0) {
    account(c, g, u, w);
    p.plant.judged.change = p.plant.judged.unproved = 0, p.plant.judged.closing = 0.0;
  } else if (followed) {
    p.plant.judged.change = conclusion::CHANGED;
  }
  const Index least = found == 0 ? (is_near(g) ? program_records::VIOLATED : program_records::NOMINAL)
                      : found < last ? program_records::RELAXED : program_records::NOMINAL;
  return {found, least};
}

// Adds to a plant's report what a gatekeeper found.
inline void conclude(const Answer& answer, const One& p) {
  if (answer.found == 0 && p.report.reason == 0) p.report.reason = reason::UNVERIFIED;
  p.report.status = std::max<Index>(p.report.status, answer.least);
}

// Goes on with the manoeuvre that was verified last, where no state is valid: writes its u, from the predicted
// state, with a margin that grows, at most as long as such a state counts. Else u, which brakes, stays.
inline void go_on(const Constants& c, const Settings& settings, const One& p, const manoeuvres::Own& own,
                  Vector<double> u) {
  Memory& memory = p.plant.verified;
  p.report.verified = 0;
  if (memory.rank == 0) return;
  memory.lost += p.plant.elapsed;
  Reserve reserved = memory.reserve;
  reserved.keep += reserved.drift * memory.lost;
  const Gate g = gate_of(c, settings, p, own, reserved, p.plant.accepted_at + memory.lost, nullptr);
  const State state{{p.plant.x[0], p.plant.x[1], p.plant.x[2], p.plant.x[3]}, 0.0};
  const bool lasts = p.plant.known != 0 && memory.lost <= c.longest;
  Point next;
  if (!lasts || !passes(g, memory.law, state, GOES_ON, next)) {
    memory.rank = memory.sure = 0;
    return;
  }
  memory.law = manoeuvres::later(memory.law, 1);
  u[0] = next.x, u[1] = next.y;
}

}  // namespace hcbf::gatekeeper
