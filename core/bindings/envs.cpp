// What environments count, and how their robots advance.
#include "bindings.hpp"

#include <optional>

#include <nanobind/stl/optional.h>

#include <hcbf/body.hpp>
#include <hcbf/drive.hpp>
#include <hcbf/regions_batch.hpp>
#include <hcbf/tally.hpp>

namespace hcbf {
namespace {

using Line = Numbers<const double, 1>;
using Table = Numbers<const double, 2>;
using Stack = Numbers<const double, 3>;
using Kinds = Numbers<const Index, 2>;
using Wholes = Numbers<const Index, 1>;
using Written = Numbers<double, 1>;
using WrittenTable = Numbers<double, 2>;
using Atlas = std::optional<Line>;  // None where there is no map

Vector<const double> view_of(const Atlas& atlas) {
  return atlas ? view(*atlas) : Vector<const double>{nullptr, 0};
}

// As the named tuples `References` and `BodyPoints` hold them.
using References = std::tuple<Stack, Wholes, Wholes>;
using BodyPoints = std::tuple<Wholes, Table, Line>;

regions_batch::References view_of(const References& references) {
  const auto& [tables, of, last] = references;
  return {view(tables), view(of), view(last)};
}

body_points::BodyPoints view_of(const BodyPoints& body) {
  const auto& [geom, place, radius] = body;
  return {view(geom), view(place), view(radius)};
}

void bind_task(nb::module_& m) {
  m.def("task_terms", [](const Line& before, const Line& after, const Numbers<const bool, 1>& reached,
                         const Table& u, const WrittenTable& terms) {
    const auto out = view(terms);
    task::write_terms(view(before), view(after), view(reached), view(u), {out[0], out[1], out[2]});
  }, "before"_a, "after"_a, "reached"_a, "u"_a, "terms"_a.noconvert(),
  "Write (3, N) what effort costs, by how much the goal came nearer, and what reaching it earns.");
  m.def("task_costs", [](const Table& least, const Kinds& kind, const Kinds& priority, const Written& cost,
                         const WrittenTable& costs) {
    task::costs_of(view(least), view(kind), view(priority), view(cost), view(costs));
  }, "least"_a, "kind"_a, "priority"_a, "cost"_a.noconvert(), "costs"_a.noconvert(),
  "Write the costs (N,), and by rank (N, R), of the least h (N, m) in a step.");
  m.def("are_finite", [](const nb::ndarray<const double, nb::c_contig, nb::device::cpu>& numbers) {
    return task::are_finite(numbers.data(), static_cast<Index>(numbers.size()));
  }, "numbers"_a, "Return whether an array holds nothing but finite numbers.");
  m.attr("CONTROL_DT") = task::CONTROL_DT;
  m.attr("PHYSICS_DT") = task::PHYSICS_DT;
  m.attr("SUBSTEPS") = task::SUBSTEPS;
}

using Step = std::tuple<Line, double, double, bool, bool, Index>;  // as `tally.Task` has it

tally::Step view_of(const Step& step) {
  const auto& [u, before, after, success, reaches, ranks] = step;
  return {u.data(), before, after, success, reaches, ranks};
}

void bind_tally(nb::module_& m) {
  m.def("tally_count", [](const Table& h, const Table& sensed, const Wholes& kind, const Wholes& priority,
                          const Line& x, const Line& reference, const Step& step, const Written& memory) {
    tally::count(view(h), view(sensed), view(kind), view(priority), x.data(), reference.data(), view_of(step),
                 view(memory));
  }, "h"_a, "sensed"_a, "kind"_a, "priority"_a, "x"_a, "reference"_a, "step"_a, "memory"_a.noconvert(),
  "Write what a step came to, from the barriers' values.");
  m.def("tally_look", [](const Kinds& kind, const Stack& parameters, const Kinds& priority,
                         const Atlas& atlas, const Table& path, const Line& times, const Line& x, double time,
                         const Line& reference, const Step& step, const Written& memory) {
    tally::look({view(kind)[0], view(parameters)[0], view(priority)[0]}, view_of(atlas), view(path),
                view(times), x.data(), time, reference.data(), view_of(step), view(memory));
  }, "kind"_a, "parameters"_a, "priority"_a, "atlas"_a.none(), "path"_a, "times"_a, "x"_a, "time"_a,
  "reference"_a, "step"_a, "memory"_a.noconvert(),
  "Look at barriers that are all built in, and write what a step came to.");
}

void bind_regions_batch(nb::module_& m) {
  m.def("regions_observe", [](const References& references, const Table& x, const Wholes& steps,
                              const Stack& sensed, const WrittenTable& seen, const Written& error) {
    regions_batch::observe(view_of(references), view(x), view(steps), view(sensed), view(seen), view(error));
  }, "references"_a, "x"_a, "steps"_a, "sensed"_a, "seen"_a.noconvert(), "error"_a.noconvert(),
  "Write the observations (N, 8 + 4 m) and the distances (N,) from the references.");
  m.def("regions_advance", [](const Kinds& kind, const Stack& parameters, const Atlas& atlas,
                              const References& references, const WrittenTable& x, const Wholes& steps,
                              const Table& u, const Line& v_max, const WrittenTable& min_h,
                              const Written& before) {
    regions_batch::advance(view(kind), view(parameters), view_of(atlas), view_of(references), view(x),
                           view(steps), view(u), view(v_max), view(min_h), view(before));
  }, "kind"_a, "parameters"_a, "atlas"_a.none(), "references"_a, "x"_a.noconvert(), "steps"_a, "u"_a,
  "v_max"_a, "min_h"_a.noconvert(), "before"_a.noconvert(), Unlocked(),
  "Advance N robots by one control step; write the least h (N, m) and the distances (N,) before it.");
}

void bind_bodies(nb::module_& m) {
  m.def("tracked_path", [](const Table& base, double look_ahead, const WrittenTable& path) {
    return drive::tracked(view(base), look_ahead, view(path));
  }, "base"_a, "look_ahead"_a, "path"_a.noconvert(),
  "Write (k, 4) the path of the point before the trunk, and return for how many rows it is finite.");
  m.def("body_reach", [](const BodyPoints& body, const Table& position, const Table& rotation,
                         const Line& centre) {
    return body_points::reach(view_of(body), view(position), view(rotation), centre.data());
  }, "body"_a, "position"_a, "rotation"_a, "centre"_a,
  "Return the greatest horizontal distance of the body from a point.");
  m.def("body_heights", [](const BodyPoints& body, const Table& position, const Table& rotation,
                           const Wholes& kind, const Table& parameters, const Atlas& atlas, double t,
                           const Written& h) {
    body::body_h(view_of(body), view(position), view(rotation), view(kind), view(parameters), view_of(atlas),
                 t, view(h));
  }, "body"_a, "position"_a, "rotation"_a, "kind"_a, "parameters"_a, "atlas"_a.none(), "t"_a,
  "h"_a.noconvert(), "Write the least h (m,) of each barrier over the whole body.");
}

}  // namespace

void bind_envs(nb::module_& m) {
  bind_task(m);
  bind_tally(m);
  bind_regions_batch(m);
  bind_bodies(m);
}

}  // namespace hcbf
