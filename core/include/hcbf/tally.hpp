// What one control step of one robot came to: the numbers of `task` for N robots, in one memory, of
// which every entry of the infos is a part.
#pragma once
#include <cmath>
#include <vector>

#include <hcbf/shape_terms.hpp>
#include <hcbf/task.hpp>

namespace hcbf::tally {

// The head of the memory: numbers of the infos, as many terms as there may be, and the reward.
enum Head { COST, TRACKING_ERROR, IS_SUCCESS, TERMS, REWARD = 6, HEAD };

struct Scene {  // M conditions of one robot
  Vector<const Index> kind;
  Matrix<const double> parameters;
  Vector<const Index> priority;
};

struct Step {
  const double* u;          // (2,) the applied acceleration [m/s²]
  double before, after;     // ‖p_ref − p‖ [m]
  bool success;             // whether the robot is at rest at the goal and the reference has ended
  bool reaches;             // whether the task is to reach the goal
  Index ranks;              // R
};

// The lesser of two numbers, NaN where one is.
inline double lesser(double a, double b) { return b < a || std::isnan(b) ? b : a; }

// Writes the memory. `h` (k, M): on the way, the last at the end; `sensed` (M, 4): what a policy sees at
// the end; `x` (4,): on which the loop is closed; `reference` (6,): at the end.
inline void count(Matrix<const double> h, Matrix<const double> sensed, Vector<const Index> kind,
                  Vector<const Index> priority, const double* x, const double* reference, const Step& step,
                  Vector<double> memory) {
  const Index total = h.columns, violation = HEAD + 2 * total, seen = HEAD + 3 * total;
  const Vector<double> at_end = memory.part(HEAD, HEAD + total), least = memory.part(HEAD + total, violation);
  std::copy_n(h[h.rows - 1].data, total, at_end.data);
  std::copy_n(h.data, total, least.data);
  for (Index i = 1; i < h.rows; ++i)
    for (Index k = 0; k < total; ++k) least[k] = lesser(least[k], h(i, k));
  for (Index k = 0; k < total; ++k) memory[violation + k] = std::max(0.0, -at_end[k]);
  memory[COST] = task::write_costs(least, kind, priority, memory.part(seen, seen + step.ranks));
  task::write_observation(x, reference, sensed, memory.part(seen + step.ranks, memory.size));
  memory[TRACKING_ERROR] = step.after, memory[IS_SUCCESS] = step.success;
  const double effort = task::effort_cost(step.u[0], step.u[1]);
  double* terms = &memory[TERMS];
  if (step.reaches) {
    terms[0] = step.before - step.after, terms[1] = task::GOAL_REWARD * step.success, terms[2] = effort;
    memory[REWARD] = terms[0] + terms[1] + terms[2];
  } else {
    terms[0] = -step.after, terms[1] = effort;
    memory[REWARD] = terms[0] + terms[1];
  }
}

// Looks at conditions that are all built in, on the way `path` (k, 4) at `times` (k,) and at the end,
// and counts.
inline void look(const Scene& scene, Vector<const double> atlas, Matrix<const double> path,
                 Vector<const double> times, const double* x, double time, const double* reference,
                 const Step& step, Vector<double> memory) {
  const Index total = scene.kind.size;
  std::vector<double> numbers(total * (path.rows + 5));
  const Matrix<double> h{numbers.data(), path.rows, total}, last{h.data + total * path.rows, 1, total};
  const Cube<double> sensed{last.data + total, 1, total, 4};
  const Matrix<const Index> kind{scene.kind.data, 1, total};
  const Cube<const double> parameters{scene.parameters.data, 1, total, layout::WIDTH};
  shape_terms::values(kind, parameters, atlas, path, times, h);
  shape_terms::sense(kind, parameters, atlas, {x, 1, 4}, {&time, 1}, last, sensed);
  count(h, sensed[0], scene.kind, scene.priority, x, reference, step, memory);
}

}  // namespace hcbf::tally
