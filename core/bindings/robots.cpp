// What robots were commanded, and how they moved.
#include <utility>
#include <vector>

#include <hcbf/motion_monitor.hpp>
#include <hcbf/response_monitor.hpp>

#include "bytes.hpp"
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

// Where Python and C++ have one layout: by module, the size of a record and its fields.
nb::dict layouts() {
  nb::dict all;
  all["command_history.NOTES"] = layout_of(
      sizeof(Notes), {FIELD(Notes, told_at), FIELD(Notes, told), FIELD(Notes, ends), FIELD(Notes, count),
                      FIELD(Notes, acting), FIELD(Notes, velocity), FIELD(Notes, braked),
                      FIELD(Notes, place), FIELD(Notes, time), FIELD(Notes, begun), FIELD(Notes, missed),
                      FIELD(Notes, moved), FIELD(Notes, doubt), FIELD(Notes, apart), FIELD(Notes, widest),
                      FIELD(Notes, seen), FIELD(Notes, missing), FIELD(Notes, asked), FIELD(Notes, hidden),
                      FIELD(Notes, worst)});
  all["command_history.LAW"] = layout_of(
      sizeof(Law), {FIELD(Law, tau), FIELD(Law, delay), FIELD(Law, first), FIELD(Law, most),
                    FIELD(Law, lasting), FIELD(Law, share), FIELD(Law, braking), FIELD(Law, overshoot),
                    FIELD(Law, arc), FIELD(Law, forward)});
  using Motion = motion_monitor::Notes;
  using monitor::Memory;
  using monitor::PlanarMemory;
  std::vector<FieldOffset> fields;
  const auto of = [&](std::size_t start, std::vector<FieldOffset> parts) {
    for (const auto& [name, offset] : parts) fields.push_back({name, start + offset});
  };
  of(offsetof(Motion, watched),
     {FIELD(Memory, error), FIELD(Memory, missed), FIELD(Memory, exact), FIELD(Memory, off),
      FIELD(Memory, samples), FIELD(Memory, bend), FIELD(Memory, in_a_row)});
  of(offsetof(Motion, planar),
     {FIELD(PlanarMemory, drift), FIELD(PlanarMemory, motion), FIELD(PlanarMemory, body)});
  of(0, {FIELD(Motion, time), FIELD(Motion, begun), FIELD(Motion, missing), FIELD(Motion, apart),
         FIELD(Motion, noise), FIELD(Motion, place), FIELD(Motion, left)});
  all["motion_monitor.NOTES"] = layout_of(sizeof(Motion), fields);
  return all;
}

}  // namespace

void bind_robots(nb::module_& m) {
  bind_response_monitor(m);
  bind_motion_monitor(m);
  m.attr("RESPONSE_SWAYS") = response_monitor::SWAYS;
  m.def("robot_layouts", layouts, "Return size and offsets of the records of both monitors, by their names.");
}

}  // namespace hcbf
