// Does a robot follow its commands? Its measured response predicts where it should have moved.
//
// In the robot's own axes the response turns commands into a velocity v̂. Over every sample of length T,
// with Δp the motion of the point that follows, for windows W that double from W₀,
//   r ← (1 − T/W) r + Δp − ∫v̂ dt,   m ← (1 − T/W) m + ∫‖v̂‖ dt,   w ← (1 − T/W) w + T,
// and the alarm is raised where in any window ‖r‖ > D w + (K S − D) min(√(W₀ w), 2 W₀) + a m + d. Of an
// unmeasured robot the distance of r from the line to q ← (1 − T/W) q + ∫(c − v̂) dt is compared, and the
// bound grows by A ‖q‖. Over longer windows, with e the mean residual of a sample and J the quarter turn,
//   c ← (1 − T/W) c + T (e·v̂, e·Jv̂),   E ← (1 − T/W) E + T ‖v̂‖²,
// and the alarm is raised where in both ‖c‖ > a E + k K S √(W₀ E) + d'. `robots.response_monitor` has why.
#pragma once
#include <hcbf/command_history.hpp>

namespace hcbf::response_monitor {

using command_history::HELD;
using command_history::Law;
using command_history::Notes;
using command_history::Way;
using command_history::WINDOWS;

constexpr double SWAYS = 2.0;     // over how many W₀ sway adds up
constexpr double FAST = 0.25;     // of the greatest speed: legs that are commanded less may stand
constexpr double COMPARED[2][2] = {{4.0, 16.0}, {1.0, 4.0}};  // windows [s], and at least so many W₀
constexpr double APART = 0.6;     // k: sway that is no answer to commands hardly correlates with them
constexpr double FILLED = 0.6;    // share of the shortest window that must have been seen
constexpr double PAUSE = 0.5;     // between two samples, forth or back, after which all starts anew [s]
constexpr double LEAP = 0.2;      // that a position may be off within one sample [m] …
constexpr double FASTEST = 3.0;   // … beside so many times the greatest speed: beyond, it was put elsewhere
constexpr double CARRIED = 0.05;  // over which a propagated robot turns around the mean of its headings [s]
constexpr double TURN = 6.283185307179586;

// What a robot's motion may be off over a time `seen` [s], in which its way was `moved` long [m].
inline double bound(const Law& law, double seen, double moved) {
  const double swaying = std::min(std::sqrt(law.first * seen), SWAYS * law.first);
  return law.lasting * seen + std::max(0.0, law.most - law.lasting) * swaying + law.share * moved;
}

// Adds a sample to r and q of every window, and returns the greatest share of its bound.
inline double strays(Notes& note, const Law& law, Way off, Way apart, double length, double passed,
                     double doubt, double noise) {
  double worst = 0.0, window = law.first;
  for (Index i = 0; i < WINDOWS; ++i, window *= 2.0) {
    const double keep = std::max(0.0, 1.0 - passed / window);
    double *r = note.missed[i], *q = note.apart[i];
    r[0] = keep * r[0] + off.ahead, r[1] = keep * r[1] + off.aside;
    note.moved[i] = keep * note.moved[i] + length;
    note.doubt[i] = keep * note.doubt[i] + doubt;
    note.seen[i] = keep * note.seen[i] + passed;
    q[0] = keep * q[0] + apart.ahead, q[1] = keep * q[1] + apart.aside;
    note.widest[i] = std::max(std::hypot(q[0], q[1]), keep * note.widest[i]);
    if (note.seen[i] < FILLED * law.first) continue;
    double most = bound(law, note.seen[i], note.moved[i]) + note.doubt[i] + noise, near = 0.0;
    if (note.widest[i] > 0.0) {
      const double along = (r[0] * q[0] + r[1] * q[1]) / std::max(q[0] * q[0] + q[1] * q[1], 1e-12);
      near = std::min(1.0, std::max(0.0, along));
      most += law.arc * note.widest[i];
    }
    worst = std::max(worst, std::hypot(r[0] - near * q[0], r[1] - near * q[1]) / most);
  }
  return worst;
}

// Adds a sample to c of both windows, and returns the lesser share of the bound.
inline double differs(Notes& note, const Law& law, Way off, Way went, double passed, double hidden,
                      double noise) {
  const double least = FAST * law.forward;
  const bool told = std::hypot(went.ahead, went.aside) > least * passed;
  const double along = off.ahead * went.ahead + off.aside * went.aside;
  const double across = off.aside * went.ahead - off.ahead * went.aside;
  double worst = INFINITY;
  for (Index i = 0; i < 2; ++i) {
    const auto [seconds, times] = COMPARED[i];
    const double keep = std::max(0.0, 1.0 - passed / std::max(seconds, times * law.first));
    double* missing = note.missing[i];
    missing[0] = keep * missing[0], missing[1] = keep * missing[1];
    note.asked[i] = keep * note.asked[i], note.hidden[i] = keep * note.hidden[i] + hidden;
    if (told) {
      missing[0] += along / passed;
      missing[1] += across / passed;
      note.asked[i] += (went.ahead * went.ahead + went.aside * went.aside) / passed;
    }
    if (note.asked[i] < least * least * law.first / APART)
      return 0.0;  // the shorter window begins where the longer one has seen enough
    const double most = law.share * note.asked[i] + APART * law.most * std::sqrt(law.first * note.asked[i]);
    const double off_by = std::hypot(missing[0], missing[1]);
    worst = std::min(worst, off_by / (most + note.hidden[i] + noise * law.forward));
  }
  return worst;
}

// Starts anew at a pose that was noted, with the velocity (2,) in the world that was measured there.
inline void start(Notes& note, const Law& law, double heading, const double* velocity, double time,
                  double noise) {
  const double cos = std::cos(heading), sin = std::sin(heading), vx = velocity[0], vy = velocity[1];
  command_history::begin(note, law, time, {cos * vx + sin * vy, cos * vy - sin * vx});
  std::fill_n(note.missed[0], 2 * WINDOWS, 0.0), std::fill_n(note.moved, WINDOWS, 0.0);
  std::fill_n(note.seen, WINDOWS, 0.0), std::fill_n(note.missing[0], 4, 0.0), std::fill_n(note.asked, 2, 0.0);
  std::fill_n(note.doubt, WINDOWS, 2.0 * noise);  // of the place where r begins
  std::fill_n(note.hidden, 2, 0.0);
  std::fill_n(note.apart[0], 2 * WINDOWS, 0.0), std::fill_n(note.widest, WINDOWS, 0.0);
}

// Compares a sample with what the robot was commanded, and returns whether that alarms. `pose` (3,): of
// the point that follows; `velocity` (2,): of it in the world; `noise`: what a position may be off [m].
inline bool observe(Notes& note, const Law& law, const double* pose, const double* velocity, double time,
                    double noise) {
  const double passed = time - note.time;
  if (note.begun && -PAUSE < passed && passed <= 0.0) return false;
  double turn = pose[2] - note.place[2];
  turn -= TURN * std::nearbyint(turn / TURN);
  const double middle = note.place[2] + 0.5 * turn, cos = std::cos(middle), sin = std::sin(middle);
  const double dx = pose[0] - note.place[0], dy = pose[1] - note.place[1];
  const double ahead = cos * dx + sin * dy, aside = cos * dy - sin * dx;
  const bool leap = std::hypot(ahead, aside) > LEAP + FASTEST * law.forward * passed;
  const bool known = note.begun == 1 && 0.0 < passed && passed <= PAUSE && !leap;
  std::copy_n(pose, 3, note.place);
  const double began = note.time;
  note.time = time, note.begun = 1;
  if (!known) {
    start(note, law, pose[2], velocity, time, noise);
    return false;
  }
  const double forward = note.velocity[0], sideways = note.velocity[1];
  const auto [went, length, doubt] = command_history::follow(note, law, began, time);
  double speed = std::hypot(forward, sideways);
  // the last command, and its end
  for (Index last = std::max<Index>(0, note.count - 2); last < note.count; ++last)
    speed = std::max(speed, std::hypot(note.moves(last)[0], note.moves(last)[1]));
  Way apart{0.0, 0.0};
  double hidden = doubt;
  if (law.arc > 0.0) {
    const Way moved = command_history::at_once(note, began, time);
    apart = {moved.ahead - went.ahead, moved.aside - went.aside};
    hidden += std::hypot(apart.ahead, apart.aside) + law.lasting * passed;
  }
  const Way off{ahead - went.ahead, aside - went.aside};
  const double strayed = strays(note, law, off, apart, length, passed, doubt, noise);
  const double differed = differs(note, law, off, went, passed, hidden * speed, noise);
  note.worst = std::max(strayed, differed);
  return note.worst > 1.0;
}

// Writes where the commands have brought a robot, and returns what that may be off [m]. `ahead`: of the
// point that follows before the centre [m]; `pose` (3,) and `twist` (3,): of the centre, at the time
// `since`; `now`: the present [s].
inline double carry(Notes& note, const Law& law, double ahead, double* pose, double* twist, double since,
                    double now) {
  const double tau = std::max(law.tau, 1e-6);
  const Index least = std::max<Index>(0, note.count - HELD);
  Index acting = note.count;
  while (acting > least && note.at(acting - 1) + law.delay > since + 1e-9) acting -= 1;
  double time = since, told[3] = {}, moved[3] = {}, braked[2] = {twist[0], twist[1] + ahead * twist[2]};
  double length = 0.0, doubt = 0.0;
  while (time < now) {
    while (acting < note.count && note.at(acting) + law.delay <= time + 1e-9) {
      acting += 1;
      command_history::renew(note, law, acting, braked);
    }
    double until = std::min(now, time + CARRIED);
    if (acting < note.count) until = std::min(until, note.at(acting) + law.delay);
    if (acting > 0) {
      std::copy_n(note.moves(acting - 1), 3, told);
      told[1] -= ahead * told[2];  // of the centre
    }
    const double span = until - time, left = std::exp(-span / tau);
    for (int k = 0; k < 3; ++k) {
      const double off = twist[k] - told[k];
      moved[k] = told[k] * span + off * tau * (1.0 - left), twist[k] = told[k] + off * left;
    }
    const double middle = pose[2] + 0.5 * moved[2], cos = std::cos(middle), sin = std::sin(middle);
    pose[0] += cos * moved[0] - sin * moved[1];
    pose[1] += sin * moved[0] + cos * moved[1];
    pose[2] += moved[2];
    const Way went{moved[0], moved[1] + ahead * moved[2]};
    length += std::hypot(went.ahead, went.aside);
    doubt += command_history::doubt_of(note, law, acting, span, went, braked);
    time = until;
  }
  return bound(law, now - since, length) + doubt;
}

}  // namespace hcbf::response_monitor
