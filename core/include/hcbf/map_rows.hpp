// A plant on a map: its nearby pieces as conditions of their own, and their report in the rows of their classes.
#pragma once
#include <algorithm>
#include <cmath>
#include <vector>

#include <hcbf/axle_step.hpp>
#include <hcbf/mapped.hpp>
#include <hcbf/plants.hpp>

namespace hcbf::map_rows {

using plants::Constants, plants::One;

// The conditions of a plant on a map; they are kept, and used again for the next one.
struct Pieces {
  mapped::Nearby nearby;
  std::vector<double> own;        // their rows that were made beforehand
  std::vector<report::Row> rows;  // their report
};

// Finds the nearby pieces of a plant's map.
inline void find(const Constants& c, const One& p, Vector<const double> atlas, Pieces& pieces) {
  axle_step::Placed at;
  if (c.drives) at = axle_step::place(c, p.plant);
  const margins::Known known = c.drives ? axle_step::known_of(p.plant, at.x, at.model, at.lag)
                                        : axle_step::known_of(p.plant, p.plant.x, p.plant.model, p.plant.lag);
  mapped::nearby(c.uncertainty, c.drives ? c.axle_rows : c.rows, c.drives ? c.axle_rows.u_max : c.radius,
                 {p.kind, p.parameters, p.priority, p.own_margin, p.kind}, atlas, known, pieces.nearby);
  pieces.rows.resize(pieces.nearby.kind.size() + p.rows.size - p.kind.size);
  pieces.own.clear();
  if (p.own.rows == 0) return;
  for (const Index k : pieces.nearby.source)
    pieces.own.insert(pieces.own.end(), p.own[k].begin(), p.own[k].end());
}

// Returns a plant with the nearby pieces of its map, as they were found last.
inline One with_pieces(const One& p, Pieces& pieces) {
  const mapped::Scene scene = pieces.nearby.scene();
  const Index count = scene.kind.size, width = p.own.columns;
  return {scene.kind, scene.parameters, scene.priority, scene.own_margin,
          {pieces.own.data(), p.own.rows > 0 ? count : 0, width}, p.plant, p.input, p.stop,
          p.report, p.u_nominal, p.u_safe, {pieces.rows.data(), count + p.rows.size - p.kind.size}};
}

// Writes the report of a plant's conditions from that of the pieces: a class reports the most that one of its
// pieces pays and reserves, and the least h and psi of them; a class without a nearby piece pays and reserves
// nothing, and its h and psi are infinite.
inline void merge(const Pieces& pieces, const One& p) {
  const std::vector<Index>& source = pieces.nearby.source;  // ascending
  for (Index k = 0; k < p.kind.size; ++k) p.rows[k] = {0.0, 0.0, 0.0, INFINITY, INFINITY, 0.0};
  for (std::size_t r = 0; r < source.size(); ++r) {
    report::Row& row = p.rows[source[r]];
    const report::Row& piece = pieces.rows[r];
    if (r == 0 || source[r] != source[r - 1]) {  // of all that is no class, the only one
      row = piece;
      continue;
    }
    row.slack = std::max(row.slack, piece.slack);
    row.delta = std::max(row.delta, piece.delta);
    row.margin = std::max(row.margin, piece.margin);
    row.h = std::min(piece.h, row.h), row.psi = std::min(piece.psi, row.psi);
    row.conditioning = std::max(row.conditioning, piece.conditioning);
  }
}

}  // namespace hcbf::map_rows
