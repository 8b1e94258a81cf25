// The report of a map's nearby pieces, in the rows of their classes.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/report.hpp>

namespace hcbf::map_rows {

// A class reports the most that one of its pieces pays and reserves, and the least h and psi of them;
// a class without a nearby piece pays and reserves nothing, and its h and psi are infinite. `source`:
// (M,) which condition each row of `part` (M,) is of, ascending; `rows`: (m,) written to.
inline void tell(Vector<const Index> source, Vector<const report::Row> part, Vector<report::Row> rows) {
  for (Index k = 0; k < rows.size; ++k) rows[k] = {0.0, 0.0, 0.0, INFINITY, INFINITY, 0.0};
  for (Index r = 0; r < source.size; ++r) {
    report::Row& row = rows[source[r]];
    const report::Row& piece = part[r];
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
