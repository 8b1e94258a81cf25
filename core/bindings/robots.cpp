// What robots were commanded, and how they moved.
#include <hcbf/motion_monitor.hpp>
#include <hcbf/response_monitor.hpp>

#include "records.hpp"

namespace hcbf {

namespace {

using Line = Numbers<const double, 1>;
using response_monitor::Law;
using response_monitor::Notes;

void bind_response_monitor(nb::module_& m) {
  m.def("response_tell", [](const Word& notes, const std::tuple<double, double, double>& moves, double time,
                            bool ends) {
    const auto [ahead, aside, turning] = moves;
    const double all[3] = {ahead, aside, turning};
    command_history::tell(record<Notes>(notes), all, time, ends);
  }, "notes"_a.noconvert(), "moves"_a, "time"_a, "ends"_a,
  "Note what a robot is commanded from a time on, or that a command ends then.");
  m.def("response_observe", [](const Word& notes, const Word& law, const Line& pose, const Line& velocity,
                               double time, double noise) {
    return response_monitor::observe(record<Notes>(notes), record<Law>(law), pose.data(), velocity.data(),
                                     time, noise);
  }, "notes"_a.noconvert(), "law"_a.noconvert(), "pose"_a, "velocity"_a, "time"_a, "noise"_a,
  "Compare odometry with what the robot was commanded, and return whether that alarms.");
  m.def("response_carry", [](const Word& notes, const Word& law, double ahead, const Numbers<double, 1>& pose,
                             const Numbers<double, 1>& twist, double since, double now) {
    return response_monitor::carry(record<Notes>(notes), record<Law>(law), ahead, pose.data(), twist.data(),
                                   since, now);
  }, "notes"_a.noconvert(), "law"_a.noconvert(), "ahead"_a, "pose"_a.noconvert(), "twist"_a.noconvert(),
  "since"_a, "now"_a, "Write where the commands have brought a robot, and return what that may be off [m].");
}

void bind_motion_monitor(nb::module_& m) {
  m.def("motion_observe", [](const Word& notes, const Line& body, double time, double longest,
                             double hardest) {
    return motion_monitor::observe(record<motion_monitor::Notes>(notes), body.data(), time, longest, hardest);
  }, "notes"_a.noconvert(), "body"_a, "time"_a, "longest"_a, "hardest"_a,
  "Compare a sample of pose and twist with the one before, and return whether that alarms.");
}

}  // namespace

void bind_robots(nb::module_& m) {
  bind_response_monitor(m);
  bind_motion_monitor(m);
  m.attr("RESPONSE_SWAYS") = response_monitor::SWAYS;
}

}  // namespace hcbf
