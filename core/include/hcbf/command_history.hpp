// What a robot was commanded, and what its response makes of it: the velocity v̂, and what of the way is
// unknown. `response_monitor` has the law; here v̂ follows the commands, and v_b does so within the
// robot's braking.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/arrays.hpp>

namespace hcbf::command_history {

constexpr Index WINDOWS = 7;  // each twice as long as the one before
constexpr Index HELD = 256;   // commands that are remembered: the delay's worth of the fastest controller

struct Notes {
  double told_at[HELD];       // [s]
  double told[HELD][3];       // what they lead to: gain × command, in the plane [m/s], turning
  Index ends[HELD];           // whether it is the end of a command that was not renewed
  Index count;                // of all commands
  Index acting;               // the number of the one that acts
  double velocity[2];         // v̂ in the robot's axes [m/s]
  double braked[2];           // v_b in the robot's axes [m/s]
  double place[3];            // x, y [m] and heading [rad] at the last sample
  double time;                // of it [s]
  Index begun;                // whether there is one
  double missed[WINDOWS][2];  // r [m]
  double moved[WINDOWS];      // m [m]
  double doubt[WINDOWS];      // d [m]
  double apart[WINDOWS][2];   // q [m]
  double widest[WINDOWS];     // the greatest ‖q‖ of late [m]
  double seen[WINDOWS];       // w [s]
  double missing[2][2];       // c [m²/s]
  double asked[2];            // E [m²/s]
  double hidden[2];           // d of it [m²/s]
  double worst;               // the greatest share of a bound at the last sample

  // When and what the command of a number was, and whether it ends one.
  double& at(Index number) { return told_at[number % HELD]; }
  double* moves(Index number) { return told[number % HELD]; }
  Index& is_end(Index number) { return ends[number % HELD]; }
};

struct Law {
  double tau;        // [s]
  double delay;      // δ [s]
  double first;      // W₀ [s]
  double most;       // K S [m/s]
  double lasting;    // D [m/s]
  double share;      // a
  double braking;    // how hard a stop brakes [m/s²]
  double overshoot;  // by how much the speed exceeds all commands [m/s]
  double arc;        // A; 0 of a robot that was measured
  double forward;    // the greatest speed that the robot may be commanded [m/s]
};

struct Way {
  double ahead, aside;  // in the robot's axes [m]
};

// Notes what a robot is commanded from a time on [s], or that a command ends then. `moves` (3,): what it
// leads to, gain × command, in the plane [m/s] and turning [rad/s]; `ends`: whether it is the end of a
// command that was not renewed.
inline void tell(Notes& note, const double* moves, double time, bool ends) {
  while (note.count > 0 && note.at(note.count - 1) >= time - 1e-9) note.count -= 1;  // revoked
  note.acting = std::min(note.acting, note.count);
  note.at(note.count) = time, note.is_end(note.count) = ends;
  std::copy_n(moves, 3, note.moves(note.count));
  note.count += 1;
}

// Lets v_b be where it is farther from the command that begins to act. Where the one before was not
// renewed in time, the robot may have gone on by it, or have braked.
inline void renew(Notes& note, const Law& law, Index acting, double* velocity) {
  if (acting < 2) return;
  const Index last = acting - 1, end = acting - 2;
  if (note.is_end(last) != 0 || note.is_end(end) == 0) return;
  const double speed = std::hypot(velocity[0], velocity[1]);
  const double lost = law.braking * (note.at(last) - note.at(end));
  const double left = std::max(0.0, 1.0 - lost / std::max(speed, 1e-9));
  const double x = note.moves(last)[0], y = note.moves(last)[1];
  const double goes_on = std::hypot(x - velocity[0], y - velocity[1]);
  if (std::hypot(x - left * velocity[0], y - left * velocity[1]) > goes_on)
    velocity[0] *= left, velocity[1] *= left;
}

// Lets v_b (`velocity`, written to) follow what acts for a time `span` [s], and returns what is unknown of
// the way meanwhile [m]. `acting`: how many commands act, or have acted; `went`: ∫v̂ dt over it.
inline double doubt_of(Notes& note, const Law& law, Index acting, double span, Way went, double* velocity) {
  double x = 0.0, y = 0.0;
  if (acting > 0) {
    const Index last = acting - 1;
    x = note.moves(last)[0], y = note.moves(last)[1];
    if (note.is_end(last) != 0 && acting > 1) {  // it may still follow the one before
      const double* before = note.moves(acting - 2);
      return std::hypot(before[0], before[1]) * span;
    }
  }
  const double tau = std::max(law.tau, 1e-6);
  const double behind = std::hypot(x - velocity[0], y - velocity[1]);
  const double most = law.braking * tau;  // behind by no more it need not brake harder
  const double braking = std::min(span, std::max(0.0, behind - most) / law.braking);
  const double left = (behind - law.braking * braking) * std::exp(-(span - braking) / tau);
  double late = (behind - 0.5 * law.braking * braking) * braking;
  late += tau * (behind - law.braking * braking - left);
  const double to_x = (x - velocity[0]) / std::max(behind, 1e-9);
  const double to_y = (y - velocity[1]) / std::max(behind, 1e-9);
  velocity[0] = x - left * to_x, velocity[1] = y - left * to_y;
  const double off = std::hypot(went.ahead - x * span + late * to_x, went.aside - y * span + late * to_y);
  return off + law.overshoot * braking;
}

// Lets the commands act that a robot follows by now [s].
inline void act(Notes& note, const Law& law, double now) {
  note.acting = std::max(note.acting, note.count - HELD);
  while (note.acting < note.count && note.at(note.acting) + law.delay <= now + 1e-9) {
    note.acting += 1;
    renew(note, law, note.acting, note.braked);
  }
}

// Lets v̂ and v_b begin with a velocity that was measured now, in the robot's axes.
inline void begin(Notes& note, const Law& law, double now, Way velocity) {
  act(note, law, now);
  note.velocity[0] = note.braked[0] = velocity.ahead;
  note.velocity[1] = note.braked[1] = velocity.aside;
}

// ∫c dt, where a robot without τ and δ moves from a time to another.
inline Way at_once(Notes& note, double start, double end) {
  Index k = note.count;
  const Index least = std::max<Index>(0, note.count - HELD);
  while (k > least && note.at(k - 1) > start + 1e-9) k -= 1;
  Way way{0.0, 0.0};
  double now = start;
  while (now < end) {
    const double until = k < note.count ? std::min(end, note.at(k)) : end;
    if (k > least) {
      way.ahead += note.moves(k - 1)[0] * (until - now);
      way.aside += note.moves(k - 1)[1] * (until - now);
    }
    now = until;
    k += 1;
  }
  return way;
}

struct Followed {
  Way way;        // ∫v̂ dt [m]
  double length;  // ∫‖v̂‖ dt [m]
  double doubt;   // what is unknown: of commands not renewed, and of those beyond the robot's braking [m]
};

// Lets v̂ follow the commands from a time to another.
inline Followed follow(Notes& note, const Law& law, double start, double end) {
  const double tau = std::max(law.tau, 1e-6);
  Followed all{{0.0, 0.0}, 0.0, 0.0};
  double now = start;
  while (now < end) {
    act(note, law, now);
    double until = end;
    if (note.acting < note.count) until = std::min(end, note.at(note.acting) + law.delay);
    double forward = 0.0, sideways = 0.0;
    if (note.acting > 0) forward = note.moves(note.acting - 1)[0], sideways = note.moves(note.acting - 1)[1];
    const double span = until - now, left = std::exp(-span / tau);
    const double x = note.velocity[0] - forward, y = note.velocity[1] - sideways;
    const Way went{forward * span + x * tau * (1.0 - left), sideways * span + y * tau * (1.0 - left)};
    all.way.ahead += went.ahead;
    all.way.aside += went.aside;
    all.length += std::hypot(went.ahead, went.aside);
    all.doubt += doubt_of(note, law, note.acting, span, went, note.braked);
    note.velocity[0] = forward + x * left, note.velocity[1] = sideways + y * left;
    now = until;
  }
  return all;
}

}  // namespace hcbf::command_history
