// Small dense matrices of fixed size.
//
// Written out as loops: at these sizes a call to a library costs more than the arithmetic, and a
// result that no library decides is the same on every machine.
#pragma once
#include <cmath>
#include <utility>

namespace hcbf::matrices {

struct Vector2 {
  double at[2];
  double& operator[](int i) { return at[i]; }
  double operator[](int i) const { return at[i]; }
};

struct Vector3 {
  double at[3];
  double& operator[](int i) { return at[i]; }
  double operator[](int i) const { return at[i]; }
};

struct Matrix3 {
  Vector3 row[3];
  Vector3& operator[](int i) { return row[i]; }
  const Vector3& operator[](int i) const { return row[i]; }
};

inline Vector3 operator+(const Vector3& a, const Vector3& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
inline Vector3 operator-(const Vector3& a, const Vector3& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline Vector3 operator-(const Vector3& a) { return {-a[0], -a[1], -a[2]}; }
inline Vector3 operator*(double s, const Vector3& a) { return {s * a[0], s * a[1], s * a[2]}; }
inline Vector3 operator/(const Vector3& a, double s) { return {a[0] / s, a[1] / s, a[2] / s}; }

inline Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

// Adds a × b to `out`; each is three numbers of a longer row.
inline void add_cross(double* out, const double* a, const double* b) {
  out[0] += a[1] * b[2] - a[2] * b[1];
  out[1] += a[2] * b[0] - a[0] * b[2];
  out[2] += a[0] * b[1] - a[1] * b[0];
}

inline Vector3 apply(const Matrix3& A, const Vector3& x) {
  Vector3 y;
  for (int i = 0; i < 3; ++i) {
    y[i] = 0.0;
    for (int j = 0; j < 3; ++j) y[i] += A[i][j] * x[j];
  }
  return y;
}

inline Vector3 apply_transposed(const Matrix3& A, const Vector3& x) {
  Vector3 y;
  for (int j = 0; j < 3; ++j) {
    y[j] = 0.0;
    for (int i = 0; i < 3; ++i) y[j] += A[i][j] * x[i];
  }
  return y;
}

// The inverse by cofactors. The determinant is held away from zero, so that a singular leg, stretched
// or with its foot on the abad axis, gets a finite answer.
inline Matrix3 inverse_3x3(const Matrix3& A) {
  const double c00 = A[1][1] * A[2][2] - A[1][2] * A[2][1];
  const double c01 = A[1][2] * A[2][0] - A[1][0] * A[2][2];
  const double c02 = A[1][0] * A[2][1] - A[1][1] * A[2][0];
  double determinant = A[0][0] * c00 + A[0][1] * c01 + A[0][2] * c02;
  if (std::abs(determinant) < 1e-5) determinant = determinant >= 0.0 ? 1e-5 : -1e-5;
  const Matrix3 cofactors = {{
      {c00, A[0][2] * A[2][1] - A[0][1] * A[2][2], A[0][1] * A[1][2] - A[0][2] * A[1][1]},
      {c01, A[0][0] * A[2][2] - A[0][2] * A[2][0], A[0][2] * A[1][0] - A[0][0] * A[1][2]},
      {c02, A[0][1] * A[2][0] - A[0][0] * A[2][1], A[0][0] * A[1][1] - A[0][1] * A[1][0]},
  }};
  return {{cofactors[0] / determinant, cofactors[1] / determinant, cofactors[2] / determinant}};
}

// Turns B into A⁻¹B by Gaussian elimination with row pivoting; A is used up.
template <int n, int m>
void solve_in_place(double (&A)[n][n], double (&B)[n][m]) {
  for (int column = 0; column < n; ++column) {
    int pivot = column;
    for (int row = column + 1; row < n; ++row)
      if (std::abs(A[row][column]) > std::abs(A[pivot][column])) pivot = row;
    if (pivot != column) {
      std::swap(A[column], A[pivot]);
      std::swap(B[column], B[pivot]);
    }
    const double scale = 1.0 / A[column][column];
    for (int j = column; j < n; ++j) A[column][j] *= scale;
    for (int j = 0; j < m; ++j) B[column][j] *= scale;
    for (int row = 0; row < n; ++row) {
      const double factor = A[row][column];
      if (row == column || factor == 0.0) continue;
      for (int j = column; j < n; ++j) A[row][j] -= factor * A[column][j];
      for (int j = 0; j < m; ++j) B[row][j] -= factor * B[column][j];
    }
  }
}

}  // namespace hcbf::matrices
