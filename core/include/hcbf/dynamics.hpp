// Rigid-body dynamics of a trunk with four abad–hip–knee legs.
//
// Everything is written in the trunk's axes at the trunk's origin, as spatial vectors with the linear
// part first: there the inertias of bodies simply add up, and the trunk's rows need no transformation.
// Pinocchio computes the same terms for any robot and is what these are tested against; for one kind of
// robot they need neither its tree nor its memory.
//
// Source: R. Featherstone, Rigid Body Dynamics Algorithms (2008), chapters 5 and 6.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/constants.hpp>
#include <hcbf/feet.hpp>
#include <hcbf/leg.hpp>
#include <hcbf/matrices.hpp>

namespace hcbf::dynamics {

using leg::FootKinematics;
using leg::LegGeometry;
using matrices::add_cross;
using matrices::Matrix3;
using matrices::Vector3;

// [rad/s] over which dry friction reverses, so that noise cannot chatter
constexpr double FRICTION_VELOCITY = 0.1;

struct Dynamics {       // the robot at one instant, as its QPs see it: M q̈ + bias = Sᵀτ + J_cᵀF
  double M[18][18];     // mass matrix
  double bias[18];      // forces, joint losses included
  double v[18];         // trunk linear and angular in the trunk's axes, then the joints
  Matrix3 R;            // trunk → world
  FootKinematics feet;  // in the trunk's axes
  bool stance[4];       // feet that do not move
};

struct Bodies {         // inertias of the trunk and, leg by leg, of hip, thigh and calf; losses of the joints
  double mass[13];      // [kg]
  Vector3 com[13];      // centre of mass in the body's own axes [m]
  Matrix3 inertia[13];  // about the centre of mass, in the body's own axes [kg·m²]
  double armature[12];  // of the joints [kg·m²]
  double damping[12];   // [N·m·s/rad]
  double dry_friction[12];  // [N·m]
};

// Adds to `out` how a velocity carries a motion vector along; each is of six numbers.
inline void add_motion_cross(double* out, const double* velocity, const double* motion) {
  add_cross(out, velocity + 3, motion);
  add_cross(out, velocity, motion + 3);
  add_cross(out + 3, velocity + 3, motion + 3);
}

// Adds to `out` how a velocity carries a force vector along.
inline void add_force_cross(double* out, const double* velocity, const double* force) {
  add_cross(out, velocity + 3, force);
  add_cross(out + 3, velocity + 3, force + 3);
  add_cross(out + 3, velocity, force);
}

// Adds a body of mass m [kg] to the spatial inertia about the trunk's origin.
//
// `com` is its centre of mass c in the trunk's axes [m], `about_com` its inertia about c in the body's
// axes [kg·m²], and `turn` the rotation body → trunk axes.
template <int columns>  // of the matrix of which `inertia` is the first six rows and columns
void add_inertia(double (*inertia)[columns], double mass, const Vector3& com, const Matrix3& about_com,
                 const Matrix3& turn) {
  const double squared = com[0] * com[0] + com[1] * com[1] + com[2] * com[2];
  for (int i = 0; i < 3; ++i) {
    inertia[i][i] += mass;
    inertia[3 + i][3 + i] += mass * squared;
    Vector3 half;  // of turn · about_com · turnᵀ
    for (int j = 0; j < 3; ++j)
      half[j] = turn[i][0] * about_com[0][j] + turn[i][1] * about_com[1][j] + turn[i][2] * about_com[2][j];
    for (int j = 0; j < 3; ++j) {
      const double turned = half[0] * turn[j][0] + half[1] * turn[j][1] + half[2] * turn[j][2];
      inertia[3 + i][3 + j] += turned - mass * com[i] * com[j];
    }
  }
  for (int i = 0; i < 3; ++i) {  // −m c× above, m c× below the diagonal
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    inertia[j][3 + k] += mass * com[i];
    inertia[k][3 + j] -= mass * com[i];
    inertia[3 + j][k] -= mass * com[i];
    inertia[3 + k][j] += mass * com[i];
  }
}

// Adds I A + V ×* I V, the force that moves a body so.
template <int columns>
void add_force(double* force, const double (*inertia)[columns], const double* V, const double* A) {
  double momentum[6];
  for (int i = 0; i < 6; ++i) {
    double along_V = 0.0, along_A = 0.0;
    for (int k = 0; k < 6; ++k) {
      along_V += inertia[i][k] * V[k];
      along_A += inertia[i][k] * A[k];
    }
    momentum[i] = along_V;
    force[i] += along_A;
  }
  add_force_cross(force, V, momentum);
}

struct LegPlacement {  // of a leg's three joints and links, in the trunk's axes
  Vector3 axes[3];
  Vector3 places[3];  // of the joints [m]
  Matrix3 turns[3];   // link → trunk
};

// Where abad, hip and knee [rad] bring a leg.
inline LegPlacement place_leg(const LegGeometry& legs, int leg, const Vector3& joints) {
  LegPlacement placed;
  const double sa = std::sin(joints[0]), ca = std::cos(joints[0]);
  double pitch = 0.0;
  for (int j = 0; j < 3; ++j) {
    if (j > 0) pitch += joints[j];
    const double s = std::sin(pitch), c = std::cos(pitch);
    placed.turns[j] = {{{c, 0.0, s}, {sa * s, ca, -sa * c}, {-ca * s, sa, ca * c}}};
    placed.axes[j] = j == 0 ? Vector3{1.0, 0.0, 0.0} : Vector3{0.0, ca, sa};
  }
  for (int i = 0; i < 3; ++i) {
    placed.places[0][i] = legs.hip[leg][i];
    placed.places[1][i] = placed.places[0][i] + legs.offset[leg] * placed.turns[0][i][1];
    placed.places[2][i] = placed.places[1][i] - legs.thigh * placed.turns[1][i][2];
  }
  return placed;
}

// Fills in M (18, 18) and the bias (18,) of M q̈ + bias = Sᵀτ + JᵀF.
//
// The bias holds Coriolis, centrifugal and gravity forces, and the joints' damping and dry friction:
// without the losses the trunk pitches by several degrees. v (18,) is the trunk's velocity, linear and
// angular in the trunk's axes, then the joints'.
inline void rigid_body_terms(const Bodies& bodies, const LegGeometry& legs, const Matrix3& R, const double* v,
                             const Vector3* joints, double (&M)[18][18], double (&bias)[18]) {
  constexpr Matrix3 EYE = {{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}};
  std::fill(M[0], M[0] + 18 * 18, 0.0);
  std::fill(bias, bias + 18, 0.0);
  double inertia[3][6][6];  // of a link and all beyond it
  double force[3][6];       // on a link and all beyond it
  double S[3][6], V[3][6], A[3][6], reaction[6];
  // the ground accelerates upwards
  const double rest[6] = {constants::GRAVITY * R[2][0], constants::GRAVITY * R[2][1],
                          constants::GRAVITY * R[2][2]};

  // the trunk's block of M is the inertia of everything
  add_inertia(M, bodies.mass[0], bodies.com[0], bodies.inertia[0], EYE);
  add_force(bias, M, v, rest);
  for (int leg = 0; leg < 4; ++leg) {
    const LegPlacement placed = place_leg(legs, leg, joints[leg]);
    for (int j = 0; j < 3; ++j) {
      const double rate = v[6 + 3 * leg + j];
      const double* before_V = j == 0 ? v : V[j - 1];
      const double* before_A = j == 0 ? rest : A[j - 1];
      for (int i = 0; i < 3; ++i) {
        S[j][i] = 0.0;
        S[j][3 + i] = placed.axes[j][i];
      }
      add_cross(S[j], placed.places[j].at, placed.axes[j].at);
      for (int i = 0; i < 6; ++i) {
        V[j][i] = before_V[i] + S[j][i] * rate;
        reaction[i] = 0.0;
      }
      add_motion_cross(reaction, before_V, S[j]);
      for (int i = 0; i < 6; ++i) A[j][i] = before_A[i] + reaction[i] * rate;

      const int body = 1 + 3 * leg + j;
      Vector3 com = placed.places[j];
      for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) com[i] += placed.turns[j][i][k] * bodies.com[body][k];
      std::fill(inertia[j][0], inertia[j][0] + 36, 0.0);
      add_inertia(inertia[j], bodies.mass[body], com, bodies.inertia[body], placed.turns[j]);
      std::fill(force[j], force[j] + 6, 0.0);
      add_force(force[j], inertia[j], V[j], A[j]);
    }

    for (int j = 2; j >= 0; --j) {
      const int row = 6 + 3 * leg + j;
      for (int i = 0; j < 2 && i < 6; ++i) {
        force[j][i] += force[j + 1][i];
        for (int k = 0; k < 6; ++k) inertia[j][i][k] += inertia[j + 1][i][k];
      }
      for (int i = 0; i < 6; ++i) {
        bias[row] += S[j][i] * force[j][i];
        double total = 0.0;
        for (int k = 0; k < 6; ++k) total += inertia[j][i][k] * S[j][k];
        reaction[i] = M[i][row] = M[row][i] = total;
      }
      for (int ancestor = 0; ancestor <= j; ++ancestor) {
        double total = 0.0;
        for (int i = 0; i < 6; ++i) total += S[ancestor][i] * reaction[i];
        M[6 + 3 * leg + ancestor][row] = M[row][6 + 3 * leg + ancestor] = total;
      }
    }
    for (int i = 0; i < 6; ++i) {
      bias[i] += force[0][i];
      for (int k = 0; k < 6; ++k) M[i][k] += inertia[0][i][k];
    }
  }

  for (int joint = 0; joint < 12; ++joint) {
    const double rate = v[6 + joint];
    M[6 + joint][6 + joint] += bodies.armature[joint];
    bias[6 + joint] += bodies.damping[joint] * rate;
    bias[6 + joint] += bodies.dry_friction[joint] * std::tanh(rate / FRICTION_VELOCITY);
  }
}

}  // namespace hcbf::dynamics
