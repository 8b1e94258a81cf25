#include <hcbf/estimation_tick.hpp>

#include "records.hpp"

namespace hcbf {

namespace {

using estimation_tick::Past;
using locomotion_state::RobotState;
using locomotion_state::state_view;
using sensing::Noise;

// The estimator's tick, with all that it remembers.
struct EstimationTick {
  estimation_tick::Settings settings;
  estimation_tick::Memory memory;
  std::vector<Past> past;  // a ring
  Given2 noises;           // of the coming ticks

  const Noise& noise(Index row) const { return *reinterpret_cast<const Noise*>(&noises(row, 0)); }
  Vector<Past> ring() { return {past.data(), static_cast<Index>(past.size())}; }
  const Past& now() const { return past[static_cast<std::size_t>(memory.ticks) % past.size()]; }

  void start(const Given1& truth, Index row, const Numbers<double, 1>& told) {
    estimation_tick::start(settings, memory, ring(), as<RobotState>(truth), noise(row),
                           state_view(told.data()));
  }
  void tick(const Given1& truth, Index row, const Numbers<double, 1>& told) {
    estimation_tick::tick(settings, memory, ring(), as<RobotState>(truth), noise(row),
                          state_view(told.data()));
  }
};

}  // namespace

void bind_estimation(nb::module_& m) {
  using kalman::AXIS;
  using kalman::COLUMNS;
  nb::class_<EstimationTick>(m, "EstimationTick", "The estimator's tick, with all that it remembers.")
      .def(
          "__init__",
          [](EstimationTick* self, const Word& settings) {
            const auto& known = record<estimation_tick::Settings>(settings);
            new (self)
                EstimationTick{known, {}, std::vector<Past>(static_cast<std::size_t>(known.delay) + 1), {}};
          },
          nb::arg("settings"))
      .def(
          "use", [](EstimationTick& self, const Given2& noises) { self.noises = noises; }, nb::arg("noises"),
          "Take the noise of the coming ticks from standard normal numbers (k, NOISES).")
      .def("start", &EstimationTick::start, nb::arg("truth"), nb::arg("row"), nb::arg("told").noconvert(),
           "Begin an episode at rest; fill in what is known of the robot (41,).")
      .def("tick", &EstimationTick::tick, nb::arg("truth"), nb::arg("row"), nb::arg("told").noconvert(),
           "Move the estimate on by one tick under a row of the noise; fill in what is known of the robot "
           "(41,).")
      .def_prop_ro(
          "yaw", [](const EstimationTick& self) { return self.memory.yaw; }, "The sensed heading [rad].")
      .def_prop_ro(
          "mean", [](const EstimationTick& self) { return copied(self.now().x[0], AXIS, COLUMNS); },
          nb::rv_policy::move,
          "(5, 4) means along x and y, and their derivatives by an error of the heading; a copy.")
      .def_prop_ro(
          "covariance", [](const EstimationTick& self) { return copied(self.now().cov[0], AXIS, AXIS); },
          nb::rv_policy::move, "(5, 5) of either axis; a copy.");
  m.attr("NOISES") = sizeof(Noise) / sizeof(double);
  m.def(
      "kalman_predict",
      [](const Word& model, const Numbers<double, 2>& x, const Numbers<double, 2>& cov,
         const Given1& acceleration, double var_acc) {
        kalman::predict(record<kalman::Model>(model), *reinterpret_cast<kalman::Means*>(x.data()),
                        *reinterpret_cast<kalman::Covariance*>(cov.data()),
                        *reinterpret_cast<const double (*)[COLUMNS]>(acceleration.data()), var_acc);
      },
      nb::arg("model"), nb::arg("x").noconvert(), nb::arg("cov").noconvert(), nb::arg("acceleration"),
      nb::arg("var_acc"),
      "Move means (5, 4) and covariance (5, 5) on by one tick under an acceleration (4,).");
  m.def(
      "kalman_correct",
      [](const Numbers<double, 2>& x, const Numbers<double, 2>& cov, int first, int second, const Given1& z,
         double variance) {
        kalman::correct(*reinterpret_cast<kalman::Means*>(x.data()),
                        *reinterpret_cast<kalman::Covariance*>(cov.data()), first, second,
                        *reinterpret_cast<const double (*)[COLUMNS]>(z.data()), variance);
      },
      nb::arg("x").noconvert(), nb::arg("cov").noconvert(), nb::arg("first"), nb::arg("second"), nb::arg("z"),
      nb::arg("variance"),
      "Take a measurement z (4,) of the sum of two entries into means (5, 4) and covariance (5, 5).");
}

}  // namespace hcbf
