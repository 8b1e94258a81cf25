// From u* to u: the problem of a plant, the program's answer, and the report.
#pragma once
#include <algorithm>
#include <cmath>
#include <vector>

#include <hcbf/axle_step.hpp>
#include <hcbf/cascade.hpp>
#include <hcbf/conclusion.hpp>
#include <hcbf/gatekeeper.hpp>
#include <hcbf/map_rows.hpp>
#include <hcbf/mapped.hpp>
#include <hcbf/plants.hpp>
#include <hcbf/posing.hpp>
#include <hcbf/reason.hpp>
#include <hcbf/work.hpp>

namespace hcbf::step {

using plants::Constants, plants::One, plants::Plants, program_records::Settings, work::Work;

// What a call returns: nothing to do, u* is not finite, a scene is not of these plants, a warning is due.
enum Answer : Index { DONE, NOT_FINITE, MISSHAPED, ASKS };

// Returns what is wrong with the arrays, `DONE` for nothing; nothing is written.
inline Answer check(const Constants& c, const Plants& plants) {
  for (Index i = 0; i < plants.reports.size; ++i)
    if (!program_records::are_finite({plants.reports.tail(i), plants.n_u})) return NOT_FINITE;
  return fits(plants, c.guided && c.has_way) ? DONE : MISSHAPED;
}

// What one plant's step needs besides; it is kept, and used again for the next one.
struct Room {
  Work work;
  mapped::Nearby nearby;         // the conditions of a plant on a map
  std::vector<double> own;       // their rows that were made beforehand
  std::vector<report::Row> rows;  // their report
  manoeuvres::Own laws{};         // the user's manoeuvres
};

// Returns a plant with the nearby pieces of its map, as they were found last.
inline One with_pieces(const One& p, Room& room) {
  const mapped::Scene scene = room.nearby.scene();
  const Index count = scene.kind.size, width = p.own.columns;
  return {scene.kind, scene.parameters, scene.priority, scene.own_margin,
          {room.own.data(), p.own.rows > 0 ? count : 0, width}, p.plant, p.input, p.stop,
          p.report, p.u_nominal, p.u_safe, {room.rows.data(), count + p.rows.size - p.count()}};
}

// Finds the nearby pieces of a plant's map.
inline void find_pieces(const Constants& c, const One& p, Vector<const double> atlas, Room& room) {
  axle_step::Placed at;
  if (c.drives) at = axle_step::place(c, p.plant);
  const margins::Known known = c.drives ? axle_step::known_of(p.plant, at.x, at.model, at.lag)
                                        : axle_step::known_of(p.plant, p.plant.x, p.plant.model, p.plant.lag);
  mapped::nearby(c.uncertainty, c.drives ? c.axle_rows : c.rows, c.drives ? c.axle_rows.u_max : c.radius,
                 {p.kind, p.parameters, p.priority, p.own_margin, p.kind}, atlas, known, room.nearby);
  room.rows.resize(room.nearby.kind.size() + p.rows.size - p.count());
  room.own.clear();
  if (p.own.rows == 0) return;
  for (const Index k : room.nearby.source) room.own.insert(room.own.end(), p.own[k].begin(), p.own[k].end());
}

// Filters one plant with what is nearby.
inline void filter_nearby(const Constants& c, const Settings& program, const One& p, Work& w) {
  const Settings settings = posing::pose(c, program, p, w);
  cascade::filter_range(settings, {w.u.data, 1, 2}, w.problem(w.a, w.rows[rows::B]), w.answer, w.polygons,
                        0, 1);
  if (c.drives && p.report.reason == 0) axle_step::slide(c, settings, p, w);
  conclusion::conclude(c, p, w);
}

// Returns whether the state of a plant is valid, so that its problem can be posed; else it is brought to rest.
inline bool is_posed(const Constants& c, const Settings& program, const One& p, Room& room) {
  posing::look(c, p);
  if (p.report.reason == 0) return true;
  posing::brake(c, program, p, room.work);
  if (c.gates) gatekeeper::go_on(c, program, p, room.laws, room.work);
  conclusion::conclude_brake(c, p, room.work);
  return false;
}

// Filters one plant, and returns whether a warning is due. `atlas`: where the pieces of maps are; empty
// without a map.
inline bool filter(const Constants& c, const Settings& program, const One& p, Vector<const double> atlas,
                   Room& room) {
  if (!is_posed(c, program, p, room)) return true;
  if (c.gates) {
    gatekeeper::filter(c, program, p, room.laws, room.work);
  } else if (atlas.size == 0) {
    filter_nearby(c, program, p, room.work);
  } else {
    find_pieces(c, p, atlas, room);
    const One part = with_pieces(p, room);
    filter_nearby(c, program, part, room.work);
    map_rows::tell(room.nearby.scene().source, part.rows, p.rows.part(0, p.count()));
  }
  return p.report.reason != 0;
}

// Concludes what `pose` began. `answered`: whether a solver's answer is in `w`; if not, the plant is
// brought to rest.
inline void close(const Constants& c, const Settings& settings, bool answered, const One& p, Work& w) {
  if (!answered) {
    if (!posing::stops(p.report.reason, c.brakes)) {
      p.report.reason = reason::SOLVER;
      posing::wish_to_stop(c, settings, p, w.u);
    }
    conclusion::apply(w);
  }
  conclusion::conclude(c, p, w);
}

}  // namespace hcbf::step
