#include <hcbf/extent.hpp>
#include <hcbf/field.hpp>
#include <hcbf/ground.hpp>
#include <hcbf/guidance_row.hpp>
#include <hcbf/local_guidance.hpp>

#include "bindings.hpp"

namespace nanobind::detail {
template <>
struct type_caster<hcbf::field::Geometry> : numbers_caster<hcbf::field::Geometry, 7> {};
template <>
struct type_caster<hcbf::guidance_row::Pull> : tuple_caster<hcbf::guidance_row::Pull, double, double, double, double> {};
template <>
struct type_caster<hcbf::ground::Window> : tuple_caster<hcbf::ground::Window, hcbf::Index, hcbf::Index, hcbf::Index, hcbf::Index> {};
}  // namespace nanobind::detail

namespace hcbf {

namespace {

using field::Geometry;
using guidance_row::Pull, guidance_row::Row;
using march::Rank;

using Line = Vector<const double>;
using Table = Matrix<const double>;
using Kinds = Vector<const Index>;

// Arrays in any layout, such as one field of many records.
template <class T, int N>
using Spread = nb::ndarray<T, nb::ndim<N>, nb::device::cpu>;

void bind_extent(nb::module_& m) {
  m.attr("FIELD_CELL") = extent::CELL;
  m.attr("FIELD_FINE") = extent::FINE;
  m.attr("FIELD_MAX_CELLS") = static_cast<Index>(extent::MAX_CELLS);
  m.def("scene_extent", [](const Kinds& kind, const Table& parameters, const Kinds& priority,
                           const Line& start, const Line& goal, double t, const Matrix<double>& out) {
    *reinterpret_cast<extent::Extent*>(out.data) =
        extent::scene_extent(kind, parameters, priority, start.data, goal.data, t);
  }, "kind"_a, "parameters"_a, "priority"_a, "start"_a, "goal"_a, "t"_a, "extent"_a,
  "Write the extent (2, 2) of start, goal and the bounded regions [m].");
  m.def("geometry_over", [](const Table& over, double cell, const Vector<double>& geometry) {
    *reinterpret_cast<Geometry*>(geometry.data) =
        extent::geometry_over(*reinterpret_cast<const extent::Extent*>(over.data), cell);
  }, "extent"_a, "cell"_a, "geometry"_a,
  "Write the geometry (7,) of a grid over an extent (2, 2).");
}

void bind_ground(nb::module_& m) {
  using Costs = Matrix<float>;
  using Ranks = Matrix<Rank>;
  using Cells = Matrix<const bool>;

  m.attr("GROUND_HALO") = ground::HALO;
  m.def("paint_barriers", [](const Costs& cost, const Ranks& rank, const Geometry& geometry, const Kinds& kind,
                             const Table& parameters, const Kinds& priority, const Line& clearance, double t,
                             Index opened) {
    ground::paint_barriers({cost, rank}, geometry, kind,
                           parameters, priority, clearance, t, opened);
  }, "cost"_a, "rank"_a, "geometry"_a, "kind"_a, "parameters"_a, "priority"_a,
  "clearance"_a, "t"_a, "opened"_a,
  "Paint the regions of one scene's barriers as they are at time t.", Unlocked());
  m.def("paint_cells", [](const Costs& cost, const Ranks& rank, const ground::Window& window, const Cells& cells,
                          double side, Index priority, double clearance, Index opened) {
    ground::paint_cells({cost, rank}, window, cells, side,
                        priority, clearance, opened);
  }, "cost"_a, "rank"_a, "window"_a, "cells"_a, "side"_a, "priority"_a, "clearance"_a,
  "opened"_a, "Paint what occupied cells of one rank make of a window of the ground.", Unlocked());
  m.def("cell_distances", [](const Cells& cells, Index reach) {
    const auto all = cells;
    std::vector<float> found;
    {
      const nb::gil_scoped_release unlocked;
      found = ground::distances(all, {0, all.rows, 0, all.columns}, reach);
    }
    return owned<float>(std::move(found), {static_cast<std::size_t>(cells.rows), static_cast<std::size_t>(cells.columns)});
  }, "cells"_a, "reach"_a,
  "Return distances (ny, nx) of the cells' centres from the nearest occupied square.");
}

void bind_field(nb::module_& m) {
  m.def("solve_field", [](const Matrix<const float>& cost, const Matrix<const Rank>& rank,
                          const Geometry& geometry, const Line& goal, Index opened,
                          const Vector<float>& field, const Vector<Rank>& through) {
    field::solve(cost, rank, geometry, goal.data, opened, field,
                 through);
  }, "cost"_a, "rank"_a, "geometry"_a, "goal"_a, "opened"_a, "field"_a, "through"_a,
  "Write the field of a painted ground.", Unlocked());
  m.def("field_crossing", [](const Matrix<const Rank>& rank, const Matrix<const float>& values,
                             Index j, Index i, Index opened) {
    const auto found = field::crossing(rank, values, {j, i}, opened);
    return std::tuple(found.rank, found.cell.j, found.cell.i);
  }, "rank"_a, "view"_a, "j"_a, "i"_a, "opened"_a,
  "Return rank, row and column of the first closed region that the path from a cell enters.");
  m.def("field_to_cells", [](double x, double y, const Geometry& geometry) {
    const auto at = field::to_cells(x, y, geometry);
    return std::pair(at.row, at.column);
  }, "x"_a, "y"_a, "geometry"_a, "Return row and column of a point, whole numbers at the cells' centres.");
  m.def("field_cell_of", [](double x, double y, const Geometry& geometry) {
    const auto cell = field::cell_of(x, y, geometry);
    return std::pair(cell.j, cell.i);
  }, "x"_a, "y"_a, "geometry"_a, "Return row and column of the cell nearest a point.");
  m.def("field_descent", [](const Matrix<const float>& values, const Geometry& geometry, const Line& goal,
                            double x, double y, double length) {
    const auto point = field::descent(values, geometry, goal.data, x, y, length);
    return std::pair(point.x, point.y);
  }, "view"_a, "geometry"_a, "goal"_a, "x"_a, "y"_a, "length"_a,
  "Return the point that is `length` further down the field.");
}

void bind_rows(nb::module_& m) {
  m.def("guidance_rows", [](const Matrix<const float>& fields, const Table& geometry, const Table& goal,
                            const Spread<const double, 2>& x, const Pull& pull,
                            const Spread<double, 2>& out) {
    const auto* geometries = reinterpret_cast<const Geometry*>(geometry.data);
    const auto states = x.view();
    const auto rows = out.view();
    for (Index n = 0; n < fields.rows; ++n) {
      const double state[4] = {states(n, 0), states(n, 1), states(n, 2), states(n, 3)};
      const Row last{rows(n, 0), rows(n, 1), rows(n, 2)};
      const auto row = guidance_row::row(fields[n], geometries[n],
                                         goal[n].data, state, pull, last);
      rows(n, 0) = row.a_x, rows(n, 1) = row.a_y, rows(n, 2) = row.b;
    }
  }, "field"_a, "geometry"_a, "goal"_a, "x"_a, "pull"_a, "out"_a,
  "Write a_x, a_y and b (N, 3) of N states (N, 4), each in its own field.");
  m.def("guidance_rank_at", &guidance_row::rank_at, "ranks"_a, "geometry"_a, "x"_a, "y"_a, "Return the rank at a point's cell; 0 for none.");
  m.def("guidance_ranks", [](const Matrix<const Rank>& through, const Matrix<const Rank>& zones,
                             const Table& geometry, const Spread<const double, 2>& x,
                             const Spread<double, 1>& reachable, const Spread<double, 1>& zone) {
    const auto* geometries = reinterpret_cast<const Geometry*>(geometry.data);
    const auto states = x.view();
    const auto to_goal = reachable.view(), here = zone.view();
    for (Index n = 0; n < through.rows; ++n) {
      const Geometry& place = geometries[n];
      to_goal(n) = guidance_row::rank_at(through[n], place, states(n, 0), states(n, 1));
      here(n) = guidance_row::rank_at(zones[n], place, states(n, 0), states(n, 1));
    }
  }, "through"_a, "zones"_a, "geometry"_a, "x"_a, "reachable"_a, "zone"_a,
  "Write through which ranks N states reach their goals, and in which zones they are.");
  m.def("guidance_insert", &guidance_row::insert, "priority"_a, "reachable"_a, "zone"_a, "through"_a, "out"_a,
  "Write the ranks (m + 1,) of m rows and, as the last entry, of the guidance row.");
  m.def("guidance_shape", [](double ux, double uy, double ax, double ay, double b) {
    const auto u = guidance_row::shape(ux, uy, ax, ay, b);
    return std::pair(u.x, u.y);
  }, "ux"_a, "uy"_a, "ax"_a, "ay"_a, "b"_a, "Return the input nearest u* that satisfies the guidance row.");
}

void bind_local(nb::module_& m) {
  m.attr("CIRCULATION_STUCK") = local_guidance::STUCK;
  m.def("circulation_rows", [](const Matrix<const Index>& kind,
                               const Cube<const double>& parameters, const Spread<const double, 2>& x,
                               const Spread<const double, 1>& t, const Spread<const double, 2>& u_nominal,
                               const Pull& pull, const Matrix<double>& memory,
                               const Spread<double, 2>& out) {
    const auto states = x.view(), inputs = u_nominal.view();
    const auto times = t.view();
    const auto rows = out.view();
    auto* memories = reinterpret_cast<local_guidance::Memory*>(memory.data);
    for (Index n = 0; n < kind.rows; ++n) {
      const double state[4] = {states(n, 0), states(n, 1), states(n, 2), states(n, 3)};
      const double input[2] = {inputs(n, 0), inputs(n, 1)};
      const auto row = local_guidance::circulation(kind[n], parameters[n], state, times(n), input,
                                                   pull, memories[n]);
      rows(n, 0) = row.a_x, rows(n, 1) = row.a_y, rows(n, 2) = row.b;
    }
  }, "kind"_a, "parameters"_a, "x"_a, "t"_a, "u_nominal"_a, "pull"_a, "memory"_a,
  "out"_a, "Write a_x, a_y and b (N, 3) of the rows along edges at N states.");
}

}  // namespace

void bind_guidance(nb::module_& m) {
  bind_extent(m);
  bind_ground(m);
  bind_field(m);
  bind_rows(m);
  bind_local(m);
}

}  // namespace hcbf
