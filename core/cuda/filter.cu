// Rows and lex-cbf-qp of N states, a thread a state, for NVRTC and, as a loop, for a C++ compiler.
//
// NVRTC takes every function for the device's (-default-device), so that the headers need no marks. It
// has no standard library: libcu++ is its namespace std here, and a vector has a fixed room.
#ifdef __CUDACC_RTC__
#include <cuda/std/algorithm>
#include <cuda/std/array>
#include <cuda/std/cmath>
#include <cuda/std/cstddef>
#include <cuda/std/cstdint>
#include <cuda/std/cstring>
#include <cuda/std/inplace_vector>
#include <cuda/std/limits>
#include <cuda/std/optional>
#include <cuda/std/utility>

namespace device {
using namespace cuda::std;
// A vector of fixed room. It copies what it holds; inplace_vector copies all its room.
template <class T, size_t ROOM = sizeof(T) == 8 ? 72 : 24>  // numbers: a stage each; else: corners, rows
struct vector : inplace_vector<T, ROOM> {
  using inplace_vector<T, ROOM>::inplace_vector;
  vector() = default;
  vector(const vector& other) { *this = other; }
  __noinline__ vector& operator=(const vector& other) {
    this->clear();
#pragma unroll 1
    for (const T& item : other) this->unchecked_push_back(item);
    return *this;
  }
  __noinline__ void swap(vector& other) {
    const vector kept = other;
    other = *this, *this = kept;
  }
};
}  // namespace device
#define std device
#undef INFINITY
#define INFINITY device::numeric_limits<double>::infinity()
#endif

#include <hcbf/cascade.hpp>
#include <hcbf/rows.hpp>

#ifdef __CUDACC_RTC__
// Inlined wherever they are called, these fill a megabyte; where a call ends, the threads of a warp meet again.
namespace hcbf::polygon {
using Points = Vector<const Point>;
template __noinline__ void cut(Polygon&, const Line&, double);
template __noinline__ void keep_face(Polygon&, const Point&, const double&, double);
template __noinline__ Range<double> span<double>(Points, const Point&);
template __noinline__ bool contains<double>(Points, const Point&);
template __noinline__ Point descend<double>(Points, const LeastSquares&, const Point&);
template __noinline__ Point minimise(const Polygon&, const LeastSquares&, const Point&, double, Polygon&);
template __noinline__ void LeastSquaresOf<double>::add(const double&, double, double);
}  // namespace hcbf::polygon
#endif

namespace hcbf {

constexpr Index MOST_ROWS = 16;  // of a state

struct Problem {  // N states of m conditions, in one U of four corners
  Index count, m;
  RowSettings settings;
  double corners[4][2];
  const double *u_nominal, *x, *t, *parameters;  // (N, 2), (N, 4), (N,), (N, m, WIDTH)
  const Index *kind, *priority;                  // (N, m)
  double *u, *slack, *h;                         // (N, 2), (N, m), (N, m), written to
  Index* status;                                 // (N,) written to
};

// Filters u* of state i.
inline void filter_one(const Problem& p, Index i) {
  constexpr double STRICT[2] = {0.0, INF};  // every rank is decided before the next
  double a[MOST_ROWS][2], b[MOST_ROWS], alpha2_psi[MOST_ROWS], delta[MOST_ROWS];
  double* h = p.h + i * p.m;
  for (Index k = 0; k < p.m; ++k) {
    const Index at = i * p.m + k;
    const auto row = rows::row<double>(p.kind[at], p.parameters + at * layout::WIDTH, {0.0, 0.0, 0.0},
                                       p.x + 4 * i, p.t[i], p.settings, a[k]);
    b[k] = row.b, h[k] = row.h, alpha2_psi[k] = row.alpha2_psi;
  }
  using namespace program_records;
  const Settings plan{Lower::RELAXED, true, Lock::BOUND, true, false, p.settings.u_max, 1.0, false,
                      {p.corners[0], 1, 4, 2}, {STRICT, 1, 2}};
  Workspace w;
  w.grow(p.settings.u_max, 4, p.m);
  p.status[i] = cascade::filter_state<double>(
      plan, polygon::points(plan.vertices[0]), plan.weights[0], {p.u_nominal[2 * i], p.u_nominal[2 * i + 1]},
      {{a[0], p.m, 2}, {b, p.m}, {h, p.m}, {p.priority + i * p.m, p.m}, {alpha2_psi, p.m}},
      {p.u + 2 * i, 2}, {p.slack + i * p.m, p.m}, {delta, p.m}, w);
}

}  // namespace hcbf

#ifdef __CUDACC_RTC__
extern "C" __global__ void filter(const hcbf::Problem p) {
  const hcbf::Index i = static_cast<hcbf::Index>(blockIdx.x) * blockDim.x + threadIdx.x;
  if (i < p.count) filter_one(p, i);
}
#else
extern "C" void filter(const hcbf::Problem& p) {
  for (hcbf::Index i = 0; i < p.count; ++i) filter_one(p, i);
}
#endif
