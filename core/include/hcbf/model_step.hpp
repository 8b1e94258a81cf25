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
  ClassK alpha1, alpha2, alpha_speed;
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
        monitor_(model,
                 {settings_.period, settings_.radius, settings_.confidence, settings_.largest,
                  settings_.steered},
                 count),
        accepted_(count) {
    const Index states = count * model.n;
    for (auto* each : {&f_, &led_}) each->resize(states);
    g_.resize(states * model.n_u), stops_.resize(count * model.n_u);
    jacobian_.resize(states * model.n);
  }

  // What the monitor remembers.
  std::vector<double>& memory() { return monitor_.memory(); }

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
      if (!sensed[i].known) monitor_.forget(i);
    if (state_check::check_all(sensed, states, settings_.velocity_at, told)) {
      propagate(sensed, states, told);
      state_check::replace_all(sensed, states, told);
    }
    model_.terms(states.x, f(f_), g(g_));
    reserve_.know(states.x, states.model, states.lag, states.covariance);
    for (Index i = 0; i < count_; ++i) {
      const bool is_known = are_finite({f_.data() + i * model_.n, model_.n}) &&
                            are_finite({g_.data() + i * model_.n * model_.n_u, model_.n * model_.n_u});
      if (!is_known)
        std::fill_n(f(f_)[i].data, model_.n, 0.0), std::fill_n(g(g_)[i].data, model_.n * model_.n_u, 0.0);
      if (told[i].reason == 0 && !(is_known && (!parts || reserve_.is_known(i))))
        told[i].reason = reason::BARRIERS;
      accepted_[i] = told[i].reason == 0;
    }
    if (parts) state_check::grow_all(sensed, told, reserve_.drift(), model_.n_p);
    monitor_.observe(sensed, {accepted_.data(), count_}, states, f(f_), g(g_), parts);
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
                                  settings_.alpha2, settings_.alpha_speed, scene_.out))
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
      if (plant.known) copy(after, states.accepted[i]);
    }
  }

  // Writes the inputs of U nearest to those that stop the plants, to 0 where they are unknown.
  void brake(Records<plants::Plant> sensed, const state_check::States& states) {
    model_.brakes(states.x, settings_.period, {stops_.data(), count_, model_.n_u});
    for (Index i = 0; i < count_; ++i) {
      const Vector<double> stop{sensed.tail(i) + model_.n_u, model_.n_u};
      std::copy_n(stops_.data() + i * model_.n_u, model_.n_u, stop.data);
      if (!sensed[i].known || !are_finite(stop)) std::fill_n(stop.data, stop.size, 0.0);
      settings_.inputs.project(stop);
    }
  }

  const Settings settings_;
  const model::Model& model_;
  Index count_;
  model_margins::Reserve reserve_;
  model_monitor::Monitor monitor_;
  Scene scene_{};
  bool turns_ = false;
  std::vector<char> accepted_;             // (N,)
  std::vector<double> f_, g_, jacobian_;   // at x
  std::vector<double> led_, stops_;        // (N, n) propagated states, (N, n_u) braking inputs
  std::vector<double> gradient_, bend_;    // zeros
};

}  // namespace hcbf::model_step
