// Gaits as data, and the clock that says which foot stands.
#pragma once
#include <hcbf/rotation.hpp>

namespace hcbf::gait {

constexpr double EARLY_TOUCHDOWN = 0.6;  // share of the swing after which a touching foot becomes stance
constexpr double RESTING = -1.0;         // what the clock shows while all feet are held down
// share of the period by which a switch may come early: a sum of ticks is rounded, and without this
// a foot would swing a tick longer in some strides than in others
constexpr double ROUNDING = 1e-6;

struct Gait {
  double period;      // of a stride [s]
  double duty;        // share of the period that a foot stands
  double offsets[4];  // phase of FR, FL, RR, RL at time zero; a foot stands while its phase is below duty
  bool rests;         // whether all feet stay down while nothing is asked and nothing disturbs
  double max_speed;   // up to which it walks well [m/s]
};

struct FootPhases {
  bool stance[4];       // feet that carry
  double remaining[4];  // until touchdown, 0 for feet in stance [s]
};

// What each foot does at `clock` [s], given which feet touch.
inline FootPhases foot_phases(const Gait& gait, double clock, const bool* contact) {
  FootPhases phases = {{true, true, true, true}, {0.0, 0.0, 0.0, 0.0}};
  if (clock < 0.0) return phases;
  for (int foot = 0; foot < 4; ++foot) {
    const double phase = rotation::remainder(clock / gait.period + gait.offsets[foot] + ROUNDING, 1.0);
    const double swung = (phase - gait.duty) / (1.0 - gait.duty);
    if (swung < 0.0 || (contact[foot] && swung > EARLY_TOUCHDOWN)) continue;
    phases.stance[foot] = false;
    phases.remaining[foot] = (1.0 - phase) * gait.period;
  }
  return phases;
}

// The clock [s] one tick later. A gait that rests starts to step at once when it is no longer quiet,
// and stops only where a pair of feet has just landed.
inline double advance_clock(const Gait& gait, double clock, bool quiet, double dt) {
  if (clock < 0.0) return quiet ? RESTING : 0.0;
  const double before = clock / gait.period + ROUNDING;
  const double after = (clock + dt) / gait.period + ROUNDING;
  const bool landed = rotation::quotient(after, 0.5) > rotation::quotient(before, 0.5);
  return gait.rests && quiet && landed ? RESTING : clock + dt;
}

}  // namespace hcbf::gait
