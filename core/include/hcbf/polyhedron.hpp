// What the stages of a cascade do for any number of inputs: each is a projection on a polyhedron.
//
// Rows that are paid for get an unknown y_k = sqrt(w_k) delta_k each: a stage is then
// argmin |z - c|^2 + |y|^2 s.t. sqrt(w_k) a_k u + y_k >= sqrt(w_k) t_k, y_k >= sqrt(w_k) m_k.
#pragma once
#include <functional>
#include <utility>

#include <hcbf/free_inputs.hpp>
#include <hcbf/program_records.hpp>

namespace hcbf::polyhedron {

using double_double::Double2;
using free_inputs::Doubles, free_inputs::FreeInputs, free_inputs::Gradient;
using projection::Outcome, projection::Projection;

// A row as the stages read it.
struct Row : program_records::Terms {
  Gradient a;
  double value(const Doubles& u) const { return free_inputs::dot(a, u.data()); }
  double excess(const Doubles& u) const { return b - least - value(u); }
};

// A solver in the place of the core's: writes argmin |x - c|^2 s.t. a x >= b, and returns whether there is
// one; throws where the set is nonempty and it finds none.
using Solver = std::function<bool(const Projection<double>&, bool nonempty, Doubles& x)>;

// What a row pays: w max(m, b - a u)^2, or w (b - a u)^2.
enum class Cost { ONE_SIDED, SQUARE };

class Inputs {
 public:
  Index fallbacks = 0;  // projections that took twice a double's digits

  // U = {u : a u >= b}, of norm `radius` at most; without a solver's name the core answers.
  Inputs(Matrix<const double> a, Vector<const double> b, double radius, Vector<const double> u_nominal,
         double lambda_u, Solver solver)
      : radius_(radius), lambda_u_(lambda_u), solver_(std::move(solver)),
        u_nominal_(u_nominal.begin(), u_nominal.end()), whole_(a, b), left_(whole_) {}

  bool is_point() const { return left_.free == 0; }
  Doubles nearest() { return nearest(left_); }

  // Writes a_k u_k of each row that is not strict, u_k its own program's solution over U.
  void set_targets(Vector<Row> rows) {
    const Doubles u = nearest(whole_);
    for (Row& row : rows) {
      if (row.strict) continue;
      row.target = row.value(u);
      if (row.target >= row.b || !row.steers()) continue;
      left_ = whole_;
      meet({&row, 1});
      row.target = row.value(nearest());
    }
    left_ = whole_;
  }

  // Keeps the inputs that meet the rows or, where none does, violate them least (min sum delta^2).
  void meet(Vector<Row> rows) {
    const FreeInputs before = left_;
    bool met = !before.known.empty();
    for (const Row& row : rows) {
      met = met && (!row.steers() || row.value(before.known) >= row.b);
      left_.keep(row.a, row.norm, row.b);
    }
    if (met) left_.known = before.known;
    if (met || attempt()) return;
    left_ = before;
    paid_.assign(rows.begin(), rows.end());
    for (Row& row : paid_) row.weight = 1.0, row.least = 0.0;
    lock(left_, least_cost(left_, Cost::ONE_SIDED));
  }

  // Returns argmin lambda_u |u - u*|^2 + sum w_k max(m_k, b_k - a_k u)^2.
  Doubles relax(Vector<Row> rows) {
    paid_.assign(rows.begin(), rows.end());
    return choose(Cost::ONE_SIDED);
  }

  // Returns argmin lambda_u |u - u*|^2 + sum w_k (t_k - a_k u)^2 with the rows' targets t_k.
  Doubles draw(Vector<Row> rows) {
    paid_.assign(rows.begin(), rows.end());
    for (Row& row : paid_) row.b = row.target, row.least = 0.0;
    return choose(Cost::SQUARE);
  }

  // Keeps the inputs at which each row has the value that it has at u, one of them.
  void pin(Vector<Row> rows, const Doubles& u) {
    std::vector<Gradient> pinned;
    for (const Row& row : rows)
      if (row.steers()) pinned.push_back(row.a);
    left_.pin(pinned, u);
  }

  // Keeps the inputs at which no row is violated more than at u, one of them.
  void bound(Vector<Row> rows, const Doubles& u) {
    for (const Row& row : rows) left_.keep(row.a, row.norm, std::min(row.b, row.value(u)));
  }

 private:
  double radius_, lambda_u_;
  Solver solver_;
  Doubles u_nominal_;
  FreeInputs whole_, left_;
  std::vector<Row> paid_;  // the rows that a stage pays for
  Projection<double> narrow_;
  Projection<Double2> wide_;

  // Poses the projection of `from` on a set, with the weights of what is paid for times `pull`.
  template <class Number>
  void pose(Projection<Number>& problem, const FreeInputs& set, const Doubles& from, Cost cost,
            double pull) const {
    using std::sqrt;
    const Index n = set.n, free = set.free, sides = cost == Cost::SQUARE ? 2 : 1;
    const Index count = pull > 0.0 ? paid_.size() : 0;
    problem.begin(free + sides * count);
    for (Index j = 0; j < free; ++j)
      for (Index i = 0; i < n; ++i)
        problem.centre[j] += Number(set.direction(j)[i]) * (Number(from[i]) - Number(set.point[i]));
    std::vector<Number> row(free + sides * count, Number(0.0));
    // writes factor a F, and returns factor (b - a point); unrounded in Double2
    const auto reduce = [&](Gradient a, double b, const Number& factor) {
      Number bound(b);
      for (Index i = 0; i < n; ++i) bound -= Number(a[i]) * Number(set.point[i]);
      for (Index j = 0; j < free; ++j) {
        Number along(free == n ? a[j] : 0.0);  // where nothing is pinned, z is u
        for (Index i = 0; free < n && i < n; ++i) along += Number(a[i]) * Number(set.direction(j)[i]);
        row[j] = factor * along;
      }
      return factor * bound;
    };
    for (Index k = 0; k < set.count(); ++k)
      problem.add(row, reduce(set.row(k), set.b[k], Number(1.0)), tolerances::DEPENDENT);
    for (Index k = 0; k < count; ++k)
      for (Index side = 0; side < sides; ++side) {
        const Number root = sqrt(Number(paid_[k].weight) * Number(pull));
        const Number bound = reduce(paid_[k].a, paid_[k].b, side == 0 ? root : -root);
        Number& own = row[free + sides * k + side];
        own = Number(1.0);
        problem.add(row, bound, 0.0);
        if (paid_[k].least > 0.0) {
          std::fill_n(row.begin(), free, Number(0.0));
          problem.add(row, root * Number(paid_[k].least), 0.0);
        }
        own = Number(0.0);
      }
  }

  template <class Number>
  static Doubles input(const FreeInputs& set, const std::vector<Number>& z) {
    Doubles u(set.n);
    for (Index i = 0; i < set.n; ++i) {
      Number sum(0.0);
      for (Index j = 0; j < set.free; ++j) sum += z[j] * Number(set.direction(j)[i]);
      u[i] = static_cast<double>(sum + Number(set.point[i]));
    }
    return u;
  }

  // Projects `from`; returns false where the set is empty, never if it has a point by construction.
  bool project(const FreeInputs& set, const Doubles& from, Cost cost, double pull, bool nonempty,
               Doubles& u) {
    pose(narrow_, set, from, cost, pull);
    Doubles x;
    if (solver_) {
      if (!solver_(narrow_, nonempty, x)) return false;
      u = input(set, x);
      return true;
    }
    const Outcome outcome = narrow_.solve(nonempty);
    if (outcome == Outcome::EMPTY) return false;
    if (outcome == Outcome::FAILED) return project_widely(set, from, cost, pull, nonempty, u);
    u = input(set, narrow_.x);
    return true;
  }

  bool project_widely(const FreeInputs& set, const Doubles& from, Cost cost, double pull, bool nonempty,
                      Doubles& u) {
    ++fallbacks;
    pose(wide_, set, from, cost, pull);
    if (wide_.solve(nonempty) == Outcome::EMPTY) return false;
    u = input(set, wide_.x);
    return true;
  }

  Doubles nearest(FreeInputs& set) {
    if (set.free == 0) return set.point;
    if (set.known.empty()) project(set, u_nominal_, Cost::ONE_SIDED, 0.0, true, set.known);
    return set.known;
  }

  // Finds the member of what is left that is nearest u*; false where there is none.
  bool attempt() {
    if (left_.free > 0) return project(left_, u_nominal_, Cost::ONE_SIDED, 0.0, false, left_.known);
    for (Index k = 0; k < left_.count(); ++k)
      if (free_inputs::dot(left_.row(k), left_.point.data()) < left_.b[k] - tolerances::MET) return false;
    return true;
  }

  // Returns the minimiser of lambda_u |u - u*|^2 and the cost; for lambda_u = 0 that nearest u*.
  Doubles choose(Cost cost) {
    const auto is_free = [](const Row& row) { return !(row.weight > 0.0); };
    paid_.erase(std::remove_if(paid_.begin(), paid_.end(), is_free), paid_.end());
    if (paid_.empty() || is_point()) return nearest();
    Doubles u;
    if (lambda_u_ > 0.0) {
      project(left_, u_nominal_, cost, 1.0 / lambda_u_, true, u);
      return u;
    }
    FreeInputs trial = left_;
    u = least_cost(trial, cost);
    if (cost == Cost::ONE_SIDED) {
      lock(trial, u);
    } else {
      std::vector<Gradient> all;
      for (const Row& row : paid_) all.push_back(row.a);
      trial.pin(all, u);
    }
    return nearest(trial);
  }

  // Returns a minimiser of the cost of what is paid for.
  Doubles least_cost(FreeInputs& set, Cost cost) {
    const std::vector<Row> all = paid_;
    paid_.clear();
    double steepest = 0.0, flattest = INFINITY, farthest = 0.0;
    for (const Row& row : all) {
      const double root = std::sqrt(row.weight), slope = set.slope(row.a);
      const bool pays = cost == Cost::SQUARE || row.b - row.least > -row.norm * radius_;  // somewhere in U
      if (!pays || !(slope > std::max(tolerances::DEPENDENT * row.norm, tolerances::ZERO_GRADIENT))) continue;
      steepest = std::max(steepest, root * slope), flattest = std::min(flattest, root * slope);
      farthest = std::max(farthest, root * std::abs(row.b));
      paid_.push_back(row);
    }
    Doubles u = nearest(set);
    if (!paid_.empty()) u = proximal(set, u, cost, steepest, flattest, farthest);
    paid_ = all;
    return u;
  }

  // The same by proximal points, u_j+1 = argmin cost + eps |u - u_j|^2.
  Doubles proximal(const FreeInputs& set, const Doubles& first, Cost cost, double steepest, double flattest,
                   double farthest) {
    const double limit = tolerances::GRADED_FOR_SOLVERS, unit = 1.0 / (steepest * steepest);
    Doubles u = first;
    if (steepest <= limit * flattest && farthest <= limit * steepest) {
      const double pull = unit * (solver_ ? tolerances::PULL_BY_NAME : tolerances::PULL);
      const auto step = [&](const Doubles& from, Doubles& to) { project(set, from, cost, pull, true, to); };
      if (settle(u, step)) return u;
    }
    u = first;
    const double pull =
        std::min(tolerances::PULL_OF_FLATTEST / (flattest * flattest), tolerances::LARGEST_PULL * unit);
    settle(u, [&](const Doubles& from, Doubles& to) { project_widely(set, from, cost, pull, true, to); });
    return u;
  }

  // Iterates u -> step(u); returns whether it comes to rest.
  template <class Step>
  static bool settle(Doubles& u, const Step& step) {
    for (int turn = 0; turn < 20; ++turn) {
      const Doubles previous = u;
      step(previous, u);
      double moved = 0.0, largest = 0.0;
      for (std::size_t i = 0; i < u.size(); ++i)
        moved = std::max(moved, std::abs(u[i] - previous[i])), largest = std::max(largest, std::abs(u[i]));
      if (moved <= tolerances::SETTLED * (1.0 + largest)) return true;
    }
    return false;
  }

  // Keeps the minimisers of a stage, of which u is one: each violated row has one value on all of them and
  // is pinned, the others are met.
  void lock(FreeInputs& set, const Doubles& u) const {
    double largest = 0.0, total = 0.0;
    for (const double value : u) largest = std::max(largest, std::abs(value));
    const auto cost_of = [&](const Row& row) {  // 0 where rounding alone violates it
      const double excess = row.excess(u);
      return excess > tolerances::MET * (1.0 + largest) * row.norm ? row.weight * excess * excess : 0.0;
    };
    for (const Row& row : paid_)
      if (row.steers()) total += cost_of(row);
    const double negligible = tolerances::NEGLIGIBLE * tolerances::NEGLIGIBLE * total;
    std::vector<Gradient> pinned;
    for (const Row& row : paid_)
      if (row.steers() && cost_of(row) > negligible)
        pinned.push_back(row.a);
      else
        set.keep(row.a, row.norm, std::min(row.b - row.least, row.value(u)));
    set.pin(pinned, u);
  }
};

}  // namespace hcbf::polyhedron
