// The Python module hcbf_gym._core.
#include "bindings.hpp"
#include "hash.hpp"

NB_MODULE(_core, m) {
  nanobind::set_leak_warnings(false);  // what lives until the interpreter ends is no leak
  m.attr("HASH") = HCBF_HASH;
  hcbf::bind_models(m);
  hcbf::bind_programs(m);
  hcbf::bind_barriers(m);
  hcbf::bind_layers(m);
  hcbf::bind_margins(m);
  hcbf::bind_model_step(m);
  hcbf::bind_filter(m);
  hcbf::bind_gatekeeper(m);
  hcbf::bind_layouts(m);
  hcbf::bind_monitors(m);
  hcbf::bind_guidance(m);
  hcbf::bind_maps(m);
  hcbf::bind_locomotion(m);
  hcbf::bind_estimation(m);
  hcbf::bind_robots(m);
  hcbf::bind_envs(m);
}
