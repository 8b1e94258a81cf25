// The feet's plan, one tick ahead: where a swinging foot shall land, and how it travels there.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/body_reference.hpp>
#include <hcbf/constants.hpp>
#include <hcbf/gait.hpp>
#include <hcbf/matrices.hpp>

namespace hcbf::feet {

using body_reference::BodyReference;
using gait::FootPhases;
using gait::Gait;
using matrices::Matrix3;
using matrices::Vector2;
using matrices::Vector3;

constexpr double SIDEWAYS = 0.085;  // [m] the nominal foothold is this far outside the abad joint
// [s] below √(h/g) = 0.166, which oscillates with the instantaneous velocity
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

constexpr double SWING_HEIGHT = 0.055;  // [m] of the apex above the foothold
// acceleration at lift-off, in the plane and upwards, as a multiple of distance / time²: a foot that
// starts from rest would move faster in the middle, where its motors give little torque
constexpr double LIFT_OFF_PLANE = 4.0, LIFT_OFF_UP = 8.0;

struct Motion {  // of a foot along one axis
  double position, velocity, acceleration;
};

// Position, velocity and acceleration one tick later on the minimum-jerk way: the quintic from the
// present state to rest at `target` in `remaining` seconds. Taken anew every tick it follows a moving
// target without a jump in position or velocity. Where two ticks or less remain, and the quintic
// stiffens, the present velocity is retained.
//
// Source: T. Flash and N. Hogan, J. Neuroscience 5 (1985).
inline Motion minimum_jerk_step(double position, double velocity, double acceleration, double target,
                                double remaining, double dt) {
  const double T = remaining;
  if (2.0 * dt >= T) return {position + velocity * dt, velocity, 0.0};
  const double T2 = T * T, T3 = T * T2, T4 = T2 * T2, T5 = T * T4;
  const double gap = target - position - velocity * T - 0.5 * acceleration * T * T;
  const double rate = -velocity - acceleration * T;
  const double c3 = 10.0 * gap / T3 - 4.0 * rate / T2 - 0.5 * acceleration / T;
  const double c4 = -15.0 * gap / T4 + 7.0 * rate / T3 + acceleration / T2;
  const double c5 = 6.0 * gap / T5 - 3.0 * rate / T4 - 0.5 * acceleration / T3;
  return {
      position + dt * (velocity + dt * (0.5 * acceleration + dt * (c3 + dt * (c4 + dt * c5)))),
      velocity + dt * (acceleration + dt * (3.0 * c3 + dt * (4.0 * c4 + dt * 5.0 * c5))),
      acceleration + dt * (6.0 * c3 + dt * (12.0 * c4 + dt * 20.0 * c5)),
  };
}

// A swinging foot's position, velocity and acceleration (the rows) one tick later.
//
// In the plane it goes straight to the foothold; upwards first to the apex, reached at half the swing,
// then to the ground, where its centre is at `touchdown`. It sets off with the accelerations above; in
// the first tick it only rises, or it would slide before it is off the ground.
inline Matrix3 swing_step(const Matrix3& now, const Vector2& foothold, double touchdown, double remaining,
                          double duration, double dt) {
  const bool lifts_off = remaining > duration - 0.5 * dt;
  const bool departs = remaining > duration - 1.5 * dt;
  const double rising = remaining - 0.5 * duration;
  Matrix3 following = now;
  for (int axis = 0; axis < 3; ++axis) {
    const bool in_plane = axis < 2;
    if (in_plane && lifts_off) continue;
    double target = touchdown, time_left = remaining;
    if (in_plane) {
      target = foothold[axis];
    } else if (rising > 0.0) {
      target = touchdown + SWING_HEIGHT;
      time_left = rising;
    }
    double acceleration = now[2][axis];
    if (lifts_off || (in_plane && departs)) {
      const double share = in_plane ? LIFT_OFF_PLANE : LIFT_OFF_UP;
      acceleration = share * (target - now[0][axis]) / (time_left * time_left);
    }
    const Motion then = minimum_jerk_step(now[0][axis], now[1][axis], acceleration, target, time_left, dt);
    following[0][axis] = then.position;
    following[1][axis] = then.velocity;
    following[2][axis] = then.acceleration;
  }
  return following;
}

// last share of the swing in which the foothold is held: it follows the trunk's velocity, and a
// foot that chases it to the end lands at up to 1 m/s along the ground and slides
constexpr double SETTLED = 0.3;

struct FootTargets {    // what each foot shall do, in the world
  bool stance[4];       // feet that carry; the others follow their swing
  Matrix3 motion[4];    // per foot the rows position [m], velocity [m/s], acceleration [m/s²]
  Vector2 foothold[4];  // where it shall land, or stands [m]
};

// Lets a foot carry where it is.
inline void stand(FootTargets& targets, int foot, const Vector3& place) {
  targets.stance[foot] = true;
  targets.motion[foot] = {{place, {}, {}}};
  targets.foothold[foot] = {place[0], place[1]};
}

struct Places {
  Vector3 measured[4];  // of the feet in the world [m]
  Vector2 nominal[4];   // footholds at rest in the trunk's axes [m]
  double touchdown;     // height of a foot's centre on the ground [m]
};

// Moves the targets on by one tick.
inline void plan_feet(FootTargets& targets, const FootPhases& phases, const Gait& gait, const Places& places,
                      const Trunk& trunk, const BodyReference& reference, double dt) {
  const double stance_time = gait.duty * gait.period;
  const double swing_time = (1.0 - gait.duty) * gait.period;
  for (int foot = 0; foot < 4; ++foot) {
    if (phases.stance[foot]) {
      stand(targets, foot, places.measured[foot]);
      continue;
    }
    const double remaining = phases.remaining[foot];
    if (remaining > SETTLED * swing_time)
      targets.foothold[foot] =
          feet::foothold(places.nominal[foot], trunk, reference, remaining, stance_time);
    targets.stance[foot] = false;
    targets.motion[foot] = swing_step(targets.motion[foot], targets.foothold[foot], places.touchdown,
                                             remaining, swing_time, dt);
  }
}

}  // namespace hcbf::feet
