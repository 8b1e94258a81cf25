// Kinematics of an abad–hip–knee leg in the trunk's axes, in closed form.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/matrices.hpp>
#include <hcbf/rotation.hpp>

namespace hcbf::leg {

using matrices::Matrix3;
using matrices::Vector3;

struct LegGeometry {  // of the four legs
  Vector3 hip[4];     // abad joint in the trunk's axes [m]
  double offset[4];   // from the abad axis sideways to the leg's plane, left positive [m]
  double thigh;       // hip to knee [m]
  double calf;        // knee to the foot's centre [m]
};

struct FootKinematics {  // in the trunk's axes
  Vector3 position[4];   // r, of the foot's centre from the trunk's origin [m]
  Matrix3 jacobian[4];   // J = ∂r/∂q of the leg's own joints
  Vector3 bias[4];       // J̇q̇ [m/s²]
};

inline FootKinematics foot_kinematics(const LegGeometry& geometry, const Vector3* joints,
                                      const Vector3* velocity) {
  FootKinematics feet;
  const double l2 = geometry.thigh, l3 = geometry.calf;
  for (int leg = 0; leg < 4; ++leg) {
    const double a = joints[leg][0], h = joints[leg][1], k = joints[leg][2];
    const double da = velocity[leg][0], dh = velocity[leg][1];
    const double dhk = dh + velocity[leg][2];
    const double sa = std::sin(a), ca = std::cos(a);
    const double s1 = std::sin(h), c1 = std::cos(h), s12 = std::sin(h + k), c12 = std::cos(h + k);

    // the leg's plane: x forwards, d sideways, z upwards, before the abad joint turns it
    const double x = -l2 * s1 - l3 * s12;
    const double d = geometry.offset[leg];
    const double z = -l2 * c1 - l3 * c12;
    const Vector3& hip = geometry.hip[leg];
    feet.position[leg] = {hip[0] + x, hip[1] + d * ca - z * sa, hip[2] + d * sa + z * ca};
    feet.jacobian[leg] = {{
        {0.0, z, -l3 * c12},
        {-d * sa - z * ca, x * sa, -l3 * s12 * sa},
        {d * ca - z * sa, -x * ca, l3 * s12 * ca},
    }};

    const double dz = l2 * s1 * dh + l3 * s12 * dhk;
    const double ddy = -(da * da) * d - 2.0 * da * dz;
    const double ddz = l2 * c1 * (dh * dh) + l3 * c12 * (dhk * dhk) - da * da * z;
    feet.bias[leg] = {
        l2 * s1 * (dh * dh) + l3 * s12 * (dhk * dhk),
        ddy * ca - ddz * sa,
        ddy * sa + ddz * ca,
    };
  }
  return feet;
}

// A foot's acceleration, in the trunk's axes, when all generalised ones are zero:
// ω×v + ω×(ω×r) + 2 ω×(J q̇) + J̇ q̇, with (v, ω) the trunk's velocity in its own axes. With J_c the
// foot's Jacobian in the world's axes this is Rᵀ J̇_c q̇.
inline Vector3 foot_bias(const double* v, const Vector3& r, const Matrix3& J, const Vector3& bias,
                         const Vector3& joint_velocity) {
  const double* omega = v + 3;
  Vector3 carried = {v[0], v[1], v[2]};
  Vector3 acceleration = bias;
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) carried[i] += 2.0 * J[i][k] * joint_velocity[k];
  matrices::add_cross(carried.at, omega, r.at);
  matrices::add_cross(acceleration.at, omega, carried.at);
  return acceleration;
}

// The joints that bring the foot to `foot`, knee backwards [rad]. A target beyond the leg's reach is
// answered with the leg stretched towards it.
inline Vector3 inverse_kinematics(const LegGeometry& geometry, int leg, const Vector3& foot) {
  const double l2 = geometry.thigh, l3 = geometry.calf;
  const double d = geometry.offset[leg];
  const double x = foot[0] - geometry.hip[leg][0];
  const double y = foot[1] - geometry.hip[leg][1];
  const double z = foot[2] - geometry.hip[leg][2];
  const double down = std::sqrt(std::max(y * y + z * z - d * d, 1e-6));  // depth in the leg's plane
  const double abad = std::atan2(z, y) - std::atan2(-down, d);
  const double cos_knee = (x * x + down * down - l2 * l2 - l3 * l3) / (2.0 * l2 * l3);
  const double knee = -std::acos(std::min(std::max(cos_knee, -1.0), 1.0));
  const double hip = std::atan2(-x, down) - std::atan2(l3 * std::sin(knee), l2 + l3 * std::cos(knee));
  return {rotation::wrap_angle(abad), hip, knee};
}

}  // namespace hcbf::leg
