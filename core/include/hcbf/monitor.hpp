// Is the plant the one that was declared? Chosen inputs and observed states show it.
//
// Input. At every sample the state's change over one period is compared with what the model makes of
// the chosen input; the difference is an input du. E <- E + (T/tau)(|du|^2 - E). The alarm counts
// samples: one that tells something, |u| > FLOOR max|u|, is missed where |du| > SHARE |u|. It is raised
// where most of the last `TELLING` such samples were missed. A plant that meets most of them to
// |du| <= EXACT |u| is exact; it alarms where more than `FEW` of them are off by OFF_EXACT |u|.
//
// Motion. With s what no input explains of the change D between samples, over every sample of length T,
//   r <- (1 - T/tau) r + s,  m <- (1 - T/tau) m + D,  m' <- (1 - T/tau) m' + D - s,
//   c <- (1 - T/tau) c + APART T |dx' - dx|,
// the alarm is raised where at `IN_A_ROW` samples |r| > rest + OFF max(|m|, |m'|) + c + kappa sqrt(tr P).
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/plants.hpp>
#include <hcbf/reason.hpp>

namespace hcbf::monitor {

constexpr double WINDOW = 0.5;         // tau [s]
constexpr double FLOOR = 0.05;         // share of the largest input below which one tells nothing
constexpr double SHARE = 0.45;         // share of the chosen input from which on it was missed
constexpr double TELLING = 25.0;       // samples over which the share of misses is averaged
constexpr double LEAST_SAMPLES = 10.0; // telling samples before which no alarm is raised
constexpr double MOST = 0.5;           // share of misses above which the alarm is raised
constexpr double EXACT = 0.02, OFF_EXACT = 0.1;  // shares up to which an input was met, and from which not
constexpr double FEW = 0.1;            // share of samples that are off above which an exact plant alarms
constexpr double REST = 0.01;          // what a position and its velocity may drift apart in any case [m]
constexpr double OFF = 0.1;            // share of the motion from which on it is another one
constexpr double APART = 0.6;          // by how much of T (dx' - dx) two integrators differ, with rounding
constexpr double IN_A_ROW = 3.0;       // samples in a row at which the motion must be off

// Counts one sample's |du|^2 and |u|^2, and returns whether most were missed. `rate`: T/tau; `radius`:
// the largest norm of an input.
inline bool account(Memory& memory, double error, double chosen, double rate, double radius) {
  memory.error += std::min(1.0, rate) * (error - memory.error);
  const double floor = FLOOR * radius;
  if (chosen > floor * floor) {
    memory.samples += 1.0;
    const double share = 1.0 / std::min(memory.samples, TELLING);
    memory.missed += share * ((error > SHARE * SHARE * chosen) - memory.missed);
    memory.exact += share * ((error <= EXACT * EXACT * chosen) - memory.exact);
    memory.off += share * ((error > OFF_EXACT * OFF_EXACT * chosen) - memory.off);
  }
  return memory.samples >= LEAST_SAMPLES && memory.missed > MOST;
}

// Returns whether a plant that meets inputs exactly has missed more than few of the last ones.
inline bool breaks_off(const Memory& memory) {
  return memory.samples >= TELLING && memory.exact > MOST && memory.off > FEW;
}

// Returns by how much sums over tau fade in a period.
inline double fade(double period) { return std::max(0.0, 1.0 - period / WINDOW); }

// Accounts for the motion of one sample, and returns whether that alarms. `off`: |r|; `moved`: the
// greater of |m| and |m'|; `change`: |dx' - dx|; `rest`: what they may be apart in any case; `spread`:
// kappa sqrt(tr P).
inline bool strays(Memory& memory, double off, double moved, double change, double rest, double spread,
                   double period) {
  memory.bend = fade(period) * memory.bend + APART * period * change;
  const double bound = rest + OFF * moved + memory.bend + spread;
  memory.in_a_row = off > bound ? memory.in_a_row + 1.0 : 0.0;
  return memory.in_a_row >= IN_A_ROW;
}

// Raises an alarm until the next reset; the first one stays.
inline void latch(plants::Plant& plant, Index alarm) {
  if (plant.alarm == 0) plant.alarm = alarm;
}

// Returns whether a body (4,) has drifted from what its velocity says. `besides`: what its position may
// be off [m]; `exact`: whether the body is its model.
inline bool drifts(Memory& memory, PlanarMemory& planar, const double* body, double period, double besides,
                   bool exact) {
  const double left = fade(period);
  double drift2 = 0.0, meant2 = 0.0, seen2 = 0.0, changed2 = 0.0;
  const auto square = [](double x) { return x * x; };
  for (int k = 0; k < 2; ++k) {
    const double meant = 0.5 * period * (body[2 + k] + planar.body[2 + k]);
    planar.drift[k] = left * planar.drift[k] + body[k] - planar.body[k] - meant;
    planar.motion[k] = left * planar.motion[k] + meant;
    drift2 += square(planar.drift[k]);
    meant2 += square(planar.motion[k]);
    seen2 += square(planar.motion[k] + planar.drift[k]);
    changed2 += square(body[2 + k] - planar.body[2 + k]);
  }
  const double off = std::sqrt(drift2), moved = std::sqrt(std::max(meant2, seen2));
  return strays(memory, off, moved, exact ? 0.0 : std::sqrt(changed2), REST, besides, period);
}

// Compares a valid sample of a planar double integrator with the one before. `input`: (2,) applied since;
// `radius`: the largest norm of an input [m/s^2]; `confidence`: kappa; `exact`: whether the plant is its
// model; `observed`: whether states were measured; whoever propagates them compares them elsewhere.
inline void watch(plants::Plant& plant, Vector<const double> input, double radius, double confidence, bool exact,
                  bool observed) {
  const double *model = plant.model, period = plant.elapsed;
  double body[4];
  for (int k = 0; k < 4; ++k) body[k] = model[k] + plant.lag[k];
  if (plant.fault >= reason::FIRST_ALARM) latch(plant, plant.fault);
  if (observed && plant.follows && period > 0.0) {
    double missed = 0.0, chosen = 0.0;
    for (int k = 0; k < 2; ++k) {
      const double miss = (model[2 + k] - plant.expected[k]) / period - input[k];
      missed += miss * miss;
      chosen += input[k] * input[k];
    }
    if (account(plant.watched, missed, chosen, period / WINDOW, radius) || breaks_off(plant.watched))
      latch(plant, reason::INPUT);
    const double variance = plant.covariance[0][0] + plant.covariance[1][1];
    const double spread = confidence * std::sqrt(std::max(0.0, variance));
    if (drifts(plant.watched, plant.planar, body, period, spread, exact)) latch(plant, reason::MOTION);
  }
  std::copy(body, body + 4, plant.planar.body);
  plant.expected[0] = model[2], plant.expected[1] = model[3];
  plant.follows = 1;
}

}  // namespace hcbf::monitor
