// Rotations: unit quaternions (w first), matrices body → world R, angles.
#pragma once
#include <cmath>

#include <hcbf/matrices.hpp>

namespace hcbf::rotation {

using matrices::Matrix3;
using matrices::Vector3;

constexpr double PI = 3.141592653589793;

struct Quaternion {
  double w, x, y, z;
};

inline Matrix3 rotation_matrix(const Quaternion& quaternion) {
  const auto [w, x, y, z] = quaternion;
  return {{
      {1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)},
      {2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)},
      {2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)},
  }};
}

// Division as Python rounds it: down, so that remainders have the divisor's sign.
inline double remainder(double a, double b) {
  const double rest = std::fmod(a, b);
  if (rest == 0.0) return std::copysign(0.0, b);
  return (b < 0.0) != (rest < 0.0) ? rest + b : rest;
}

inline double quotient(double a, double b) {
  const double rest = std::fmod(a, b);
  double whole = (a - rest) / b;
  if (rest != 0.0 && (b < 0.0) != (rest < 0.0)) whole -= 1.0;
  if (whole == 0.0) return std::copysign(0.0, a / b);
  const double floored = std::floor(whole);
  return whole - floored > 0.5 ? floored + 1.0 : floored;
}

// The heading [rad].
inline double yaw_of(const Matrix3& R) { return std::atan2(R[1][0], R[0][0]); }

// log(Rᵀ R_z(yaw)): the turn, in body axes, that levels the body at `yaw`.
inline Vector3 rotation_vector_to_yaw(const Matrix3& R, double yaw) {
  const double c = std::cos(yaw), s = std::sin(yaw);
  Matrix3 E;  // Rᵀ R_z
  for (int i = 0; i < 3; ++i) {
    E[i][0] = R[0][i] * c + R[1][i] * s;
    E[i][1] = -R[0][i] * s + R[1][i] * c;
    E[i][2] = R[2][i];
  }
  // times twice the sine of the angle
  const Vector3 axis = {E[2][1] - E[1][2], E[0][2] - E[2][0], E[1][0] - E[0][1]};
  const double sine = 0.5 * std::sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
  const double angle = std::atan2(sine, 0.5 * (E[0][0] + E[1][1] + E[2][2] - 1.0));
  return (sine < 1e-9 ? 0.5 : 0.5 * angle / sine) * axis;
}

// An orientation turned by a small `rotation` about the world's axes [rad].
inline Quaternion turned(const Quaternion& quaternion, const Vector3& rotation) {
  const auto [w, x, y, z] = quaternion;
  const double a = 0.5 * rotation[0], b = 0.5 * rotation[1], c = 0.5 * rotation[2];
  const Quaternion t = {
      w - a * x - b * y - c * z,
      x + a * w + b * z - c * y,
      y + b * w + c * x - a * z,
      z + c * w + a * y - b * x,
  };
  const double length = std::sqrt(t.w * t.w + t.x * t.x + t.y * t.y + t.z * t.z);
  return {t.w / length, t.x / length, t.y / length, t.z / length};
}

// The equal angle in [−π, π).
inline double wrap_angle(double angle) { return rotation::remainder(angle + PI, 2.0 * PI) - PI; }

}  // namespace hcbf::rotation
