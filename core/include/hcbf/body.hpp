// How near the robot's whole body comes to every region: h_body = min_p h(p) − r_p ‖∇h(p)‖. As h is
// convex, it is no greater than h anywhere on the ball around p.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/body_points.hpp>
#include <hcbf/pieces.hpp>
#include <hcbf/shape_terms.hpp>

namespace hcbf::body {

// Writes the least h (m,) of each barrier over the whole body [m]; a speed limit's is infinite.
// `position` (ngeom, 3) and `rotation` (ngeom, 9): of the geoms in the world; `t`: time [s].
inline void body_h(const body_points::BodyPoints& body, Matrix<const double> position,
                   Matrix<const double> rotation, Vector<const Index> kind, Matrix<const double> parameters,
                   Vector<const double> atlas, double t, Vector<double> h) {
  std::fill_n(h.data, h.size, INFINITY);
  for (Index p = 0; p < body.geom.size; ++p) {
    const Index geom = body.geom[p];
    const double radius = body.radius[p];
    const auto [x, y] = body_points::in_plane(body.place[p].data, position[geom].data, rotation[geom].data);
    for (Index k = 0; k < kind.size; ++k) {
      const double* c = parameters[k].data;
      if (atlas.size > 0 && kind[k] == layout::MAPPED) {
        const auto found = pieces::nearest(atlas, static_cast<Index>(c[layout::PIECES]), x, y);
        h[k] = std::min(h[k], found.distance - radius);
      }
      if (!shape_terms::is_region(kind[k])) continue;
      const PlanarJet jet = shape_terms::jet(kind[k], c, x, y, t);
      h[k] = std::min(h[k], jet.h - radius * std::sqrt(jet.gx * jet.gx + jet.gy * jet.gy));
    }
  }
}

}  // namespace hcbf::body
