// The monitor of robots that follow commands.
#include <hcbf/motion_monitor.hpp>

#include "records.hpp"

namespace hcbf {

using Line = Numbers<const double, 1>;
using motion_monitor::Law;
using motion_monitor::Notes;

void bind_robots(nb::module_& m) {
  m.def("motion_note_command", [](const Word& notes, const std::tuple<double, double, double>& moves,
                                  double time, bool ends) {
    const auto [ahead, aside, turning] = moves;
    const double all[3] = {ahead, aside, turning};
    command_history::note(record<Notes>(notes).commands, all, time, ends);
  }, "notes"_a.noconvert(), "moves"_a, "time"_a, "ends"_a,
  "Note a robot's command from a time on, or that a command ends then.");
  m.def("motion_observe", [](const Word& notes, const Word& law, const Line& pose, const Line& velocity,
                             double time) {
    return motion_monitor::observe(record<Notes>(notes), record<Law>(law), pose.data(), velocity.data(), time);
  }, "notes"_a.noconvert(), "law"_a.noconvert(), "pose"_a, "velocity"_a, "time"_a,
  "Compare odometry with its predictions, and return the alarm's reason, 0 for none.");
  m.def("motion_propagate", [](const Word& notes, const Word& law, double ahead, const Numbers<double, 1>& pose,
                               const Numbers<double, 1>& twist, double since, double now) {
    return motion_monitor::propagate(record<Notes>(notes), record<Law>(law), ahead, pose.data(), twist.data(),
                                     since, now);
  }, "notes"_a.noconvert(), "law"_a.noconvert(), "ahead"_a, "pose"_a.noconvert(), "twist"_a.noconvert(),
  "since"_a, "now"_a, "Propagate a robot by its commands, and return what its position may be off then [m].");
  m.attr("RESIDUALS_ADD_UP") = motion_monitor::ADDS_UP;
}

}  // namespace hcbf
