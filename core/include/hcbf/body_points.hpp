// The robot's whole body as points with radii.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/arrays.hpp>

namespace hcbf::body_points {

struct BodyPoints {  // of a robot's geoms
  Vector<const Index> geom;     // (P,) which geom each point belongs to
  Matrix<const double> place;   // (P, 3) where it is in the geom's frame [m]
  Vector<const double> radius;  // (P,) of the ball around it [m]
};

struct Planar {
  double x, y;
};

// Where a point of a geom is in the plane of the world [m]. `rotation` (9,): row by row.
inline Planar in_plane(const double* place, const double* position, const double* rotation) {
  return {position[0] + rotation[0] * place[0] + rotation[1] * place[1] + rotation[2] * place[2],
          position[1] + rotation[3] * place[0] + rotation[4] * place[1] + rotation[5] * place[2]};
}

// The greatest horizontal distance of the body from a point (2,) [m]. `position` (ngeom, 3) and
// `rotation` (ngeom, 9): of the geoms in the world.
inline double reach(const BodyPoints& body, Matrix<const double> position, Matrix<const double> rotation,
                    const double* centre) {
  double farthest = 0.0;
  for (Index p = 0; p < body.geom.size; ++p) {
    const Index geom = body.geom[p];
    const Planar at = in_plane(body.place[p].data, position[geom].data, rotation[geom].data);
    const double dx = at.x - centre[0], dy = at.y - centre[1];
    farthest = std::max(farthest, std::sqrt(dx * dx + dy * dy) + body.radius[p]);
  }
  return farthest;
}

}  // namespace hcbf::body_points
