// The filtered input u as a differentiable function of all that it is made from.
//
// The variables of one state are one vector: u* (2), x (4), and of each barrier its block (WIDTH) and
// the margin m, ṁ, m̈ (3). Rows and the program are run on dual numbers, so that derivatives come from
// the text that computes u. Both are differentiated one after the other: with θ the variables of a
// row and r its numbers, (∂u/∂θ)ᵀ w = Σ_k (∂r_k/∂θ)ᵀ (∂u/∂r_k)ᵀ w.
#pragma once
#include <hcbf/cascade.hpp>
#include <hcbf/rows.hpp>

namespace hcbf::gradient {

using polygon::Point, polygon::PointOf, program_records::Settings, program_records::WorkspaceOf;

constexpr Index U_NOMINAL = 2, STATE = 4, MARGIN = 3;              // of the variables, in this order
constexpr Index OF_BARRIER = layout::WIDTH + MARGIN;               // of each barrier
constexpr Index OF_ROW = STATE + OF_BARRIER, BARRIERS = U_NOMINAL + STATE;
constexpr Index NUMBERS = 5;  // of a row: a (2), b, h, α₂(ψ)
constexpr int PASS = 8;       // derivatives of a program that are carried at once

// A row that is met by more, relative to |a_k| max|u| + |b_k|, does not move u.
constexpr double MET = 1e-6;
// u has no derivative where its slopes to either side differ by more than KINK, seen from STEP away;
// differences below ROUNDING, relative to max|u|, are not seen.
constexpr double STEP = 1e-7, KINK = 1e-2, ROUNDING = 1e-10;
// Programs are differentiated in a frame that is turned by it, because `LeastSquares::add` skips the
// rotation of a row along an axis, and with it the derivative [rad].
constexpr double TURN = 0.6;

struct Scene {  // m barriers, their rows, and the program that decides
  Vector<const Index> kind, priority;  // (m,)
  const RowSettings& rows;
  const Settings& program;
  Index count() const { return kind.size; }
  Index variables() const { return BARRIERS + OF_BARRIER * count(); }
};

// A program's arrays on a kind of numbers.
template <class Number>
struct Solver {
  std::vector<PointOf<Number>> vertices;
  std::vector<Number> a, b, h, alpha2_psi, slack, delta;
  WorkspaceOf<Number> w;

  Solver(const Scene& scene, double turn) {
    const Index m = scene.count();
    for (std::vector<Number>* each : {&b, &h, &alpha2_psi, &slack, &delta}) each->resize(m);
    a.resize(2 * m);
    for (const Point u : polygon::points(scene.program.vertices[0]))
      vertices.push_back({u.x * std::cos(turn) - u.y * std::sin(turn),
                          u.x * std::sin(turn) + u.y * std::cos(turn)});
    w.grow(scene.program.radius, static_cast<Index>(vertices.size()), m);
  }
  program_records::StateRowsOf<Number> rows(const Scene& scene) const {
    const Index m = scene.count();
    return {{a.data(), m, 2}, {b.data(), m}, {h.data(), m}, scene.priority, {alpha2_psi.data(), m}};
  }
  // Writes u and returns the status.
  Index solve(const Scene& scene, const PointOf<Number>& u_nominal, PointOf<Number>& u) {
    const Index m = scene.count();
    return cascade::filter_state<Number>(
        scene.program, {vertices.data(), static_cast<Index>(vertices.size())}, scene.program.weights[0],
        u_nominal, rows(scene), {&u.x, 2}, {slack.data(), m}, {delta.data(), m}, w);
  }
};

// Writes the row of a barrier with its own variables, x (4,) and block and margin, at a time t.
template <class Number>
void write_row(const Scene& scene, Index k, const Number* x, const Number* barrier, double t, Number* a,
               Number& b, Number& h, Number& alpha2_psi) {
  const Number* margin = barrier + layout::WIDTH;
  const auto row = rows::row<Number>(scene.kind[k], barrier, {margin[0], margin[1], margin[2]}, x, t,
                                     scene.rows, a);
  b = row.b, h = row.h, alpha2_psi = row.alpha2_psi;
}

inline void write_rows(const Scene& scene, const double* variables, double t, Solver<double>& s) {
  for (Index k = 0; k < scene.count(); ++k)
    write_row(scene, k, variables + U_NOMINAL, variables + BARRIERS + OF_BARRIER * k, t, &s.a[2 * k], s.b[k],
              s.h[k], s.alpha2_psi[k]);
}

class Layer {
 public:
  explicit Layer(const Scene& scene)
      : scene_(scene), plain_(scene, 0.0), turned_(scene, TURN), moved_(scene.variables()) {}

  struct Answer {
    Point u;
    Index status;
    bool degenerate;   // whether u has no derivative here
    bool well_formed;  // whether u* and the rows are finite numbers; if not, u is u*
  };

  // Filters one state.
  Answer filter(const double* variables, double t) {
    Answer answer = at(variables, t);
    if (!answer.well_formed) return answer;
    const Point ahead = at(step_from(variables, STEP), t).u, behind = at(step_from(variables, -STEP), t).u;
    const auto kinks = [&](double back, double here, double front) {
      const double least = ROUNDING * scene_.program.radius;
      const double size = std::max(std::abs(front - here), std::abs(here - back));
      return !(std::abs(front - here - (here - back)) <= std::max(KINK * size, least));
    };
    answer.degenerate = kinks(behind.x, answer.u.x, ahead.x) || kinks(behind.y, answer.u.y, ahead.y);
    return answer;
  }

  // Writes (∂u/∂variables)ᵀ w of one state.
  void pull_back(const double* variables, double t, Point w, double* out) {
    std::fill_n(out, scene_.variables(), 0.0);
    const Point u = at(variables, t).u;
    list_inputs(u);
    of_numbers_.assign(inputs_.size(), 0.0);
    for (std::size_t first = 0; first < inputs_.size(); first += PASS) differentiate(variables, w, first);
    for (std::size_t i = 0; i < inputs_.size(); ++i)
      if (inputs_[i] < U_NOMINAL) out[inputs_[i]] = of_numbers_[i];
    for (std::size_t i = U_NOMINAL; i < inputs_.size(); i += per_row()) pull_back_row(variables, t, i, out);
  }

 private:
  using Turned = Dual<PASS>;
  using OfRow = Dual<OF_ROW>;

  Answer at(const double* variables, double t) {
    write_rows(scene_, variables, t, plain_);
    Answer answer{{variables[0], variables[1]}, 0, false, are_finite({variables, U_NOMINAL})};
    for (const std::vector<double>* each : {&plain_.a, &plain_.b, &plain_.h, &plain_.alpha2_psi})
      answer.well_formed &= are_finite({each->data(), static_cast<Index>(each->size())});
    if (answer.well_formed) answer.status = plain_.solve(scene_, {variables[0], variables[1]}, answer.u);
    return answer;
  }

  // Returns variables that all differ, in a direction that is no special one.
  const double* step_from(const double* variables, double step) {
    double part = 0.0;
    for (Index i = 0; i < scene_.variables(); ++i) {
      part = std::fmod(part + 0.6180339887498949, 1.0);  // the golden ratio's multiples are spread evenly
      const double along = (i % 2 == 0 ? 0.5 : -0.5) * (1.0 + part);
      moved_[i] = variables[i] + step * along * (1.0 + std::abs(variables[i]));
    }
    for (Index k = 0; k < scene_.count(); ++k)  // the number of corners is no variable
      if (scene_.kind[k] == ConvexPolygon::CODE) {
        const Index place = BARRIERS + OF_BARRIER * k + ConvexPolygon::COUNT;
        moved_[place] = variables[place];
      }
    return moved_.data();
  }

  // Whether u depends on rows by a and b alone, and only on those that it does not meet by far: with
  // stages without prices, u itself is a minimiser of each stage.
  bool is_plain() const {
    const Settings& s = scene_.program;
    const Vector<const double> table = s.weights[0];
    return s.lower != program_records::Lower::DRAWN &&
           std::all_of(table.begin() + 1, table.end(), [](double price) { return std::isinf(price); });
  }
  Index per_row() const { return is_plain() ? 3 : NUMBERS; }

  // Lists u* and the numbers of rows of which u is a function: 2 + 5 k + q is number q of row k.
  void list_inputs(Point u) {
    inputs_ = {0, 1};
    for (Index k = 0; k < scene_.count(); ++k) {
      const double ax = plain_.a[2 * k], ay = plain_.a[2 * k + 1], b = plain_.b[k];
      const double size = std::hypot(ax, ay) * scene_.program.radius + std::abs(b);
      if (is_plain() && ax * u.x + ay * u.y - b > MET * size) continue;
      for (Index q = 0; q < per_row(); ++q) inputs_.push_back(U_NOMINAL + NUMBERS * k + q);
    }
  }

  // Adds wᵀ ∂u/∂ of the inputs from `first` on, as many as a pass carries.
  void differentiate(const double* variables, Point w, std::size_t first) {
    const std::size_t end = std::min(inputs_.size(), first + PASS);
    std::size_t next = first;
    const auto seeded = [&](Index input, double value) {
      if (next < end && inputs_[next] == input) return Turned::variable(value, static_cast<int>(next++ - first));
      return Turned(value);
    };
    const double c = std::cos(TURN), s = std::sin(TURN);
    const Turned ux = seeded(0, variables[0]), uy = seeded(1, variables[1]);
    for (Index k = 0; k < scene_.count(); ++k) {
      const Index base = U_NOMINAL + NUMBERS * k;
      const Turned ax = seeded(base, plain_.a[2 * k]), ay = seeded(base + 1, plain_.a[2 * k + 1]);
      turned_.a[2 * k] = ax * c - ay * s, turned_.a[2 * k + 1] = ax * s + ay * c;
      turned_.b[k] = seeded(base + 2, plain_.b[k]);
      turned_.h[k] = seeded(base + 3, plain_.h[k]);
      turned_.alpha2_psi[k] = seeded(base + 4, plain_.alpha2_psi[k]);
    }
    PointOf<Turned> u{};
    turned_.solve(scene_, {ux * c - uy * s, ux * s + uy * c}, u);
    const double wx = w.x * c - w.y * s, wy = w.x * s + w.y * c;
    for (std::size_t i = first; i < end; ++i) of_numbers_[i] = wx * u.x.d[i - first] + wy * u.y.d[i - first];
  }

  // Adds what the row whose numbers begin at input i contributes.
  void pull_back_row(const double* variables, double t, std::size_t i, double* out) {
    const Index k = (inputs_[i] - U_NOMINAL) / NUMBERS, block = BARRIERS + OF_BARRIER * k;
    double w[NUMBERS] = {};
    std::copy_n(&of_numbers_[i], per_row(), w);
    if (std::all_of(w, w + NUMBERS, [](double one) { return one == 0.0; })) return;
    OfRow own[OF_ROW], a[2], b, h, alpha2_psi;
    const auto place = [&](int j) { return j < STATE ? U_NOMINAL + j : block + j - STATE; };
    for (int j = 0; j < OF_ROW; ++j) own[j] = OfRow::variable(variables[place(j)], j);
    write_row<OfRow>(scene_, k, own, own + STATE, t, a, b, h, alpha2_psi);
    for (int j = 0; j < OF_ROW; ++j) {
      out[place(j)] += w[0] * a[0].d[j] + w[1] * a[1].d[j] + w[2] * b.d[j] + w[3] * h.d[j] + w[4] * alpha2_psi.d[j];
    }
  }

  const Scene scene_;
  Solver<double> plain_;
  Solver<Turned> turned_;
  std::vector<double> moved_, of_numbers_;
  std::vector<Index> inputs_;
};

// Filters N states: variables (N, BARRIERS + m OF_BARRIER), t (N,), u (N, 2), status and degenerate (N,).
// Returns the first state of which u* or a row is malformed, or N.
inline Index filter_batch(const Scene& scene, Matrix<const double> variables, Vector<const double> t,
                          Matrix<double> u, Vector<Index> status, Vector<bool> degenerate) {
  Layer layer(scene);
  for (Index i = 0; i < variables.rows; ++i) {
    const Layer::Answer answer = layer.filter(variables[i].data, t[i]);
    if (!answer.well_formed) return i;
    u(i, 0) = answer.u.x, u(i, 1) = answer.u.y;
    status[i] = answer.status, degenerate[i] = answer.degenerate;
  }
  return variables.rows;
}

// Writes (∂u/∂variables)ᵀ w of N states, w (N, 2).
inline void pull_back_batch(const Scene& scene, Matrix<const double> variables, Vector<const double> t,
                            Matrix<const double> w, Matrix<double> out) {
  Layer layer(scene);
  for (Index i = 0; i < variables.rows; ++i)
    layer.pull_back(variables[i].data, t[i], {w(i, 0), w(i, 1)}, out[i].data);
}

}  // namespace hcbf::gradient
