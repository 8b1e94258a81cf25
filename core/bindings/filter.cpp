#include <hcbf/state_check.hpp>
#include <hcbf/step.hpp>

#include <algorithm>
#include <cstddef>
#include <exception>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include <nanobind/stl/optional.h>

#include "bindings.hpp"
#include "model_step.hpp"
#include "records.hpp"

namespace hcbf {

namespace {

constexpr Index LEAST_PLANTS = 64;  // fewer are filtered sooner than a thread starts

// The filter of N plants, bound to the arrays that it reads and writes, which it keeps alive. Nothing is
// allocated in a step of a scene that it has seen.
class Filter {
 public:
  Filter(Numbers<double, 1> constants, Numbers<const double, 1> program, Words sensed, Index threads)
      : arrays_(std::move(constants)), program_(std::move(program)), sensed_(std::move(sensed)),
        constants_(*reinterpret_cast<plants::Constants*>(arrays_.data())) {
    plants_.sensed = records<plants::Plant>(sensed_);
    plants_.n_u = (plants_.sensed.stride - static_cast<Index>(sizeof(plants::Plant))) / (2 * sizeof(double));
    rooms_.resize(std::max<Index>(1, std::min(threads, plants_.sensed.size / LEAST_PLANTS)));
  }

  Filter(const Filter&) = delete;
  Filter& operator=(const Filter&) = delete;

  void set_scene(Numbers<const Index, 2> kind, Numbers<const double, 3> parameters,
                 Numbers<const Index, 2> priority, Numbers<const double, 2> own_margin,
                 std::optional<Numbers<const double, 1>> atlas, Numbers<const double, 2> ends,
                 std::optional<Numbers<const double, 3>> own) {
    plants_.kind = view(kind), plants_.parameters = view(parameters), plants_.priority = view(priority);
    plants_.own_margin = view(own_margin), plants_.ends = view(ends);
    plants_.own = own ? view(*own) : Cube<const double>{nullptr, 0, 0, 0};
    atlas_ = atlas ? view(*atlas) : Vector<const double>{nullptr, 0};
    scene_ = {std::move(kind),       std::move(parameters), std::move(priority),
              std::move(own_margin), std::move(atlas),      std::move(ends),
              std::move(own)};
  }

  // The user's manoeuvres, a function of which, state and samples.
  void set_laws(nb::object laws) {
    laws_ = std::move(laws);
    for (step::Room& room : rooms_) room.laws = {gate_input, &laws_};
  }

  void set_report(Words reports, Words rows) {
    constexpr Index WIDTH = sizeof(report::Row) / sizeof(double);
    plants_.reports = records<report::Plant>(reports);
    plants_.rows = {reinterpret_cast<report::Row*>(rows.data()), static_cast<Index>(rows.shape(0)),
                    static_cast<Index>(rows.shape(1)) / WIDTH};
    report_ = {std::move(reports), std::move(rows)};
  }

  void set_states(Numbers<double, 2> x, Numbers<double, 2> model, Numbers<double, 2> lag,
                  Numbers<double, 3> covariance, Numbers<double, 2> accepted) {
    states_ = {view(x), view(model), view(lag), view(covariance), view(accepted)};
    own_states_ = {std::move(x), std::move(model), std::move(lag), std::move(covariance),
                   std::move(accepted)};
  }

  // Checks the states of planar double integrators, whose own rows are made from them.
  void check_states() {
    for (Index i = 0; i < plants_.sensed.size; ++i)
      plants_.reports[i].reason = state_check::check(plants_.sensed[i], {plants_.sensed.tail(i), 2});
  }
  // Checks the states of any model, raises alarms, and writes braking inputs; returns whether u* is finite.
  bool sense(ModelStep& step, bool parts) {
    for (Index i = 0; i < plants_.reports.size; ++i)
      if (!are_finite({plants_.reports.tail(i), plants_.n_u})) return false;
    step.sense(plants_.sensed, states_, plants_.reports, parts);
    return true;
  }
  void make_rows(ModelStep& step) { step.make_rows(states_); }

  Index filter() {
    const step::Answer wrong = step::check(constants_, plants_);
    if (wrong != step::DONE) return wrong;
    const Index count = plants_.sensed.size, parts = static_cast<Index>(rooms_.size());
    if (count < LEAST_PLANTS) return filter_some(0, count, rooms_[0]);  // sooner than the lock is released
    const nb::gil_scoped_release unlocked;
    std::vector<Index> found(parts, step::DONE);
    std::vector<std::exception_ptr> raised(parts);  // by a manoeuvre of the user's
    const auto run = [&](Index part) {
      try {
        found[part] = filter_some(count * part / parts, count * (part + 1) / parts, rooms_[part]);
      } catch (...) {
        raised[part] = std::current_exception();
      }
    };
    std::vector<std::thread> others;
    others.reserve(parts - 1);
    for (Index part = 1; part < parts; ++part) {
      try {
        others.emplace_back(run, part);
      } catch (const std::system_error&) {  // no thread is left
        run(part);
      }
    }
    run(0);
    for (std::thread& other : others) other.join();
    for (const std::exception_ptr& one : raised)
      if (one) std::rethrow_exception(one);
    return *std::max_element(found.begin(), found.end());
  }

  // Returns what is wrong with the arrays, as `filter`.
  Index check() const { return step::check(constants_, plants_); }

  // Poses the problem of plant i to a solver outside; false where the plant is brought to rest without it.
  bool pose(Index i) {
    const One p = step::plant_of(plants_, i);
    const program_records::Settings program = step::program_of(constants_, view(program_), i);
    if (!step::is_posed(constants_, program, p, rooms_[0].laws)) return false;
    if (atlas_.size > 0) map_rows::find(constants_, p, atlas_, rooms_[0].map);
    posed_ = step::pose(constants_, program, part(i), rooms_[0].work);
    return true;
  }

  // u*, a, b, h, alpha2(psi) and ranks of the rows that were posed, where guidance's comes last.
  nb::tuple problem() {
    const plants::Work& w = rooms_[0].work;
    return nb::make_tuple(array(w.u), array(w.a), array(w.rows[rows::B]), array(w.rows[rows::H]),
                          array(w.rows[rows::ALPHA2_PSI]), array(w.priority));
  }

  // u, slack and delta of the posed problem, to be written.
  nb::tuple answer() {
    const plants::Work& w = rooms_[0].work;
    return nb::make_tuple(array(w.answer.u), array(w.answer.slack), array(w.answer.delta));
  }

  // Of each condition that was posed its rank, and which one of the scene it is of.
  nb::tuple conditions(Index i) {
    const One p = part(i);
    std::vector<Index> ranks(p.priority.begin(), p.priority.end()), source(rooms_[0].map.nearby.source);
    if (atlas_.size == 0)
      for (Index k = 0; k < p.kind.size; ++k) source.push_back(k);
    const std::size_t m = ranks.size();
    return nb::make_tuple(owned<Index>(std::move(ranks), {m}), owned<Index>(std::move(source), {m}));
  }

  // The corners of U of the posed problem.
  auto corners() {
    const Vector<const double> all{posed_.vertices.data, 2 * posed_.vertices.rows};
    return owned<double>(std::vector<double>(all.begin(), all.end()), {all.size / std::size_t{2}, 2});
  }

  // Concludes what `pose` began: with the answer that was written, or without one.
  Index close(Index i, bool answered, Index status, Index fallbacks) {
    step::Room& room = rooms_[0];
    room.work.answer.status = status, room.work.answer.fallbacks = fallbacks;
    const One p = step::plant_of(plants_, i);
    step::close(constants_, posed_, answered, part(i), room.work);
    if (atlas_.size > 0) map_rows::merge(room.map, p);
    return p.report.reason != 0 ? step::ASKS : step::DONE;
  }

 private:
  using One = plants::One;

  // Plant i as it was posed.
  One part(Index i) {
    const One p = step::plant_of(plants_, i);
    return atlas_.size > 0 ? map_rows::with_pieces(p, rooms_[0].map) : p;
  }

  Index filter_some(Index first, Index end, step::Room& room) const {
    bool asks = false;
    for (Index i = first; i < end; ++i)
      asks |= step::filter(constants_, step::program_of(constants_, view(program_), i),
                           step::plant_of(plants_, i), atlas_, room);
    return asks ? step::ASKS : step::DONE;
  }

  template <class T>
  nb::object array(Vector<T> of) {
    return nb::cast(
        nb::ndarray<nb::numpy, T, nb::ndim<1>>(of.data, {static_cast<std::size_t>(of.size)}, nb::find(this)),
        nb::rv_policy::reference);
  }
  template <class T>
  nb::object array(Matrix<T> of) {
    const auto rows = static_cast<std::size_t>(of.rows), columns = static_cast<std::size_t>(of.columns);
    return nb::cast(nb::ndarray<nb::numpy, T, nb::ndim<2>>(of.data, {rows, columns}, nb::find(this)),
                    nb::rv_policy::reference);
  }

  Numbers<double, 1> arrays_;
  Numbers<const double, 1> program_;
  Words sensed_;
  std::tuple<Numbers<const Index, 2>, Numbers<const double, 3>, Numbers<const Index, 2>,
             Numbers<const double, 2>, std::optional<Numbers<const double, 1>>, Numbers<const double, 2>,
             std::optional<Numbers<const double, 3>>>
      scene_;
  std::pair<Words, Words> report_;
  std::tuple<Numbers<double, 2>, Numbers<double, 2>, Numbers<double, 2>, Numbers<double, 3>,
             Numbers<double, 2>>
      own_states_;
  const plants::Constants& constants_;
  nb::object laws_;
  plants::Plants plants_{};
  state_check::States states_{};
  Vector<const double> atlas_{nullptr, 0};
  program_records::Settings posed_{};
  std::vector<step::Room> rooms_;
};

}  // namespace

void bind_filter(nb::module_& m) {
  nb::class_<Filter>(m, "Filter", "The filter of N plants, bound to the arrays that it reads and writes.")
      .def(nb::init<Numbers<double, 1>, Numbers<const double, 1>, Words, Index>(), "constants"_a.noconvert(),
           "program"_a.noconvert(), "sensed"_a.noconvert(), "threads"_a)
      .def("set_scene", &Filter::set_scene, "kind"_a.noconvert(), "parameters"_a.noconvert(),
           "priority"_a.noconvert(), "own_margin"_a.noconvert(), "atlas"_a.none().noconvert(),
           "ends"_a.noconvert(), "own"_a.none().noconvert(), "Read these scenes and own rows from now on.")
      .def("set_laws", &Filter::set_laws, "laws"_a, "Follow these manoeuvres of the user's from now on.")
      .def("set_report", &Filter::set_report, "plants"_a.noconvert(), "rows"_a.noconvert(),
           "Write reports there from now on.")
      .def("set_states", &Filter::set_states, "x"_a.noconvert(), "model"_a.noconvert(), "lag"_a.noconvert(),
           "covariance"_a.noconvert(), "accepted"_a.noconvert(), "Check these states of a model from now on.")
      .def("check_states", &Filter::check_states,
           "Check the states of planar double integrators, and write the reasons.")
      .def("sense", &Filter::sense, "step"_a, "parts"_a,
           "Check the states of any model, raise alarms, write braking inputs, and return whether u* is finite.")
      .def("make_rows", &Filter::make_rows, "step"_a, "Write margins and rows of built-in barriers.")
      .def("filter", &Filter::filter, "Filter all plants, and return what is to be done.")
      .def("check", &Filter::check, "Return what is wrong with the arrays, as `filter` does.")
      .def("pose", &Filter::pose, "i"_a, "Pose the problem of one plant; return False where that is brought to rest without it.")
      .def("problem", &Filter::problem, "Return u*, a, b, h, alpha2(psi) and ranks of the posed problem.")
      .def("answer", &Filter::answer, "Return the arrays of u, slack and delta that a solver writes to.")
      .def("conditions", &Filter::conditions, "i"_a,
           "Return rank and source of each condition that was posed.")
      .def("corners", &Filter::corners, "Return the corners (V, 2) of the posed problem's U.")
      .def("close", &Filter::close, "i"_a, "answered"_a, "status"_a, "fallbacks"_a,
           "Conclude what `pose` began, and return what is to be done.");
  m.def(
      "is_covariance",
      [](const Numbers<const double, 2>& matrix) { return state_check::is_covariance(view(matrix)); },
      "matrix"_a, "Return whether a matrix is symmetric without negative eigenvalues, up to rounding.");
  m.attr("ASIDE") = axle_step::ASIDE;
  m.def("is_edge", axle_step::is_edge, "kind"_a,
        "Return whether a condition is on the place, by a unit normal.");
  m.def(
      "check_states",
      [](const Words& sensed) {
        const Records<plants::Plant> plants = records<plants::Plant>(sensed);
        Index worst = 0;
        for (Index i = 0; i < plants.size; ++i)
          worst = std::max(worst, state_check::check(plants[i], {plants.tail(i), 2}));
        return worst;
      },
      "sensed"_a.noconvert(),
      "Check the states of planar double integrators, and return the highest reason.");
  m.def(
      "face",
      [](const Words& sensed, const Numbers<const double, 2>& u_nominal, double gain, double ahead) {
        const Records<plants::Plant> plants = records<plants::Plant>(sensed);
        for (Index i = 0; i < plants.size; ++i)
          axle_step::face(plants[i], view(u_nominal)[i].data, gain, ahead);
      },
      "sensed"_a.noconvert(), "u_nominal"_a, "gain"_a, "ahead"_a,
      "Let guidance turn differential drives that face away from their path.");
}

}  // namespace hcbf
