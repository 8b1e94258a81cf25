// Is the plant the one that was declared? The chosen input and the observed state are compared.
//
// The input: Δu is the difference of the state's change over one period from the model's, as an input.
// E ← E + (T/τ)(‖Δu‖² − E), whose root is the model error. A sample counts where ‖u‖ > FLOOR ū, and is
// missed where ‖Δu‖ > SHARE ‖u‖: most of the last TELLING missed is an alarm; of a plant that meets most
// of them to EXACT, so is more than FEW of them off by OFF_EXACT.
//
// The motion: with s the change Δ from one sample to the next that no input explains, over every sample,
//   r ← (1 − T/τ) r + s,   m ← (1 − T/τ) m + Δ,   m' ← (1 − T/τ) m' + Δ − s,
//   c ← (1 − T/τ) c + APART T ‖ẋ' − ẋ‖,
// and the alarm is raised where at IN_A_ROW samples ‖r‖ > rest + OFF max(‖m‖, ‖m'‖) + c + κ √tr P.
// Of a planar double integrator s = Δp − T (v + v')/2, which is exact; `model_monitor` has any model's.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/memory.hpp>
#include <hcbf/plants.hpp>
#include <hcbf/reason.hpp>

namespace hcbf::monitor {

constexpr double WINDOW = 0.5;                   // τ, over which squared errors are averaged [s]
constexpr double FLOOR = 0.05;                   // of the largest input: a smaller one is noise and rounding
constexpr double SHARE = 0.45;                   // of the input: a gain of one half is off by 0.5 of it
constexpr double TELLING = 25.0;                 // samples over which the share of misses is averaged
constexpr double LEAST_SAMPLES = 10.0;           // that tell, before which no alarm is raised
constexpr double MOST = 0.5;                     // of misses for an alarm; of exact samples of an exact plant
constexpr double EXACT = 0.02, OFF_EXACT = 0.1;  // of the input: met up to it, not met beyond it
constexpr double FEW = 0.1;                      // of samples off, above which an exact plant alarms
constexpr double REST = 0.01;                    // that position and velocity may drift apart [m]: rounding
constexpr double OFF = 0.1;                      // share of the motion beyond which it is not the model's
constexpr double APART = 0.6;                    // of T (ẋ' − ẋ) that two ways to integrate differ by
constexpr double IN_A_ROW = 3.0;                 // samples at which the motion must be off

// Counts one sample's ‖Δu‖² (`error`) and ‖u‖² (`chosen`), and returns whether most were missed.
// `rate`: T/τ; `radius`: the largest norm of an input.
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

// By how much sums over τ fade in a period.
inline double fade(double period) { return std::max(0.0, 1.0 - period / WINDOW); }

// Accounts for the motion of one sample, and returns whether that alarms. `off`: ‖r‖; `moved`: the
// greater of ‖m‖ and ‖m'‖; `change`: ‖ẋ' − ẋ‖; `rest`: what they may be apart in any case; `spread`: κ √tr P.
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

// Notes where a body (4,) is, and its velocity, for the next sample.
inline void note_body(PlanarMemory& memory, const double* body) { std::copy_n(body, 4, memory.body); }

// Returns whether the position of a body (4,) has drifted from what its velocity makes of it. `besides`:
// what the position may be off [m]; `exact`: whether the body is its model.
inline bool drifts(Memory& memory, PlanarMemory& planar, const double* body, double period, double besides,
                   bool exact) {
  const double left = fade(period), *last = planar.body;
  double drift2 = 0.0, meant2 = 0.0, seen2 = 0.0, changed2 = 0.0;
  for (int k = 0; k < 2; ++k) {
    double &drift = planar.drift[k], &motion = planar.motion[k];
    const double meant = 0.5 * period * (body[2 + k] + last[2 + k]), changed = body[2 + k] - last[2 + k];
    drift = left * drift + body[k] - last[k] - meant;
    motion = left * motion + meant;
    drift2 += drift * drift;
    meant2 += motion * motion;
    seen2 += (motion + drift) * (motion + drift);
    changed2 += changed * changed;
  }
  const double off = std::sqrt(drift2), moved = std::sqrt(std::max(meant2, seen2));
  return strays(memory, off, moved, exact ? 0.0 : std::sqrt(changed2), REST, besides, period);
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
    Memory& memory = plant.watched;
    const bool misses = account(memory, missed, chosen, period / WINDOW, radius);
    // a plant that meets inputs exactly has missed more than few of the last ones
    const bool breaks_off = memory.samples >= TELLING && memory.exact > MOST && memory.off > FEW;
    if (misses || breaks_off) latch(plant, reason::INPUT);
    const double trace = plant.covariance[0][0] + plant.covariance[1][1];
    const double spread = confidence * std::sqrt(std::max(0.0, trace));
    if (drifts(plant.watched, plant.planar, body, period, spread, exact)) latch(plant, reason::MOTION);
  }
  note_body(plant.planar, body);
  plant.expected[0] = model[2], plant.expected[1] = model[3];
  plant.follows = 1;
}

}  // namespace hcbf::monitor
