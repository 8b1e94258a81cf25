// What the stages of a cascade do for any number of inputs: each is a projection on a polyhedron.
//
// The inputs that the stages so far leave are {u : u = point + F'z, a u >= b}, F orthonormal. A stage that
// pins a row takes a direction from F instead of adding an equality, so that no later stage can be
// infeasible through rounding. Rows that are paid for get an unknown y_k = sqrt(w_k) delta_k each: a stage
// is then argmin |z - c|^2 + |y|^2 s.t. sqrt(w_k) a_k u + y_k >= sqrt(w_k) t_k, y_k >= sqrt(w_k) m_k.
#pragma once
#include <functional>
#include <utility>

#include <hcbf/program_records.hpp>
#include <hcbf/projection.hpp>

namespace hcbf::polyhedron {

using projection::Outcome, projection::Projection, double_double::Double2;
using Doubles = std::vector<double>;

inline double dot(Vector<const double> v, const Doubles& w) {
  double sum = 0.0;
  for (Index i = 0; i < v.size; ++i) sum += v[i] * w[i];
  return sum;
}

// A row as the stages read it.
struct Row : program_records::Terms {
  Vector<const double> a;
  double value(const Doubles& u) const { return dot(a, u); }
};

// A solver in the place of this core's: writes argmin |x - c|^2 s.t. a x >= b, and returns whether there is
// one; throws where the set is nonempty and it finds none.
using Solver = std::function<bool(const Projection<double>&, bool nonempty, Doubles& x)>;

// The inputs that are left.
struct Set {
  Doubles point, directions;  // (n,), (free, n) orthonormal
  Index free;
  Doubles a, b;   // (k, n) of norms from 1/2 to 1, (k,)
  Doubles known;  // the member nearest u*, where it is known already
};

// A row that a stage pays for: w max(m, t - a u)^2, or w (t - a u)^2.
struct Paid {
  Vector<const double> a;
  double norm, target, weight, least;
  double excess(const Doubles& u) const { return target - least - dot(a, u); }
};

enum class Cost { ONE_SIDED, SQUARE };

// Returns the power of two next above a norm: no digit is lost, and parallel rows stay parallel.
inline double power_above(double norm) {
  int power;
  std::frexp(norm, &power);
  return std::ldexp(1.0, power);
}

class Inputs {
 public:
  Index fallbacks = 0;  // problems that took twice a double's digits, or another solver than the one named

  // U = {u : a u >= b}, of norm `radius` at most; without a solver's name the core answers.
  Inputs(Matrix<const double> a, Vector<const double> b, double radius, Vector<const double> u_nominal,
         double lambda_u, Solver solver)
      : n_(u_nominal.size), radius_(radius), lambda_u_(lambda_u), u_nominal_(u_nominal.begin(), u_nominal.end()),
        solver_(std::move(solver)) {
    whole_.point.assign(n_, 0.0), whole_.directions.assign(n_ * n_, 0.0), whole_.free = n_;
    for (Index i = 0; i < n_; ++i) whole_.directions[i * n_ + i] = 1.0;
    for (Index k = 0; k < b.size; ++k) keep(whole_, a[k], 1.0, b[k]);
    left_ = whole_;
  }

  bool is_point() const { return left_.free == 0; }
  Doubles nearest() { return nearest(left_); }

  // Whether some input meets rows a u >= b.
  bool can_meet(Matrix<const double> a, Vector<const double> b) {
    for (Index k = 0; k < b.size; ++k) {
      const double norm = std::sqrt(dot(a[k], {a[k].begin(), a[k].end()}));
      if (norm > tolerances::ZERO_GRADIENT)
        keep(left_, a[k], norm, b[k]);
      else if (b[k] > 0.0)
        return false;
    }
    return attempt(left_);
  }

  // Writes a_k u_k of each row that is not strict, u_k its own program's solution over U.
  void set_targets(Vector<Row> rows) {
    const Doubles u = nearest(whole_);
    for (Row& row : rows) {
      if (row.strict) continue;
      row.target = row.value(u);
      if (row.target >= row.b || !row.steers()) continue;
      left_ = whole_;
      meet({&row, 1});
      row.target = row.value(nearest(left_));
    }
    left_ = whole_;
  }

  // Keeps the inputs that meet the rows or, where none does, violate them least (min sum delta^2).
  void meet(Vector<Row> rows) {
    const std::size_t before = left_.b.size();
    const Doubles known = left_.known;
    bool met = !known.empty();
    for (const Row& row : rows) {
      met = met && (!row.steers() || row.value(known) >= row.b);
      if (row.steers()) keep(left_, row.a, row.norm, row.b);
    }
    if (met) left_.known = known;
    if (met || attempt(left_)) return;
    left_.a.resize(before * n_), left_.b.resize(before);
    paid_.clear();
    for (const Row& row : rows)
      if (row.steers()) paid_.push_back({row.a, row.norm, row.b, 1.0, 0.0});
    lock(left_, least_cost(left_, Cost::ONE_SIDED));
  }

  // Returns argmin lambda_u |u - u*|^2 + sum w_k max(m_k, b_k - a_k u)^2.
  Doubles relax(Vector<Row> rows) { return choose(rows, Cost::ONE_SIDED); }
  // Returns argmin lambda_u |u - u*|^2 + sum w_k (t_k - a_k u)^2 with the rows' targets t_k.
  Doubles draw(Vector<Row> rows) { return choose(rows, Cost::SQUARE); }

  // Keeps the inputs at which each row has the value that it has at u, one of them.
  void pin(Vector<Row> rows, const Doubles& u) {
    std::vector<Vector<const double>> pinned;
    for (const Row& row : rows)
      if (row.steers()) pinned.push_back(row.a);
    pin(left_, pinned, u);
  }

  // Keeps the inputs at which no row is violated more than at u, one of them.
  void bound(Vector<Row> rows, const Doubles& u) {
    for (const Row& row : rows)
      if (row.steers()) keep(left_, row.a, row.norm, std::min(row.b, row.value(u)));
  }

 private:
  Index n_;
  double radius_, lambda_u_;
  Doubles u_nominal_;
  Solver solver_;
  Set whole_, left_;
  std::vector<Paid> paid_;
  Projection<double> narrow_;
  Projection<Double2> wide_;

  Vector<const double> row_of(const Set& set, Index k) const { return {set.a.data() + k * n_, n_}; }
  Vector<const double> direction(const Set& set, Index i) const { return {set.directions.data() + i * n_, n_}; }

  void keep(Set& set, Vector<const double> a, double norm, double b) const {
    const double divisor = power_above(norm);
    for (const double x : a) set.a.push_back(x / divisor);
    set.b.push_back(b / divisor);
    set.known.clear();
  }

  // Writes a row as it acts on z, and its bound there; unrounded in Double2.
  template <class Number>
  Number reduce(const Set& set, Vector<const double> a, double b, const Number& factor, Number* row) const {
    Number bound(b);
    for (Index i = 0; i < n_; ++i) bound -= Number(a[i]) * Number(set.point[i]);
    for (Index j = 0; j < set.free; ++j) {
      Number along(0.0);
      if (set.free == n_)
        along = Number(a[j]);  // nothing is pinned: z = u
      else
        for (Index i = 0; i < n_; ++i) along += Number(a[i]) * Number(direction(set, j)[i]);
      row[j] = factor * along;
    }
    return factor * bound;
  }

  // Poses the projection of `from` on a set, with the weights of what is paid for times `pull`.
  template <class Number>
  void pose(Projection<Number>& problem, const Set& set, const Doubles& from, Cost cost, double pull) const {
    using std::sqrt;
    const bool square = cost == Cost::SQUARE;
    const Index free = set.free, sides = square ? 2 : 1, count = pull > 0.0 ? paid_.size() : 0;
    const Index n = free + sides * count;
    problem.begin(n);
    for (Index j = 0; j < free; ++j)
      for (Index i = 0; i < n_; ++i)
        problem.centre[j] += Number(direction(set, j)[i]) * (Number(from[i]) - Number(set.point[i]));
    std::vector<Number> row(n);
    const auto add = [&](const Number& bound, double least) {
      double norm = 0.0;
      for (const Number& x : row) norm += static_cast<double>(x) * static_cast<double>(x);
      norm = std::sqrt(norm);
      if (!(norm > least)) return;
      const Number factor(1.0 / power_above(norm));
      for (const Number& x : row) problem.a.push_back(x * factor);
      problem.b.push_back(bound * factor);
    };
    for (Index k = 0; k < static_cast<Index>(set.b.size()); ++k) {
      const Number bound = reduce(set, row_of(set, k), set.b[k], Number(1.0), row.data());
      add(bound, tolerances::DEPENDENT);
    }
    for (Index k = 0; k < count; ++k)
      for (Index side = 0; side < sides; ++side) {
        const Paid& paid = paid_[k];
        const Number root = sqrt(Number(paid.weight) * Number(pull));
        const Number bound = reduce(set, paid.a, paid.target, side == 0 ? root : -root, row.data());
        Number& own = row[free + sides * k + side];
        own = Number(1.0);
        add(bound, 0.0);
        if (!square && paid.least > 0.0) {
          std::fill_n(row.begin(), free, Number(0.0));
          add(root * Number(paid.least), 0.0);
        }
        own = Number(0.0);
      }
  }

  template <class Number>
  Doubles input(const Set& set, const std::vector<Number>& z) const {
    std::vector<Number> u(n_, Number(0.0));
    for (Index i = 0; i < n_; ++i) {
      for (Index j = 0; j < set.free; ++j) u[i] += z[j] * Number(direction(set, j)[i]);
      u[i] += Number(set.point[i]);
    }
    Doubles rounded(n_);
    for (Index i = 0; i < n_; ++i) rounded[i] = static_cast<double>(u[i]);
    return rounded;
  }

  // Projects `from`; returns false where the set is empty, never if it has a point by construction.
  bool project(const Set& set, const Doubles& from, Cost cost, double pull, bool nonempty, Doubles& u) {
    pose(narrow_, set, from, cost, pull);
    if (solver_) {
      Doubles x;
      if (!solver_(narrow_, nonempty, x)) return false;
      u = input(set, x);
      return true;
    }
    const Outcome outcome = narrow_.solve(nonempty);
    if (outcome == Outcome::EMPTY) return false;
    if (outcome == Outcome::FOUND && narrow_.misses_little(tolerances::PRIMAL)) {
      u = input(set, narrow_.x);
      return true;
    }
    return project_widely(set, from, cost, pull, nonempty, u);
  }

  bool project_widely(const Set& set, const Doubles& from, Cost cost, double pull, bool nonempty, Doubles& u) {
    ++fallbacks;
    pose(wide_, set, from, cost, pull);
    if (wide_.solve(nonempty) == Outcome::EMPTY) return false;
    u = input(set, wide_.x);
    return true;
  }

  Doubles nearest(Set& set) {
    if (set.free == 0) return set.point;
    if (set.known.empty()) project(set, u_nominal_, Cost::ONE_SIDED, 0.0, true, set.known);
    return set.known;
  }

  // Finds the member nearest u*; false where there is none.
  bool attempt(Set& set) {
    if (set.free > 0) return project(set, u_nominal_, Cost::ONE_SIDED, 0.0, false, set.known);
    for (Index k = 0; k < static_cast<Index>(set.b.size()); ++k)
      if (dot(row_of(set, k), set.point) < set.b[k] - tolerances::MET) return false;
    return true;
  }

  Doubles choose(Vector<Row> rows, Cost cost) {
    paid_.clear();
    for (const Row& row : rows)
      if (row.weight > 0.0)
        paid_.push_back({row.a, row.norm, cost == Cost::SQUARE ? row.target : row.b, row.weight,
                         cost == Cost::SQUARE ? 0.0 : row.least});
    if (paid_.empty()) return nearest(left_);
    if (left_.free == 0) return left_.point;
    Doubles u;
    if (lambda_u_ > 0.0) {
      project(left_, u_nominal_, cost, 1.0 / lambda_u_, true, u);
      return u;
    }
    Set trial = left_;
    const auto all = paid_;
    u = least_cost(trial, cost);
    paid_ = all;
    if (cost == Cost::ONE_SIDED) {
      lock(trial, u);
    } else {
      std::vector<Vector<const double>> pinned;
      for (const Paid& paid : paid_)
        if (paid.norm > tolerances::ZERO_GRADIENT) pinned.push_back(paid.a);
      pin(trial, pinned, u);
    }
    return nearest(trial);
  }

  // Returns a minimiser of the cost of what is paid for, by proximal points:
  // u_j+1 = argmin sum w_k max(m_k, t_k - a_k u)^2 + eps |u - u_j|^2.
  Doubles least_cost(Set& set, Cost cost) {
    if (set.free == 0) return set.point;
    const auto all = paid_;
    paid_.clear();
    double steepest = 0.0, flattest = INFINITY, farthest = 0.0;
    for (const Paid& paid : all) {
      double slope = 0.0;
      for (Index j = 0; j < set.free; ++j) {
        double along = 0.0;
        for (Index i = 0; i < n_; ++i) along += paid.a[i] * direction(set, j)[i];
        slope += along * along;
      }
      slope = std::sqrt(slope);
      if (!(slope > std::max(tolerances::DEPENDENT * paid.norm, tolerances::ZERO_GRADIENT))) continue;
      if (cost == Cost::ONE_SIDED && !(paid.target - paid.least > -paid.norm * radius_)) continue;  // never paid
      const double root = std::sqrt(paid.weight);
      steepest = std::max(steepest, root * slope), flattest = std::min(flattest, root * slope);
      farthest = std::max(farthest, root * std::abs(paid.target));
      paid_.push_back(paid);
    }
    Doubles u = nearest(set);
    if (!paid_.empty()) {
      const bool doubles = steepest <= tolerances::GRADED_FOR_SOLVERS * flattest &&
                           farthest <= tolerances::GRADED_FOR_SOLVERS * steepest;
      const double unit = 1.0 / (steepest * steepest);
      Doubles found = u;
      if (!doubles || !settle(found, [&](const Doubles& from, Doubles& to) {
            project(set, from, cost, unit * (solver_ ? tolerances::PULL_BY_NAME : tolerances::PULL), true, to);
          })) {
        found = u;
        settle(found, [&](const Doubles& from, Doubles& to) {
          project_widely(set, from, cost, unit * tolerances::PULL_WIDE, true, to);
        });
      }
      u = found;
    }
    paid_ = all;
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
  void lock(Set& set, const Doubles& u) {
    double largest = 0.0, total = 0.0;
    for (const double value : u) largest = std::max(largest, std::abs(value));
    const auto exceeds = [&](const Paid& paid) {
      return paid.excess(u) > tolerances::MET * (1.0 + largest) * std::max(paid.norm, tolerances::ZERO_GRADIENT);
    };
    for (const Paid& paid : paid_)
      if (exceeds(paid)) total += paid.weight * paid.excess(u) * paid.excess(u);
    std::vector<Vector<const double>> pinned;
    for (const Paid& paid : paid_) {
      if (!(paid.norm > tolerances::ZERO_GRADIENT)) continue;
      if (exceeds(paid) && std::sqrt(paid.weight) * paid.excess(u) > tolerances::NEGLIGIBLE * std::sqrt(total))
        pinned.push_back(paid.a);
      else
        keep(set, paid.a, paid.norm, std::min(paid.target - paid.least, dot(paid.a, u)));
    }
    pin(set, pinned, u);
  }

  // Keeps the inputs on which rows have their value at u, one of them: rounding must not take it out, so no
  // bound stays above its value at u.
  void pin(Set& set, const std::vector<Vector<const double>>& rows, const Doubles& u) {
    for (Index k = 0; k < static_cast<Index>(set.b.size()); ++k)
      set.b[k] = std::min(set.b[k], dot(row_of(set, k), u));
    const Index before = set.free;
    std::vector<Doubles> within;  // unit rows' parts along the free directions, scaled to length 1
    for (const Vector<const double> a : rows) {
      const double norm = std::sqrt(dot(a, {a.begin(), a.end()}));
      const Doubles z = coordinates(set, {a.begin(), a.end()});
      const double length = std::sqrt(dot({z.data(), set.free}, z));
      if (!(length > tolerances::DEPENDENT * norm)) continue;
      Doubles part(n_, 0.0);
      for (Index j = 0; j < set.free; ++j)
        for (Index i = 0; i < n_; ++i) part[i] += z[j] / length * direction(set, j)[i];
      within.push_back(part);
    }
    while (set.free > 0) {  // the row that is pinned next is the one with most freedom left
      double most = tolerances::DEPENDENT;
      Doubles longest;
      for (const Doubles& part : within) {
        Doubles z = coordinates(set, part);
        const double length = std::sqrt(dot({z.data(), set.free}, z));
        if (length > most) most = length, longest = std::move(z);
      }
      if (longest.empty()) break;
      drop(set, longest, most);
    }
    set.known.clear();
    if (set.free < before) set.point = u;
  }

  Doubles coordinates(const Set& set, const Doubles& v) const {
    Doubles z(set.free);
    for (Index j = 0; j < set.free; ++j) z[j] = dot(direction(set, j), v);
    return z;
  }

  // Takes the direction z of length `length` from the free ones: Householder's reflection makes it the first.
  void drop(Set& set, Doubles z, double length) const {
    z[0] += z[0] < 0.0 ? -length : length;
    const double square = dot({z.data(), set.free}, z);
    for (Index i = 0; i < n_; ++i) {
      double along = 0.0;
      for (Index j = 0; j < set.free; ++j) along += z[j] * set.directions[j * n_ + i];
      for (Index j = 0; j < set.free; ++j) set.directions[j * n_ + i] -= 2.0 * along / square * z[j];
    }
    set.directions.erase(set.directions.begin(), set.directions.begin() + n_);
    --set.free;
  }
};

}  // namespace hcbf::polyhedron
