// Where a swinging foot shall land.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/constants.hpp>
#include <hcbf/body_reference.hpp>
#include <hcbf/matrices.hpp>

namespace hcbf::foothold {

using body_reference::BodyReference;
using matrices::Vector2;
using matrices::Vector3;

constexpr double SIDEWAYS = 0.085;  // [m] the nominal foothold is this far outside the abad joint
// [s] below √(h/g) = 0.166, which sways with the instantaneous velocity
constexpr double VELOCITY_GAIN = 0.08;
constexpr double MAX_OFFSET = 0.16;  // [m] from below the hip

// The foothold at rest in the trunk's axes, from the abad joint [m].
inline Vector2 nominal_stance(const Vector3& hip) {
  return {hip[0], hip[1] + body_reference::sign(hip[1]) * SIDEWAYS};
}

struct Trunk {       // as the feet's plan reads it
  Vector3 position;  // p [m]
  Vector3 velocity;  // v in the world's axes [m/s]
  double yaw;        // ψ [rad]
  double height;     // h that it shall hold above the ground [m]
};

// The foothold in the world [m]:
// p + v t_rem + R_z(ψ + ω t_rem) n + v T_st/2 + k (v − v_d) + ½ (h/g) ω (v_y, −v_x): below the hip at
// touchdown, ahead by half a stance, further out when too fast, and leant into a turn.
//
// Source: M. Raibert, Legged Robots That Balance (1986), as the paper asks for in section II-B; the
// turning term from the MIT Cheetah 3 controller.
inline Vector2 foothold(const Vector2& nominal, const Trunk& trunk, const BodyReference& reference,
                        double remaining, double stance_time) {
  const Vector3& position = trunk.position;
  const double vx = trunk.velocity[0], vy = trunk.velocity[1];
  const double lean = 0.5 * trunk.height / constants::GRAVITY * reference.yaw_rate;
  const double dx = 0.5 * stance_time * vx + VELOCITY_GAIN * (vx - reference.velocity[0]) + lean * vy;
  const double dy = 0.5 * stance_time * vy + VELOCITY_GAIN * (vy - reference.velocity[1]) - lean * vx;
  const double scale = std::min(1.0, MAX_OFFSET / std::max(std::sqrt(dx * dx + dy * dy), 1e-9));
  const double heading = trunk.yaw + reference.yaw_rate * remaining;
  const double c = std::cos(heading), s = std::sin(heading);
  return {
      position[0] + vx * remaining + c * nominal[0] - s * nominal[1] + scale * dx,
      position[1] + vy * remaining + s * nominal[0] + c * nominal[1] + scale * dy,
  };
}

}  // namespace hcbf::foothold
