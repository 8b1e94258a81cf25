#include <hcbf/a1_physics.hpp>
#include <hcbf/fault_detection.hpp>
#include <hcbf/locomotion_tick.hpp>
#include <hcbf/impedance.hpp>
#include <hcbf/ros_robot.hpp>

#include "locomotion_structs.hpp"

namespace hcbf {

void bind_locomotion_parts(nb::module_& m);

namespace {

// The controller's tick on records that Python makes and reads.
struct LocomotionTick {
  Word settings, memory, workspace;

  std::pair<int, bool> tick(const Given1& state, const Given1& u) const {
    const auto program = locomotion_tick::tick(
        record<locomotion_tick::Settings>(settings), record<locomotion_tick::Memory>(memory),
        record<task_space::Workspace>(workspace), as<locomotion_state::RobotState>(state), u.data());
    return {program.contacts, program.free};
  }
  void finish(bool solved) const {
    auto& work = record<task_space::Workspace>(workspace);
    solved ? task_space::take_solution(work) : task_space::set_torque(work);
  }
};

// The sums of a watch from judgement to judgement.
struct FaultDetection {
  leg::LegGeometry legs;
  fault_detection::Sampling sampling;
  fault_detection::Memory memory;

  void add_up(Index row, const Given2& states, const Given2& torques, const Numbers<const bool, 2>& stances,
              double lift) {
    fault_detection::add_up(memory, row, legs, sampling, view(states), view(torques), view(stances), lift);
  }
  std::tuple<double, double, double> signals(Index judgements, Index declared) const {
    const auto found = fault_detection::signals(memory, judgements, declared);
    return {found.slip, found.lag, found.lift};
  }
};

// The motors of an A1, on views of MuJoCo's data.
struct Motors {
  Given1 stall, no_load_speed, rate;
  Numbers<double, 1> delivered;

  void drive(double strength, const Given1& command) const {
    impedance::drive(view(stall), view(no_load_speed), view(rate), strength, view(command), view(delivered));
  }
};

// The state of an A1, on views of MuJoCo's data.
struct A1State {
  Given1 qpos, qvel, foot_forces;

  bool read(const Numbers<double, 1>& state) const {
    return a1_physics::read_state(qpos.data(), qvel.data(), foot_forces.data(), state.data());
  }
};

}  // namespace

void bind_locomotion(nb::module_& m) {
  nb::class_<LocomotionTick>(m, "LocomotionTick", "The controller's tick on its three records.")
      .def(
          "__init__",
          [](LocomotionTick* self, Word settings, Word memory, Word workspace) {
            new (self) LocomotionTick{settings, memory, workspace};
          },
          "settings"_a.noconvert(), "memory"_a.noconvert(), "workspace"_a.noconvert())
      .def("tick", &LocomotionTick::tick, "state"_a, "u"_a,
           "Run a tick up to the QP; return how many feet stand and whether no bound binds: then the torques "
           "are set.")
      .def("finish", &LocomotionTick::finish, "solved"_a,
           "Set the torques of the solution in the workspace, or hold the last ones.");

  nb::class_<FaultDetection>(m, "FaultDetection", "The sums from which a watch judges.")
      .def(
          "__init__",
          [](FaultDetection* self, const Word& legs, double foot_radius, Index settled, Index every,
             Index delays) {
            new (self) FaultDetection{record<leg::LegGeometry>(legs),
                                      {foot_radius, settled, every},
                                      fault_detection::Memory(delays)};
          },
          "legs"_a, "foot_radius"_a, "settled"_a, "every"_a, "delays"_a)
      .def(
          "reset", [](FaultDetection& self) { self.memory.reset(); }, "Forget the past.")
      .def("add_up", &FaultDetection::add_up, "row"_a, "states"_a, "torques"_a,
           "stances"_a, "lift"_a, "Put the sums of n ticks in a row of the window.")
      .def("signals", &FaultDetection::signals, "judgements"_a, "declared"_a,
           "Return slip [m/s], lag and lift [m/s²] over the window.")
      .def_prop_ro(
          "sums",
          [](const FaultDetection& self) {
            return copied(self.memory.sums.data(), fault_detection::WINDOW, self.memory.columns());
          },
          nb::rv_policy::move, "(WINDOW, 4 + 2 delays) of each judgement in the window; a copy.");
  m.attr("HEADING_STARTS") = body_reference::HEADING_STARTS;
  m.attr("HEADING_STOPS") = body_reference::HEADING_STOPS;
  m.attr("WATCH_WINDOW") = fault_detection::WINDOW;

  nb::class_<Motors>(m, "Motors", "The motors of an A1, on views of MuJoCo's data.")
      .def(
          "__init__",
          [](Motors* self, Given1 stall, Given1 no_load_speed, Given1 rate, Numbers<double, 1> delivered) {
            new (self) Motors{stall, no_load_speed, rate, delivered};
          },
          "stall"_a, "no_load_speed"_a, "rate"_a.noconvert(),
          "delivered"_a.noconvert())
      .def("drive", &Motors::drive, "strength"_a, "command"_a,
           "Fill in what the motors deliver of a strength times the commanded torques (12,) [N·m].");
  m.def(
      "torque_limits",
      [](Vector<const double> stall, Vector<const double> no_load_speed, Vector<const double> rate) {
        double limits[2][12];
        impedance::torque_limits(stall, no_load_speed, rate, {limits[0], 2, 12});
        return copied(limits[0], 2, 12);
      },
      "stall"_a, "no_load_speed"_a, "rate"_a,
      "Return (2, 12) the least and the largest torque that the motors give at a rate (12,) [N·m].");

  nb::class_<A1State>(m, "A1State", "The state of an A1, on views of MuJoCo's data.")
      .def(
          "__init__",
          [](A1State* self, Given1 qpos, Given1 qvel, Given1 foot_forces) {
            new (self) A1State{qpos, qvel, foot_forces};
          },
          "qpos"_a.noconvert(), "qvel"_a.noconvert(), "foot_forces"_a.noconvert())
      .def("read", &A1State::read, "state"_a.noconvert(),
           "Fill in the vector (41,) of a state and return whether it is finite.");

  m.def("is_finite", [](Vector<const double> positions, Vector<const double> velocities) {
    return are_finite(positions) && are_finite(velocities);
  }, "positions"_a, "velocities"_a,
        "Return whether a state holds nothing but finite numbers.");
  m.def(
      "cast_rays",
      [](Matrix<const bool> cells, double x, double y, Vector<const double> angles, double reach) {
        std::vector<double> out(angles.size);
        ros_robot::cast(cells, x, y, angles, reach, {out.data(), angles.size});
        return copied(out.data(), out.size());
      },
      "cells"_a, "x"_a, "y"_a, "angles"_a, "reach"_a,
      "Return (k,) how far rays from (x, y) go until an occupied cell, all in cells.");
  bind_locomotion_parts(m);
}

}  // namespace hcbf
