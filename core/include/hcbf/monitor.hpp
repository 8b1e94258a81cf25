// Does a plant do what was predicted? Measured against predicted change, from each sample to the next.
//
// The input: Δu is the difference of the state's change over one period from the model's, as an input.
// E ← E + (T/τ)(‖Δu‖² − E), whose root is the model error. The alarm counts samples, so that it makes no
// difference how large they are. One counts where ‖u‖ > FLOOR ū, with ū the largest input, and is missed
// where ‖Δu‖ > SHARE ‖u‖: most of the last COUNTED missed is an alarm. A gain of 2 misses every one that is
// not cut off at the limits. A plant that meets most of them to EXACT ‖u‖ is exact, and few misses are
// significant there: more than FEW of them off by OFF_EXACT ‖u‖ alarm, too, such as every third reversed.
//
// The motion: with Δ the measured change from one sample to the next, and s its difference from the
// predicted one, over every sample,
//   r ← (1 − T/τ) r + s,   m ← (1 − T/τ) m + Δ,   m' ← (1 − T/τ) m' + Δ − s,
//   c ← (1 − T/τ) c + APART T ‖ẋ' − ẋ‖,
// and the alarm is raised where at IN_A_ROW samples ‖r‖ > rest + OFF max(‖m‖, ‖m'‖) + c + κ √tr P: c is
// what two integrators may be apart, where the velocity turns or changes. In the plane, s = Δp − T (v + v')/2,
// which is exact for a double integrator, so that c is 0 where the plant is its model. `model_monitor`
// predicts by any model, `motion_monitor` by a robot's twist and by its commands.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/plants.hpp>
#include <hcbf/state_check.hpp>

namespace hcbf::monitor {

constexpr double WINDOW = 0.5;                   // τ, over which squared errors are averaged [s]
constexpr double FLOOR = 0.05;                   // of the largest input: a smaller one is noise and rounding
constexpr double SHARE = 0.45;                   // of the input: a gain of one half is off by 0.5 of it
constexpr double COUNTED = 25.0;                 // samples over which the share of misses is averaged
constexpr double LEAST_SAMPLES = 10.0;           // that count, before which no alarm is raised
constexpr double MOST = 0.5;                     // of misses for an alarm; of exact samples of an exact plant
constexpr double EXACT = 0.02, OFF_EXACT = 0.1;  // of the input: met up to it, not met beyond it
constexpr double FEW = 0.1;                      // of samples off, above which an exact plant alarms
constexpr double REST = 0.01;                    // that position and velocity may drift apart [m]: rounding
constexpr double OFF = 0.1;                      // share of the motion beyond which it is not the model's
constexpr double APART = 0.6;                    // of T (ẋ' − ẋ) by which two integrators differ
constexpr double IN_A_ROW = 3.0;                 // samples at which the motion must be off

// Counts one sample's ‖Δu‖² (`error`) and ‖u‖² (`chosen`), and returns whether most were missed.
// `rate`: T/τ; `radius`: the largest norm of an input.
inline bool account(Inputs& memory, double error, double chosen, double rate, double radius) {
  memory.error += std::min(1.0, rate) * (error - memory.error);
  const double floor = FLOOR * radius;
  if (chosen > floor * floor) {
    memory.samples += 1.0;
    const double share = 1.0 / std::min(memory.samples, COUNTED);
    memory.missed += share * ((error > SHARE * SHARE * chosen) - memory.missed);
    memory.exact += share * ((error <= EXACT * EXACT * chosen) - memory.exact);
    memory.off += share * ((error > OFF_EXACT * OFF_EXACT * chosen) - memory.off);
  }
  return memory.samples >= LEAST_SAMPLES && memory.missed > MOST;
}

// By how much sums over τ fade in a period.
inline double fade(double period) { return std::max(0.0, 1.0 - period / WINDOW); }

struct Sample {                     // of a motion
  Vector<const double> off;         // (n,) s
  Vector<const double> predicted;   // (n,) Δ − s
  double change;                    // ‖ẋ' − ẋ‖
  double rest;                      // what they may be apart in any case
  double spread;                    // κ √tr P
  double period;                    // T [s]
};

// Accounts for the motion of one sample, and returns whether that alarms. `r` and `predicted` (n,): r and m'.
inline bool strays(Motion& memory, double* r, double* predicted, const Sample& sample) {
  const double left = fade(sample.period);
  double off2 = 0.0, moved2 = 0.0, predicted2 = 0.0;
  for (Index k = 0; k < sample.off.size; ++k) {
    r[k] = left * r[k] + sample.off[k];
    predicted[k] = left * predicted[k] + sample.predicted[k];
    const double moved = predicted[k] + r[k];
    off2 += r[k] * r[k], moved2 += moved * moved, predicted2 += predicted[k] * predicted[k];
  }
  memory.bend = left * memory.bend + APART * sample.period * sample.change;
  const double moved = std::sqrt(std::max(moved2, predicted2));
  const double bound = sample.rest + OFF * moved + memory.bend + sample.spread;
  memory.in_a_row = std::sqrt(off2) > bound ? memory.in_a_row + 1.0 : 0.0;
  return memory.in_a_row >= IN_A_ROW;
}

// Returns whether the position of a body (4,) strays from its velocity's prediction. `spread`: what the
// position may be off [m]; `exact`: whether the body is its model.
inline bool drifts(Motion& memory, const double* body, double period, double spread, bool exact) {
  double off[2], predicted[2], changed2 = 0.0;
  for (int k = 0; k < 2; ++k) {
    predicted[k] = 0.5 * period * (body[2 + k] + memory.body[2 + k]);
    off[k] = body[k] - memory.body[k] - predicted[k];
    const double changed = body[2 + k] - memory.body[2 + k];
    changed2 += changed * changed;
  }
  const double change = exact ? 0.0 : std::sqrt(changed2);
  return strays(memory, memory.drift, memory.motion,
                {{off, 2}, {predicted, 2}, change, REST, spread, period});
}

// Raises an alarm until the next reset; the first one stays.
inline void latch(plants::Plant& plant, Index alarm) {
  if (plant.alarm == 0) plant.alarm = alarm;
}

// Compares a valid sample of a planar double integrator with the one before, and raises its alarms.
// `input` (2,): applied since; `radius`: the largest norm of an input [m/s²]; `confidence`: κ;
// `observed`: whether states were measured: propagated ones are compared by their owner.
inline void watch(plants::Plant& plant, Vector<const double> input, double radius, double confidence,
                  bool exact, bool observed) {
  const double* model = plant.model;
  double body[4];
  for (int k = 0; k < 4; ++k) body[k] = model[k] + plant.lag[k];
  if (plant.fault >= reason::FIRST_ALARM) latch(plant, plant.fault);
  const double period = plant.elapsed;
  if (observed && plant.follows && period > 0.0) {
    double missed = 0.0, chosen = 0.0;
    for (int k = 0; k < 2; ++k) {
      const double miss = (model[2 + k] - plant.expected[k]) / period - input[k];
      missed += miss * miss;
      chosen += input[k] * input[k];
    }
    const Inputs& seen = plant.inputs;
    const bool fails = account(plant.inputs, missed, chosen, period / WINDOW, radius);
    const bool breaks_off = seen.samples >= COUNTED && seen.exact > MOST && seen.off > FEW;
    if (fails || breaks_off) latch(plant, reason::INPUT);
    const double trace = plant.covariance[0][0] + plant.covariance[1][1];
    const double spread = confidence * std::sqrt(std::max(0.0, trace));
    if (drifts(plant.motion, body, period, spread, exact)) latch(plant, reason::MOTION);
  }
  std::copy_n(body, 4, plant.motion.body);
  plant.expected[0] = model[2], plant.expected[1] = model[3];
  plant.follows = 1;
}

}  // namespace hcbf::monitor
