// The step of N plants of any model, up to their rows: states, margins, alarms, braking inputs.
#pragma once
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <hcbf/general_rows.hpp>
#include <hcbf/model.hpp>
#include <hcbf/model_margins.hpp>
#include <hcbf/model_monitor.hpp>
#include <hcbf/polygon.hpp>
#include <hcbf/state_check.hpp>
#include <hcbf/step.hpp>

namespace hcbf::model_step {

using class_k::ClassK;

struct InputSet {  // U: a box, or a polygon
  std::vector<double> low, high;  // (n_u,) of a box; empty of a polygon
  std::vector<double> corners;    // (V, 2) of a polygon

  // The most that an input gives of a·u.
  double support(const double* a) const {
    double most = corners.empty() ? 0.0 : -INFINITY;
    for (std::size_t j = 0; j < low.size(); ++j) most += std::max(a[j] * low[j], a[j] * high[j]);
    for (std::size_t v = 0; v < corners.size(); v += 2)
      most = std::max(most, corners[v] * a[0] + corners[v + 1] * a[1]);
    return most;
  }

  // Takes the nearest input in the place of u (n_u,).
  void project(Vector<double> u) const {
    for (std::size_t j = 0; j < low.size(); ++j) u[j] = std::min(std::max(u[j], low[j]), high[j]);
    if (corners.empty()) return;
    const Matrix<const double> polygon{corners.data(), static_cast<Index>(corners.size()) / 2, 2};
    const polygon::Point nearest = polygon::nearest(polygon::points(polygon), polygon::Point{u[0], u[1]});
    u[0] = nearest.x, u[1] = nearest.y;
  }
};

struct Settings {  // what never changes
  Uncertainty uncertainty;  // without the part of its distance that is in the unit of h
  ClassK alpha1, alpha2;
  InputSet inputs;
  std::vector<double> largest;  // (n_u,) of each input in U
  std::vector<char> steered;    // (n,) the states that Δu is read from
  double radius;                // the largest norm of an input
  double confidence;            // κ of the monitor
  double period;                // T [s], 0 where it is unknown
  Index velocity_at;            // where x has the planar velocity, -1 for nowhere
};

struct Scene {  // the conditions of N plants; see `general_rows::Scene` and `model_margins::Rows`
  general_rows::Scene rows;
  Matrix<const double> least;
  Cube<double> out;  // (N, m, WIDTH + n_u)
};

class Step {
 public:
  Step(const model::Model& model, Settings settings, Index count)
      : settings_(std::move(settings)), model_(model), count_(count),
        reserve_(model, settings_.uncertainty, {settings_.largest.data(), model.n_u}, settings_.period, count),
        monitor_room_(model.n, model.n_u), accepted_(count), other_(count) {
    const Index states = count * model.n, inputs = states * model.n_u;
    for (auto* each : {&f_, &expected_, &expected_model_, &led_, &body_now_, &model_now_, &f_now_})
      each->resize(states);
    for (auto* each : {&g_, &g_now_, &g_model_now_, &to_input_}) each->resize(inputs);
    memory_.resize(5 * states + 2 * inputs);
    arrived_.resize(count * model.n_u), chosen_ = arrived_;
    jacobian_.resize(states * model.n);
  }

  // What the monitor remembers: the last samples, and its sums.
  std::vector<double>& memory() { return memory_; }

  void set_scene(const Scene& scene) {
    scene_ = scene;
    const Index m = scene.rows.kind.columns;
    gradient_.assign(count_ * m * model_.n, 0.0), bend_.assign(count_ * m, 0.0);
    const auto turns = [&](Index at) {
      return scene.rows.kind.data[at] != general_rows::ELSEWHERE && scene.rows.degree.data[at] == 2;
    };
    turns_ = false;
    for (Index at = 0; at < count_ * m; ++at) turns_ |= turns(at);
  }

  // Checks N states, raises alarms, and writes braking inputs. `parts`: whether a sample held more than x.
  void sense(Records<plants::Plant> sensed, const state_check::States& states, Records<report::Plant> told,
             bool parts) {
    for (Index i = 0; i < count_; ++i)
      if (!sensed[i].known) std::fill_n(sums()[i].data, 2 * model_.n, 0.0);
    if (state_check::check_all(sensed, states, settings_.velocity_at, told)) {
      propagate(sensed, states, told);
      state_check::replace_all(sensed, states, told);
    }
    model_.terms(states.x, f(f_), g(g_));
    reserve_.know(states.x, states.model, states.lag, states.covariance);
    for (Index i = 0; i < count_; ++i) {
      const bool is_known = program_records::are_finite({f_.data() + i * model_.n, model_.n}) &&
                            program_records::are_finite({g_.data() + i * model_.n * model_.n_u, model_.n * model_.n_u});
      if (!is_known)
        std::fill_n(f(f_)[i].data, model_.n, 0.0), std::fill_n(g(g_)[i].data, model_.n * model_.n_u, 0.0);
      if (told[i].reason == 0 && !(is_known && (!parts || reserve_.is_known(i))))
        told[i].reason = reason::BARRIERS;
      accepted_[i] = told[i].reason == 0;
    }
    if (parts) state_check::grow_all(sensed, told, reserve_.drift(), model_.n_p);
    watch(sensed, states, parts);
    if (settings_.period > 0.0) brake(sensed, states);
    for (Index i = 0; i < count_; ++i) {
      reserve_.time[i] = sensed[i].time;
      reserve_.growth[i] = parts ? sensed[i].growth : 0.0;
    }
  }

  // Writes what the rows reserve. `gradient` (N, m, n) ∇h and `bend` (N, m), see `model_margins::Rows`.
  void reserve(Cube<const double> gradient, Matrix<const double> bend) {
    const general_rows::Scene& rows = scene_.rows;
    reserve_.write({rows.kind, rows.parameters, scene_.least, gradient, bend, model_.n_p}, scene_.out);
  }

  // Writes margins and rows of built-in barriers.
  void make_rows(const state_check::States& states) {
    const Index m = scene_.rows.kind.columns;
    reserve({gradient_.data(), count_, m, model_.n}, {bend_.data(), count_, m});
    Cube<double> jacobian{jacobian_.data(), count_, turns_ ? model_.n : 0, turns_ ? model_.n : 0};
    if (turns_) model_.jacobians(states.x, jacobian);
    if (!general_rows::write_rows(scene_.rows, {nullptr, count_, 0, 0}, states.x,
                                  {reserve_.time.data(), count_}, {f(f_), g(g_), jacobian}, settings_.alpha1,
                                  settings_.alpha2, scene_.out))
      return;
    for (Index i = 0; i < count_; ++i)
      for (Index k = 0; k < m; ++k) {
        double* row = scene_.out[i][k].data;
        if (!(row[general_rows::ALPHA2_PSI] < 0.0) || scene_.rows.degree(i, k) != 2) continue;
        const double most = settings_.inputs.support(row + general_rows::WIDTH);
        general_rows::recover(settings_.alpha1, settings_.alpha2, most, row);
      }
  }

  Matrix<double> drifts() { return f(f_); }
  Cube<double> inputs() { return g(g_); }

 private:
  Matrix<double> f(std::vector<double>& of) const { return {of.data(), count_, model_.n}; }
  Cube<double> g(std::vector<double>& of) const { return {of.data(), count_, model_.n, model_.n_u}; }
  Cube<double> sums() { return {memory_.data() + memory_.size() - 2 * count_ * model_.n, count_, 2, model_.n}; }

  // Lets the model propagate the states that were accepted last, of plants that are not now.
  void propagate(Records<plants::Plant> sensed, const state_check::States& states,
                 Records<report::Plant> told) {
    for (Index i = 0; i < count_; ++i) {
      plants::Plant& plant = sensed[i];
      if (told[i].reason == 0 || !plant.known || !(plant.elapsed > 0.0)) continue;
      const Vector<double> after = f(led_)[i];
      model_.steps(states.accepted.part(i, i + 1), {sensed.tail(i), 1, model_.n_u}, plant.elapsed,
                   {after.data, 1, model_.n});
      plant.known = state_check::are_near(after);
      if (plant.known) state_check::copy(after, states.accepted[i]);
    }
  }

  // Writes where inputs lead from states within a period.
  void expect(const double* x, std::vector<double>& u, std::vector<double>& after) {
    model_.steps({x, count_, model_.n}, {u.data(), count_, model_.n_u}, settings_.period, f(after));
  }

  // Compares the samples with those before.
  void watch(Records<plants::Plant> sensed, const state_check::States& states, bool parts) {
    const Index n = model_.n, n_u = model_.n_u, size = count_ * n;
    for (Index i = 0; i < count_; ++i) std::copy_n(sensed.tail(i), n_u, chosen_.data() + i * n_u);
    const model_monitor::Watched watched{settings_.period, settings_.radius, settings_.confidence,
                                         {settings_.largest.data(), n_u},
                                         {reinterpret_cast<const bool*>(settings_.steered.data()), n}};
    double* at = memory_.data();
    const auto take = [&at](Index length) { return std::exchange(at, at + length); };
    double *body = take(size), *model = take(size), *drift = take(size);
    double *in_body = take(size * n_u), *in_model = take(size * n_u);
    const model_monitor::Sample last{{body, count_, n}, {model, count_, n}, {drift, count_, n},
                                     {in_body, count_, n, n_u}, {in_model, count_, n, n_u}};
    take_sample(states, parts);
    const model_monitor::Sample now{f(body_now_), f(model_now_), f(f_now_), g(g_now_), g(g_model_now_)};
    const model_monitor::Arrival arrival{{chosen_.data(), count_, n_u},
                                         g_inverse(),
                                         {arrived_.data(), count_, n_u},
                                         {reinterpret_cast<bool*>(other_.data()), count_},
                                         f(expected_),
                                         f(expected_model_)};
    const Vector<const bool> accepted{reinterpret_cast<const bool*>(accepted_.data()), count_};
    if (settings_.period > 0.0) {
      expect(body, chosen_, expected_);
      if (std::equal(body, body + size, model))
        expected_model_ = expected_;
      else
        expect(model, chosen_, expected_model_);
      if (model_monitor::arrivals(watched, sensed, accepted, now.body, last.g, arrival, monitor_room_))
        expect_arrived(body);
    }
    model_monitor::observe(watched, sensed, accepted, states.covariance, {now, last, arrival, sums()},
                           monitor_room_);
    std::copy_n(body_now_.data(), size, body), std::copy_n(model_now_.data(), size, model);
    std::copy_n(f_now_.data(), size, drift), std::copy_n(g_now_.data(), size * n_u, in_body);
    std::copy_n(g_model_now_.data(), size * n_u, in_model);
  }

  Cube<double> g_inverse() { return {to_input_.data(), count_, model_.n_u, model_.n}; }

  // Writes where the inputs that seem to have arrived lead, of plants whose input was another one.
  void expect_arrived(const double* body) {
    expect(body, arrived_, led_);
    for (Index i = 0; i < count_; ++i)
      if (other_[i]) std::copy_n(led_.data() + i * model_.n, model_.n, expected_.data() + i * model_.n);
  }

  // Notes states and terms of bodies and models; where these have none, those at x.
  void take_sample(const state_check::States& states, bool parts) {
    const Index size = count_ * model_.n;
    std::copy_n(states.model.data, size, model_now_.data());
    for (Index k = 0; k < size; ++k) body_now_[k] = states.model.data[k] + states.lag.data[k];
    if (!parts) {
      f_now_ = f_, g_now_ = g_model_now_ = g_;
      return;
    }
    model_.terms(f(model_now_), f(f_now_), g(g_model_now_));
    model_.terms(f(body_now_), f(f_now_), g(g_now_));
    const auto mend = [](std::vector<double>& found, const std::vector<double>& known) {
      for (std::size_t k = 0; k < found.size(); ++k)
        if (std::isnan(found[k])) found[k] = known[k];
    };
    mend(f_now_, f_), mend(g_now_, g_), mend(g_model_now_, g_);
  }

  // Writes the inputs of U nearest to those that stop the plants, to 0 where they are unknown.
  void brake(Records<plants::Plant> sensed, const state_check::States& states) {
    model_.brakes(states.x, settings_.period, {arrived_.data(), count_, model_.n_u});
    for (Index i = 0; i < count_; ++i) {
      const Vector<double> stop{sensed.tail(i) + model_.n_u, model_.n_u};
      std::copy_n(arrived_.data() + i * model_.n_u, model_.n_u, stop.data);
      if (!sensed[i].known || !program_records::are_finite(stop)) std::fill_n(stop.data, stop.size, 0.0);
      settings_.inputs.project(stop);
    }
  }

  const Settings settings_;
  const model::Model& model_;
  Index count_;
  model_margins::Reserve reserve_;
  model_monitor::Room monitor_room_;
  Scene scene_{};
  bool turns_ = false;
  std::vector<char> accepted_, other_;  // (N,)
  std::vector<double> f_, g_, jacobian_;  // at x
  std::vector<double> memory_;            // the sample before, field by field, and (N, 2, n) sums
  std::vector<double> body_now_, model_now_, f_now_, g_now_, g_model_now_;
  std::vector<double> chosen_, arrived_, expected_, expected_model_, led_, to_input_;
  std::vector<double> gradient_, bend_;  // zeros
};

}  // namespace hcbf::model_step
