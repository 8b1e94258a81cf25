// The monitor of N plants of any model: what input and motion their steps show.
//
// The input: Δu = g⁺(x' − step(x, u, T)) / T. The motion is what no input explains: with û = u + Δu, the
// input that seems to have arrived, and Π = I − g g⁺, the part of the state that no input reaches within
// one period, s = Π (x' − step(x, û, T)) and Δ = Π (x' − x). A state that an input drives at once and
// that drives no other belongs to the motion, too. `monitor` has what is made of them.
#pragma once
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <hcbf/model.hpp>
#include <hcbf/monitor.hpp>
#include <hcbf/pseudo_inverse.hpp>
#include <hcbf/state_check.hpp>

namespace hcbf::model_monitor {

constexpr double STILL = 0.002;    // of what the largest inputs change in τ: a smaller motion is rounding
constexpr double ROUNDING = 1e-9;
constexpr double WRAPPED = 0.5;    // how near to a whole turn a jump must be to be one [rad]
constexpr double TURN = 6.283185307179586;

struct Settings {               // what never changes
  double period;                // T [s]
  double radius;                // the largest norm of an input
  double confidence;            // κ
  std::vector<double> largest;  // (n_u,) of each input
  std::vector<char> steered;    // (n,) the states that Δu is read from
};

// x − expected, without the whole turn of an angle that is wrapped.
inline double missed(double x, double expected) {
  const double missed = x - expected, turned = missed - TURN * ((missed > 0.0) - (missed < 0.0));
  return std::abs(turned) < WRAPPED ? turned : missed;
}

// tr(A P Aᵀ).
inline double trace(Matrix<const double> a, Matrix<const double> covariance) {
  double trace = 0.0;
  for (Index j = 0; j < a.rows; ++j)
    for (Index k = 0; k < a.columns; ++k)
      for (Index q = 0; q < a.columns; ++q) trace += a(j, k) * covariance(k, q) * a(j, q);
  return trace;
}

class Monitor {
 public:
  Monitor(const model::Model& model, Settings settings, Index count)
      : settings_(std::move(settings)), model_(model), count_(count), other_(count),
        steered_(model.n * model.n_u), inverse_(steered_), columns_(steered_), turns_(model.n_u * model.n_u),
        parts_(4 * model.n) {
    const Index states = count * model.n, inputs = count * model.n_u;
    for (auto* each : {&expected_, &expected_model_, &led_}) each->resize(states);
    for (auto* each : {&chosen_, &arrived_}) each->resize(inputs);
    to_input_.resize(states * model.n_u);
    now_.resize(3 * states + 2 * states * model.n_u);
    memory_.resize(now_.size() + 2 * states);
  }

  // What is remembered: the last sample, and the sums (N, 2, n) r and m' behind it.
  std::vector<double>& memory() { return memory_; }

  void forget(Index i) { std::fill_n(sums(i).data, 2 * model_.n, 0.0); }

  // Accounts for a sample of N plants, and raises their alarms. `accepted` (N,): whether it is valid; f
  // (N, n) and g (N, n, n_u): at `states.x`; `parts`: whether a sample held more than x.
  void observe(Records<plants::Plant> plants, Vector<const char> accepted, const state_check::States& states,
               Matrix<const double> f, Cube<const double> g, bool parts) {
    const Sample now = sample(now_), last = sample(memory_);
    take(now, states, f, g, parts);
    if (settings_.period > 0.0) predict(plants, accepted, now, last);
    for (Index i = 0; i < count_; ++i) {
      plants::Plant& plant = plants[i];
      if (!accepted[i]) continue;
      if (plant.fault >= reason::FIRST_ALARM) monitor::latch(plant, plant.fault);
      if (compares(plant)) {
        if (misses(plant, i, now, last, states.covariance[i])) monitor::latch(plant, reason::INPUT);
        if (moves_off(plant, i, now, last, states.covariance[i])) monitor::latch(plant, reason::MOTION);
      }
      plant.follows = 1;
    }
    std::copy(now_.begin(), now_.end(), memory_.begin());
  }

 private:
  struct Sample {           // of N plants
    Matrix<double> body;    // (N, n) their states
    Matrix<double> model;   // (N, n) those of their reduced-order models
    Matrix<double> f;       // (N, n) at the body's
    Cube<double> g;         // (N, n, n_u) at the body's
    Cube<double> g_model;   // (N, n, n_u) at the model's
  };

  Sample sample(std::vector<double>& of) const {
    const Index n = model_.n, n_u = model_.n_u, size = count_ * n;
    double* at = of.data();
    return {{at, count_, n}, {at + size, count_, n}, {at + 2 * size, count_, n},
            {at + 3 * size, count_, n, n_u}, {at + 3 * size + size * n_u, count_, n, n_u}};
  }
  Matrix<double> sums(Index i) { return {&memory_[now_.size() + 2 * i * model_.n], 2, model_.n}; }
  Matrix<double> states(std::vector<double>& of) const { return {of.data(), count_, model_.n}; }
  Matrix<double> to_input(Index i) { return {&to_input_[i * inverse_.size()], model_.n_u, model_.n}; }

  // Whether a valid sample is one period after another one.
  bool compares(const plants::Plant& plant) const {
    return plant.follows != 0 && settings_.period > 0.0 && plant.elapsed == settings_.period;
  }

  // Notes states and terms of bodies and models; where these have none, those at x.
  void take(const Sample& now, const state_check::States& states, Matrix<const double> f,
            Cube<const double> g, bool parts) const {
    const Index size = count_ * model_.n, wide = size * model_.n_u;
    std::copy_n(states.model.data, size, now.model.data);
    for (Index k = 0; k < size; ++k) now.body.data[k] = states.model.data[k] + states.lag.data[k];
    if (parts) {
      model_.terms(now.model, now.f, now.g_model);
      model_.terms(now.body, now.f, now.g);
    }
    const auto mend = [parts](double* found, const double* known, Index count) {
      for (Index k = 0; k < count; ++k)
        if (!parts || std::isnan(found[k])) found[k] = known[k];
    };
    mend(now.f.data, f.data, size), mend(now.g.data, g.data, wide), mend(now.g_model.data, g.data, wide);
  }

  // Writes where inputs lead from states within a period.
  void expect(Matrix<double> x, std::vector<double>& u, std::vector<double>& after) {
    model_.steps(x, {u.data(), count_, model_.n_u}, settings_.period, states(after));
  }

  // Writes where the chosen inputs lead models and bodies; these by the input that seems to have arrived.
  void predict(Records<plants::Plant> plants, Vector<const char> accepted, const Sample& now,
               const Sample& last) {
    const Index n = model_.n, n_u = model_.n_u;
    for (Index i = 0; i < count_; ++i) std::copy_n(plants.tail(i), n_u, &chosen_[i * n_u]);
    expect(last.body, chosen_, expected_);
    if (std::equal(last.body.data, last.body.data + count_ * n, last.model.data))
      expected_model_ = expected_;
    else
      expect(last.model, chosen_, expected_model_);
    bool some = false;
    for (Index i = 0; i < count_; ++i) {
      other_[i] = accepted[i] && compares(plants[i]) && arrives(i, now, last);
      some |= other_[i] != 0;
    }
    if (!some) return;
    expect(last.body, arrived_, led_);
    for (Index i = 0; i < count_; ++i)
      if (other_[i]) std::copy_n(&led_[i * n], n, &expected_[i * n]);
  }

  // Writes û and g⁺ of plant i, and returns whether û differs from the chosen input.
  bool arrives(Index i, const Sample& now, const Sample& last) {
    const Index n = model_.n, n_u = model_.n_u;
    const Matrix<double> steered{steered_.data(), n, n_u};
    for (Index k = 0; k < n; ++k)
      for (Index j = 0; j < n_u; ++j) steered(k, j) = settings_.steered[k] ? last.g(i, k, j) : 0.0;
    invert(steered, to_input(i));
    double furthest = 0.0;
    for (Index j = 0; j < n_u; ++j) {
      double off = 0.0;
      for (Index k = 0; k < n; ++k) off += to_input(i)(j, k) * missed(now.body(i, k), expected_[i * n + k]);
      const double most = 2.0 * settings_.largest[j];
      off = std::min(std::max(off / settings_.period, -most), most);
      arrived_[i * n_u + j] = chosen_[i * n_u + j] + off;
      furthest = std::max(furthest, std::abs(off));
    }
    return furthest > ROUNDING * settings_.radius;
  }

  void invert(Matrix<const double> g, Matrix<double> out) {
    pseudo_inverse::write(g, out, {columns_.data(), model_.n, model_.n_u},
                          {turns_.data(), model_.n_u, model_.n_u});
  }

  // Accounts for Δu of plant i, where the state's noise does not hide it; returns whether that alarms.
  bool misses(plants::Plant& plant, Index i, const Sample& now, const Sample& last,
              Matrix<const double> covariance) {
    const Index n = model_.n, n_u = model_.n_u;
    const Matrix<double> inverse{inverse_.data(), n_u, n};
    invert(last.g_model[i], inverse);
    const double noisy = plant.has_model ? 0.0 : trace(inverse, covariance);  // tr(g⁺ P g⁺ᵀ)
    const double period = settings_.period, confidence = settings_.confidence;
    double error = 0.0, chosen = 0.0;
    for (Index j = 0; j < n_u; ++j) {
      double off = 0.0;
      for (Index k = 0; k < n; ++k)
        off += inverse(j, k) * missed(now.model(i, k), expected_model_[i * n + k]);
      off /= period;
      error += off * off;
      chosen += chosen_[i * n_u + j] * chosen_[i * n_u + j];
    }
    if (!std::isfinite(error)) return false;
    const double least = 2.0 * (confidence * confidence) * noisy / (period * period);
    if (monitor::SHARE * monitor::SHARE * chosen <= least && noisy > 0.0) chosen = 0.0;
    return monitor::account(plant.inputs, error, chosen, period / monitor::WINDOW, settings_.radius);
  }

  // Takes Π v in the place of v (n,) of plant i; g counts in the steered states alone.
  void reject(Index i, Cube<const double> g, Vector<double> v) {
    const Vector<double> before{&parts_[3 * model_.n], model_.n};
    copy(v, before);
    for (Index j = 0; j < model_.n_u; ++j) {
      double along = 0.0;
      for (Index k = 0; k < v.size; ++k) along += to_input(i)(j, k) * before[k];
      for (Index k = 0; k < v.size; ++k)
        if (settings_.steered[k]) v[k] -= g(i, k, j) * along;
    }
  }

  // Accounts for what no input explains of plant i, and returns whether that alarms.
  bool moves_off(plants::Plant& plant, Index i, const Sample& now, const Sample& last,
                 Matrix<const double> covariance) {
    const Index n = model_.n, n_u = model_.n_u;
    const Matrix<double> parts{parts_.data(), 4, n};
    double size = 0.0, driven = 0.0;
    for (Index k = 0; k < n; ++k) {
      parts(0, k) = missed(now.body(i, k), expected_[i * n + k]);
      parts(1, k) = expected_[i * n + k] - last.body(i, k);
      parts(2, k) = now.f(i, k) - last.f(i, k);
      size = std::max(size, std::abs(now.body(i, k)));
      for (Index j = 0; j < n_u; ++j) {
        parts(2, k) += (now.g(i, k, j) - last.g(i, k, j)) * arrived_[i * n_u + j];
        const double most = last.g(i, k, j) * settings_.largest[j];
        driven += most * most;
      }
    }
    for (Index part = 0; part < 3; ++part) reject(i, last.g, parts[part]);
    double change = 0.0, total = 0.0, unknown = 0.0;
    for (Index k = 0; k < n; ++k) {
      change += parts(2, k) * parts(2, k);
      total += parts(0, k) + parts(1, k) + parts(2, k);
    }
    if (!std::isfinite(total + change)) return false;
    for (Index k = 0; k < n; ++k) {  // tr(Π P Π); Π is symmetric, so that it is tr(Π P)
      if (covariance(k, k) == 0.0) continue;
      for (Index q = 0; q < n; ++q) parts(2, q) = covariance(q, k);
      reject(i, last.g, parts[2]);
      unknown += parts(2, k);
    }
    const double rest = STILL * monitor::WINDOW * std::sqrt(driven) + ROUNDING * size;
    const double spread = settings_.confidence * std::sqrt(std::max(0.0, unknown));
    return monitor::strays(plant.motion, &sums(i)(0, 0), &sums(i)(1, 0),
                           {parts[0], parts[1], std::sqrt(change), rest, spread, settings_.period});
  }

  const Settings settings_;
  const model::Model& model_;
  Index count_;
  std::vector<double> now_, memory_;                    // a sample, field by field
  std::vector<double> chosen_, arrived_;                // (N, n_u) u and û
  std::vector<double> expected_, expected_model_, led_;  // (N, n)
  std::vector<double> to_input_;                        // (N, n_u, n) g⁺
  std::vector<char> other_;                             // (N,) whether û differs from u
  std::vector<double> steered_, inverse_, columns_, turns_, parts_;  // of one plant after the other
};

}  // namespace hcbf::model_monitor
