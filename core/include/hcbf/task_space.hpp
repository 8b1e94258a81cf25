// The task-space QP over (q̈, τ, F), everything that its equalities fix taken out.
//
//     min ‖J_y q̈ + J̇_y q̇ − ÿ‖² + w‖F‖²   subject to   D q̈ + H = Sᵀτ + J_cᵀF,  J_c q̈ + J̇_c q̇ = 0,
//                                                      |F_x|, |F_y| ≤ µ F_z,  τ_min ≤ τ ≤ τ_max
//
// Twelve unknowns remain (section II-B of the paper, "Task-Space Controller").
//
// Each leg brings three: its contact force F_i if it stands, its joint accelerations q̈_i if it swings.
// A standing foot does not move, B_i a + J_i q̈_i + β_i = 0 with a the trunk's acceleration and
// B_i = [1, −r_i×], which gives q̈_i through a 3×3 inverse; the trunk's six rows of the dynamics then
// give a, and the legs' rows τ. So everything is affine in the unknowns z and stored as a matrix with 13
// columns, · [z; 1].
//
// The tests hold its torques to those of the program as the paper poses it.
#pragma once
#include <algorithm>
#include <cmath>
#include <limits>

#include <hcbf/dynamics.hpp>
#include <hcbf/leg.hpp>
#include <hcbf/matrices.hpp>
#include <hcbf/tasks.hpp>

namespace hcbf::task_space {

using dynamics::Dynamics;
using matrices::add_cross;
using matrices::Matrix3;
using matrices::Vector3;
using tasks::TaskAccelerations;

// A program and what comes of it; of A and the bounds the rows for four standing feet, of which those of
// the feet that stand count.
struct Workspace {
  double H[12][12];
  double f[12];
  double A[28][12];  // the first 12 rows are the torques
  double lower[40];
  double upper[40];
  double torque_offset[12];  // τ = A[:12] z + torque_offset [N·m]
  double z[12];
  double feedforward[12];  // τ of the latest solution [N·m]
  Vector3 feedback[4];     // of the joint impedance [N·m]
  double limits[2][12];    // least and largest torque of each joint [N·m]
  double torque[12];       // feedforward and feedback within the limits [N·m]
};

struct Accelerations {  // how the unknowns accelerate the robot
  double trunk[6][13];  // the trunk's acceleration a = trunk [z; 1], in its own axes
  double lever[4][3]
              [6];  // a standing leg's joints, q̈_i = lever_i a + rest_i; those of a swinging leg are z_i
  double rest[4][3];
};

// q̈ as it depends on z, from the trunk's rows of the dynamics; β are the feet's accelerations, in the
// trunk's axes, that q̈ does not cause.
inline Accelerations accelerations(const Dynamics& robot, const Vector3* beta) {
  const Matrix3& R = robot.R;
  Accelerations q = {};
  double inertia[6][6];
  for (int i = 0; i < 6; ++i) {
    q.trunk[i][12] = -robot.bias[i];
    for (int j = 0; j < 6; ++j) inertia[i][j] = robot.M[i][j];
  }
  for (int foot = 0; foot < 4; ++foot) {
    const int x = 3 * foot, joint = 6 + 3 * foot;
    if (!robot.stance[foot]) {
      for (int i = 0; i < 6; ++i)
        for (int k = 0; k < 3; ++k) q.trunk[i][x + k] = -robot.M[i][joint + k];
      continue;
    }
    const Vector3& r = robot.feet.position[foot];
    const Matrix3 J_inverse = matrices::inverse_3x3(robot.feet.jacobian[foot]);
    for (int k = 0; k < 3; ++k) {  // −J⁻¹B, −J⁻¹β, and the wrench of a unit of force at r
      double wrench[3] = {0.0, 0.0, 0.0};
      for (int i = 0; i < 3; ++i) {
        q.lever[foot][k][i] = -J_inverse[k][i];
        q.rest[foot][k] -= J_inverse[k][i] * beta[foot][i];
        q.trunk[i][x + k] = R[k][i];
      }
      add_cross(q.lever[foot][k] + 3, J_inverse[k].at, r.at);
      add_cross(wrench, r.at, R[k].at);
      for (int i = 0; i < 3; ++i) q.trunk[3 + i][x + k] = wrench[i];
    }
    for (int i = 0; i < 6; ++i) {  // the leg moves with the trunk, and weighs on it
      for (int k = 0; k < 3; ++k) {
        const double coupling = robot.M[i][joint + k];
        q.trunk[i][12] -= coupling * q.rest[foot][k];
        for (int j = 0; j < 6; ++j) inertia[i][j] += coupling * q.lever[foot][k][j];
      }
    }
  }
  matrices::solve_in_place(inertia, q.trunk);
  return q;
}

// Adds the errors of the trunk's tasks, error[:6] [z; 1], weighted.
inline void trunk_errors(double (*error)[13], const Dynamics& robot, const double (&trunk)[6][13],
                         const TaskAccelerations& tasks) {
  const double* v = robot.v;
  const Vector3 drift = matrices::cross({v[3], v[4], v[5]}, {v[0], v[1], v[2]});
  for (int i = 0; i < 3; ++i) {
    const double weight = i == 2 ? std::sqrt(tasks::HEIGHT_WEIGHT) : 1.0;
    for (int k = 0; k < 3; ++k) {
      for (int j = 0; j < 13; ++j) error[i][j] += weight * robot.R[i][k] * trunk[k][j];
      error[i][12] += weight * robot.R[i][k] * drift[k];
    }
    error[i][12] -= weight * tasks.linear[i];
    for (int j = 0; j < 13; ++j) error[3 + i][j] = trunk[3 + i][j];
    error[3 + i][12] -= tasks.angular[i];
  }
}

// Adds the errors of a swinging foot, a + α × r + J q̈ + β − ÿ in the trunk's axes; `missing` is ÿ − β,
// what q̈ must bring about [m/s²].
inline void swing_errors(double (*error)[13], const Dynamics& robot, const double (&trunk)[6][13], int foot,
                         const Vector3& missing) {
  const Vector3& r = robot.feet.position[foot];
  const Matrix3& J = robot.feet.jacobian[foot];
  for (int i = 0; i < 3; ++i) {
    const int j1 = (i + 1) % 3, j2 = (i + 2) % 3;
    for (int j = 0; j < 13; ++j)
      error[i][j] = trunk[i][j] + trunk[3 + j1][j] * r[j2] - trunk[3 + j2][j] * r[j1];
    for (int k = 0; k < 3; ++k) error[i][3 * foot + k] += J[i][k];
    error[i][12] -= missing[i];
  }
}

// Adds a leg's row of the dynamics, τ = torque [z; 1]; k is 0 for its abad joint, 1 hip, 2 knee.
inline void joint_torque(double* torque, const Dynamics& robot, const Accelerations& q, int foot, int k) {
  const int x = 3 * foot, joint = 6 + 3 * foot;
  const double* row = robot.M[joint + k];
  const Matrix3& J = robot.feet.jacobian[foot];
  torque[12] = robot.bias[joint + k];
  for (int i = 0; i < 6; ++i) {
    double of_trunk = row[i];
    // a standing leg moves with the trunk; a swinging one's lever is zero
    for (int n = 0; n < 3; ++n) of_trunk += row[joint + n] * q.lever[foot][n][i];
    for (int j = 0; j < 13; ++j) torque[j] += of_trunk * q.trunk[i][j];
  }
  if (!robot.stance[foot]) {
    for (int n = 0; n < 3; ++n) torque[x + n] += row[joint + n];
    return;
  }
  for (int n = 0; n < 3; ++n) {
    torque[12] += row[joint + n] * q.rest[foot][n];
    for (int m = 0; m < 3; ++m) torque[x + n] -= robot.R[n][m] * J[m][k];
  }
}

// Confines a standing foot's force to its friction pyramid, |F_x|, |F_y| ≤ µ F_z, and small; `contact` is
// how many feet before it stand.
inline void bound_force(Workspace& out, int foot, int contact, double friction) {
  const int x = 3 * foot;
  int row = 12 + 4 * contact;
  out.lower[x + 2] = 0.0;
  std::fill(out.lower + 12 + row, out.lower + 16 + row, 0.0);
  for (int axis = x; axis < x + 2; ++axis) {
    for (double sign : {-1.0, 1.0}) {
      out.A[row][axis] = sign;
      out.A[row][x + 2] = friction;
      ++row;
    }
  }
  for (int i = x; i < x + 3; ++i) out.H[i][i] = tasks::FORCE_WEIGHT;
}

// Adds ½ ‖error [z; 1]‖² of errors (count, 13) to the objective.
inline void add_squares(Workspace& out, const double (*error)[13], int count) {
  for (int miss = 0; miss < count; ++miss) {
    for (int i = 0; i < 12; ++i) {
      const double e = error[miss][i];
      for (int j = 0; j < 12; ++j) out.H[i][j] += e * error[miss][j];
      out.f[i] += e * error[miss][12];
    }
  }
}

// Fills in the program in z (12,) and returns how many feet stand, c: the rows A[: 12 + 4c] count.
// `limits` are the least and largest torque of each joint [N·m].
inline int condense(const Dynamics& robot, const TaskAccelerations& tasks, double friction,
                    const double (&limits)[2][12], Workspace& out) {
  constexpr double INFINITE = std::numeric_limits<double>::infinity();
  const auto& feet = robot.feet;
  Vector3 beta[4];
  for (int foot = 0; foot < 4; ++foot) {
    const double* rate = robot.v + 6 + 3 * foot;
    beta[foot] = leg::foot_bias(robot.v, feet.position[foot], feet.jacobian[foot], feet.bias[foot],
                                {rate[0], rate[1], rate[2]});
  }
  const Accelerations q = accelerations(robot, beta);

  std::fill(out.H[0], out.H[0] + 12 * 12, 0.0);
  std::fill(out.f, out.f + 12, 0.0);
  std::fill(out.A[12], out.A[12] + 16 * 12, 0.0);
  std::fill(out.lower, out.lower + 40, -INFINITE);
  std::fill(out.upper, out.upper + 40, INFINITE);
  double torque[12][13] = {};
  double error[18][13] = {};  // of the tasks: trunk linear, trunk angular, feet that swing
  trunk_errors(error, robot, q.trunk, tasks);
  int errors = 6, contacts = 0;
  for (int foot = 0; foot < 4; ++foot) {
    for (int k = 0; k < 3; ++k) joint_torque(torque[3 * foot + k], robot, q, foot, k);
    if (robot.stance[foot]) {
      bound_force(out, foot, contacts, friction);
      contacts += 1;
    } else {
      const Vector3 missing = matrices::apply_transposed(robot.R, tasks.feet[foot]) - beta[foot];
      swing_errors(error + errors, robot, q.trunk, foot, missing);
      errors += 3;
    }
  }
  add_squares(out, error, errors);
  for (int joint = 0; joint < 12; ++joint) {
    std::copy(torque[joint], torque[joint] + 12, out.A[joint]);
    out.torque_offset[joint] = torque[joint][12];
    out.lower[12 + joint] = limits[0][joint] - out.torque_offset[joint];
    out.upper[12 + joint] = limits[1][joint] - out.torque_offset[joint];
  }
  return contacts;
}

// Sets z = −H⁻¹f and returns whether it meets every bound of the first `rows` rows of A: then it is
// optimal. While the robot walks undisturbed no friction or torque limit binds, and the QP needs no
// solver.
inline bool free_minimiser(Workspace& program, int rows) {
  constexpr int n = 12;
  double* x = program.z;
  double L[n][n] = {};  // Cholesky factor of H
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j <= i; ++j) {
      double total = program.H[i][j];
      for (int k = 0; k < j; ++k) total -= L[i][k] * L[j][k];
      if (i > j)
        L[i][j] = total / L[j][j];
      else if (total > 0.0)
        L[i][i] = std::sqrt(total);
      else
        return false;
    }
  }
  for (int i = 0; i < n; ++i) {
    double total = -program.f[i];
    for (int k = 0; k < i; ++k) total -= L[i][k] * x[k];
    x[i] = total / L[i][i];
  }
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k) x[i] -= L[k][i] * x[k];
    x[i] /= L[i][i];
  }
  const auto within = [](double value, double least, double most) { return least <= value && value <= most; };
  for (int i = 0; i < n; ++i)
    if (!within(x[i], program.lower[i], program.upper[i])) return false;
  for (int row = 0; row < rows; ++row) {
    double value = 0.0;
    for (int k = 0; k < n; ++k) value += program.A[row][k] * x[k];
    if (!within(value, program.lower[n + row], program.upper[n + row])) return false;
  }
  return true;
}

// Adds up feedforward and feedback within the limits.
inline void set_torque(Workspace& work) {
  for (int joint = 0; joint < 12; ++joint) {
    const double total = work.feedforward[joint] + work.feedback[joint / 3][joint % 3];
    work.torque[joint] = std::min(std::max(total, work.limits[0][joint]), work.limits[1][joint]);
  }
}

// Sets the torques of the solution in work.z.
inline void take_solution(Workspace& work) {
  for (int joint = 0; joint < 12; ++joint) {
    double total = 0.0;
    for (int k = 0; k < 12; ++k) total += work.A[joint][k] * work.z[k];
    work.feedforward[joint] = total + work.torque_offset[joint];
  }
  set_torque(work);
}

}  // namespace hcbf::task_space
