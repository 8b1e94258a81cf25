// What a walking robot notices of a plant that differs from the declared one.
//
// Three signals over the last half second, from what the controller knows alone: its plan of stance and
// swing, the state as measured or estimated, the contacts and the torques it commanded.
//
// Slip is how fast feet in planned stance move over the ground, mean |v − v_foot| with v_foot the trunk's
// velocity that a foot shows if it holds. Lag is how much better late torques explain the swinging joints,
// max_{d > D} c_d − max_{d ≤ D} c_d with c_d = corr(Δ²q̇_k, Δτ_{k−1−d}) and D the longest declared delay in
// ticks. Lift is the mean acceleration that the controller has learnt to hold the trunk's height.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include <hcbf/arrays.hpp>
#include <hcbf/leg.hpp>
#include <hcbf/leg_odometry.hpp>
#include <hcbf/locomotion_state.hpp>
#include <hcbf/rotation.hpp>

namespace hcbf::fault_detection {

using leg::LegGeometry;
using locomotion_state::RobotState;

constexpr int WINDOW = 12;  // judgements over which the signals are taken
// sum of squares below which joints say nothing of a delay, for they do not move
constexpr double LEAST = 1e-9;

// what is added up between two judgements; behind these the two sums of each delay
enum Sum { SLIP, STOOD, LIFT, BENT, SUMS };

using Joints = std::array<double, 12>;

struct Sampling {      // how feet that stand are looked at
  double foot_radius;  // [m]
  Index settled;       // ticks that a foot must have touched
  Index every;         // how many ticks there are for a look
};

struct Memory {  // what goes from one judgement to the next
  Index delays;
  std::vector<double> sums;     // (WINDOW, SUMS + 2 delays) of each judgement in the window
  std::vector<Joints> rates;    // (2,) q̇ of the last two ticks [rad/s]
  Joints torque;                // of the last tick [N·m]
  std::vector<Joints> changes;  // (delays,) Δτ of the last ticks [N·m]
  Index touched[4];             // for how many ticks each foot has touched

  explicit Memory(Index delays) : delays(delays) { reset(); }
  void reset() {
    sums.assign(WINDOW * columns(), 0.0);
    rates.assign(2, Joints{});
    torque = {};
    changes.assign(delays, Joints{});
    std::fill(touched, touched + 4, 0);
  }
  Index columns() const { return SUMS + 2 * delays; }
};

struct Signals {
  double slip;  // [m/s]
  double lag;   // a difference of correlations
  double lift;  // [m/s²]
};

// Adds |v − v_foot| of the feet that stand.
inline void add_slip(double* sums, const LegGeometry& legs, double foot_radius, const RobotState& state,
                     const bool* standing) {
  const auto R = rotation::rotation_matrix(state.quaternion);
  const auto feet = leg::foot_kinematics(legs, state.joint_position, state.joint_velocity);
  for (int foot = 0; foot < 4; ++foot) {
    if (!standing[foot]) continue;
    const auto shown = leg_odometry::trunk_velocity(feet, foot_radius, foot, state, R).velocity;
    sums[SLIP] += std::hypot(state.linear_velocity[0] - shown[0], state.linear_velocity[1] - shown[1]);
    sums[STOOD] += 1.0;
  }
}

// Adds a leg's share of the correlations: `rates` are q̇ of the last three ticks, the present one last
// [rad/s], `changes` Δτ of the ticks before the present one, the oldest first [N·m].
inline void correlate(double* sums, const Joints* rates, const Joints* changes, Index delays, int first) {
  for (int joint = first; joint < first + 3; ++joint) {
    const double bend = rates[2][joint] - 2.0 * rates[1][joint] + rates[0][joint];
    sums[BENT] += bend * bend;
    for (Index delay = 0; delay < delays; ++delay) {
      const double change = changes[delays - 1 - delay][joint];
      sums[SUMS + delay] += bend * change;
      sums[SUMS + delays + delay] += change * change;
    }
  }
}

// Puts the sums of n ticks in a row of the memory, and moves that on. `states` is (n, 41), `torques`
// (n, 12) [N·m], `stances` (n, 4), and `lift` the learnt acceleration at the end [m/s²].
inline void add_up(Memory& memory, Index row, const LegGeometry& legs, const Sampling& sampling,
                   Matrix<const double> states, Matrix<const double> torques, Matrix<const bool> stances,
                   double lift) {
  double* sums = memory.sums.data() + row * memory.columns();
  std::fill(sums, sums + memory.columns(), 0.0);
  sums[LIFT] = lift;
  for (Index k = 0; k < states.rows; ++k) {
    const RobotState& state = locomotion_state::state_view(&states(k, 0));
    Joints &rate = memory.rates.emplace_back(), &change = memory.changes.emplace_back();
    for (int joint = 0; joint < 12; ++joint) {
      rate[joint] = state.joint_velocity[joint / 3][joint % 3];
      change[joint] = torques(k, joint) - (k > 0 ? torques(k - 1, joint) : memory.torque[joint]);
    }
    for (int foot = 0; foot < 4; ++foot) {
      memory.touched[foot] = state.touches(foot) ? memory.touched[foot] + 1 : 0;
      if (!stances(k, foot)) correlate(sums, &memory.rates[k], &memory.changes[k], memory.delays, 3 * foot);
    }
    if ((k + 1) % sampling.every != 0) continue;
    bool standing[4];
    for (int foot = 0; foot < 4; ++foot)
      standing[foot] = stances(k, foot) && memory.touched[foot] >= sampling.settled;
    add_slip(sums, legs, sampling.foot_radius, state, standing);
  }
  memory.rates.erase(memory.rates.begin(), memory.rates.end() - 2);
  memory.changes.erase(memory.changes.begin(), memory.changes.end() - memory.delays);
  if (states.rows > 0) std::copy_n(&torques(states.rows - 1, 0), 12, memory.torque.begin());
}

// The signals over the window, after so many judgements; `declared` is the longest declared delay [ticks].
inline Signals signals(const Memory& memory, Index judgements, Index declared) {
  std::vector<double> total(memory.columns(), 0.0);
  for (Index row = 0; row < WINDOW; ++row)
    for (Index k = 0; k < memory.columns(); ++k) total[k] += memory.sums[row * memory.columns() + k];
  const double slip = total[SLIP] / std::max(total[STOOD], 1.0);
  const double lift = total[LIFT] / static_cast<double>(std::min<Index>(judgements, WINDOW));
  double early = -1.0, late = -1.0;
  for (Index delay = 0; delay < memory.delays; ++delay) {
    const double power = total[SUMS + memory.delays + delay];
    if (total[BENT] < LEAST || power < LEAST) return {slip, 0.0, lift};
    const double correlation = total[SUMS + delay] / std::sqrt(total[BENT] * power);
    double& best = delay <= declared ? early : late;
    best = std::max(best, correlation);
  }
  return {slip, late - early, lift};
}

}  // namespace hcbf::fault_detection
