// What environments count, and how their robots advance.
#include "bindings.hpp"

#include <hcbf/body.hpp>
#include <hcbf/drive.hpp>
#include <hcbf/regions_batch.hpp>
#include <hcbf/tally.hpp>

namespace nanobind::detail {
using hcbf::Cube, hcbf::Index, hcbf::Matrix, hcbf::Vector;
template <>
struct type_caster<hcbf::regions_batch::References>
    : tuple_caster<hcbf::regions_batch::References, Cube<const double>, Vector<const Index>, Vector<const Index>> {};
template <>
struct type_caster<hcbf::body_points::BodyPoints>
    : tuple_caster<hcbf::body_points::BodyPoints, Vector<const Index>, Matrix<const double>, Vector<const double>> {};
}  // namespace nanobind::detail

namespace hcbf {
namespace {

using Line = Vector<const double>;
using Table = Matrix<const double>;
using Stack = Cube<const double>;
using Kinds = Matrix<const Index>;
using Wholes = Vector<const Index>;
using Written = Vector<double>;
using WrittenTable = Matrix<double>;
using Atlas = Vector<const double>;  // without numbers where there is no map


using body_points::BodyPoints;
using regions_batch::References;

void bind_task(nb::module_& m) {
  m.def("task_terms", [](const Line& before, const Line& after, const Vector<const bool>& reached,
                         const Table& u, const WrittenTable& terms) {
    const auto out = terms;
    task::write_terms(before, after, reached, u, {out[0], out[1], out[2]});
  }, "before"_a, "after"_a, "reached"_a, "u"_a, "terms"_a,
  "Write (3, N) what effort costs, by how much the goal came nearer, and what reaching it earns.");
  m.def("task_costs", &task::costs_of, "least"_a, "kind"_a, "priority"_a, "cost"_a, "costs"_a,
  "Write the costs (N,), and by rank (N, R), of the least h (N, m) in a step.");
  m.def("are_finite", [](const nb::ndarray<const double, nb::c_contig, nb::device::cpu>& numbers) {
    return are_finite({numbers.data(), static_cast<Index>(numbers.size())});
  }, "numbers"_a, "Return whether an array holds nothing but finite numbers.");
  m.attr("CONTROL_DT") = task::CONTROL_DT;
  m.attr("PHYSICS_DT") = task::PHYSICS_DT;
  m.attr("SUBSTEPS") = task::SUBSTEPS;
}

using Step = std::tuple<Line, double, double, bool, bool, Index>;  // as `tally.Task` has it

tally::Step view_of(const Step& step) {
  const auto& [u, before, after, success, reaches, ranks] = step;
  return {u.data, before, after, success, reaches, ranks};
}

void bind_tally(nb::module_& m) {
  m.attr("TALLY_TERMS") = static_cast<Index>(tally::TERMS);
  m.attr("TALLY_REWARD") = static_cast<Index>(tally::REWARD);
  m.attr("TALLY_HEAD") = static_cast<Index>(tally::HEAD);
  m.def("tally_count", [](const Table& h, const Table& sensed, const Wholes& kind, const Wholes& priority,
                          const Line& x, const Line& reference, const Step& step, const Written& memory) {
    tally::count(h, sensed, kind, priority, x.data, reference.data, view_of(step),
                 memory);
  }, "h"_a, "sensed"_a, "kind"_a, "priority"_a, "x"_a, "reference"_a, "step"_a, "memory"_a,
  "Write what a step came to, from the barriers' values.");
  m.def("tally_look", [](const Kinds& kind, const Stack& parameters, const Kinds& priority,
                         const Atlas& atlas, const Table& path, const Line& times, const Line& x, double time,
                         const Line& reference, const Step& step, const Written& memory) {
    tally::look({kind[0], parameters[0], priority[0]}, atlas, path,
                times, x.data, time, reference.data, view_of(step), memory);
  }, "kind"_a, "parameters"_a, "priority"_a, "atlas"_a.none(), "path"_a, "times"_a, "x"_a, "time"_a,
  "reference"_a, "step"_a, "memory"_a,
  "Look at barriers that are all built in, and write what a step came to.");
}

void bind_regions_batch(nb::module_& m) {
  m.def("regions_observe", &regions_batch::observe, "references"_a, "x"_a, "steps"_a, "sensed"_a, "seen"_a, "error"_a,
  "Write the observations (N, 8 + 4 m) and the distances (N,) from the references.");
  m.def("regions_advance", &regions_batch::advance, "kind"_a, "parameters"_a, "atlas"_a.none(), "references"_a, "x"_a, "steps"_a, "u"_a,
  "v_max"_a, "min_h"_a, "before"_a, Unlocked(),
  "Advance N robots by one control step; write the least h (N, m) and the distances (N,) before it.");
}

void bind_bodies(nb::module_& m) {
  m.def("tracked_path", &drive::tracked, "base"_a, "look_ahead"_a, "path"_a,
  "Write (k, 4) the path of the point before the trunk, and return for how many rows it is finite.");
  m.def("body_reach", [](const BodyPoints& body, const Table& position, const Table& rotation,
                         const Line& centre) {
    return body_points::reach(body, position, rotation, centre.data);
  }, "body"_a, "position"_a, "rotation"_a, "centre"_a,
  "Return the greatest horizontal distance of the body from a point.");
  m.def("body_heights", &body::body_h, "body"_a, "position"_a, "rotation"_a, "kind"_a, "parameters"_a, "atlas"_a.none(), "t"_a,
  "h"_a, "Write the least h (m,) of each barrier over the whole body.");
}

}  // namespace

void bind_envs(nb::module_& m) {
  bind_task(m);
  bind_tally(m);
  bind_regions_batch(m);
  bind_bodies(m);
}

}  // namespace hcbf
