// How a foot travels from lift-off to its foothold.
#pragma once
#include <hcbf/matrices.hpp>

namespace hcbf::swing {

using matrices::Matrix3;
using matrices::Vector2;

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

}  // namespace hcbf::swing
