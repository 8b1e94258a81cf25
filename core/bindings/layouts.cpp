// Where the fields of records are, so that a test compares them with NumPy's dtypes.
#include <hcbf/plants.hpp>
#include <hcbf/report.hpp>

#include <cstddef>
#include <utility>
#include <vector>

#include <nanobind/stl/vector.h>

#include "bindings.hpp"

namespace hcbf {

namespace {

using Offsets = std::vector<std::pair<const char*, std::size_t>>;
#define HCBF_FIELD(record, name) {#name, offsetof(record, name)}

// Where the fields of a record are, those of a record within it by their own names.
Offsets plant_offsets() {
  using plants::Plant;
#define FIELD(name) HCBF_FIELD(Plant, name)
#define INNER(inner, type, name) {#name, offsetof(Plant, inner) + offsetof(type, name)}
#define WATCHED(name) INNER(watched, monitor::Memory, name)
#define PLANAR(name) INNER(planar, monitor::PlanarMemory, name)
#define JUDGED(name) INNER(judged, status::Memory, name)
  return {FIELD(x),           FIELD(time),       FIELD(model),     FIELD(lag),      FIELD(covariance),
          FIELD(elapsed),     FIELD(fault),      FIELD(has_model), FIELD(heading),  FIELD(way),
          FIELD(turns),       FIELD(turn),       FIELD(reachable), FIELD(lost),     FIELD(zone),
          WATCHED(error),     WATCHED(missed),   WATCHED(exact),   WATCHED(off),    WATCHED(samples),
          WATCHED(bend),      WATCHED(in_a_row), PLANAR(drift),    PLANAR(motion),  PLANAR(body),
          FIELD(expected),    FIELD(vague),      FIELD(growth),    FIELD(believed), FIELD(headed),
          FIELD(believed_at), FIELD(follows),    FIELD(known),     JUDGED(news),    JUDGED(kept),
          JUDGED(headway),    JUDGED(unproved),  JUDGED(closing),  FIELD(alarm),    FIELD(moves),
          {"", sizeof(Plant)}};
#undef FIELD
#undef INNER
#undef WATCHED
#undef PLANAR
#undef JUDGED
}

Offsets constants_offsets() {
  using plants::Constants;
#define FIELD(name) HCBF_FIELD(Constants, name)
#define INNER(name) {#name, offsetof(Constants, uncertainty) + offsetof(Uncertainty, name)}
  return {
      FIELD(lower),   FIELD(by_level),   FIELD(lock),         FIELD(ranks),        FIELD(guided),
      FIELD(radius),  FIELD(lambda_u),   FIELD(known_offset), FIELD(corners),      FIELD(input_sets),
      FIELD(weights), FIELD(made),       INNER(distance),     INNER(per_velocity), INNER(per_lead),
      INNER(cap),     INNER(confidence), INNER(body),         INNER(speed),        INNER(speed_per_velocity),
      FIELD(rows),    FIELD(period),     FIELD(rounding),     FIELD(dip),          FIELD(sway),
      FIELD(settles), FIELD(drives),     FIELD(axle),         FIELD(axle_rows),    FIELD(jerk),
      FIELD(has_way), FIELD(through),    FIELD(brakes),       FIELD(observed),     {"", sizeof(Constants)}};
#undef FIELD
#undef INNER
}

Offsets report_offsets() {
  using report::Plant;
#define FIELD(name) HCBF_FIELD(Plant, name)
  return {FIELD(intervention), FIELD(fallbacks), FIELD(model_error), FIELD(reachable), FIELD(deadlock),
          FIELD(alpha1_scale), FIELD(status), FIELD(reason), FIELD(covered), FIELD(covered_by), FIELD(proved),
          {"", sizeof(Plant)}};
#undef FIELD
}

Offsets report_row_offsets() {
  using report::Row;
#define FIELD(name) HCBF_FIELD(Row, name)
  return {FIELD(slack), FIELD(delta),        FIELD(margin),    FIELD(h),
          FIELD(psi),   FIELD(conditioning), {"", sizeof(Row)}};
#undef FIELD
}

}  // namespace

void bind_layouts(nb::module_& m) {
  m.def("plant_offsets", plant_offsets,
        "Return name and offset of each field of a plant's record, and its size.");
  m.def("constants_offsets", constants_offsets,
        "Return name and offset of each constant, and the size of all.");
  m.def("report_offsets", report_offsets,
        "Return name and offset of each field of a plant's report, and its size.");
  m.def("report_row_offsets", report_row_offsets,
        "Return name and offset of each field of a row's report, and its size.");
}

}  // namespace hcbf
