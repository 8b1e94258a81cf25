// A step of plants of any model with the arrays of its scene, which it keeps alive.
#pragma once
#include <hcbf/model_step.hpp>

#include "bindings.hpp"

namespace hcbf {

class ModelStep : public model_step::Step {
 public:
  using model_step::Step::Step;

  void bind(Numbers<const Index, 2> kind, Numbers<const double, 3> parameters, Numbers<const Index, 2> degree,
            Numbers<const double, 2> least, Numbers<double, 3> out) {
    set_scene({{view(kind), view(parameters), view(degree)}, view(least), view(out)});
    kept_ = {std::move(kind), std::move(parameters), std::move(degree), std::move(least), std::move(out)};
  }

 private:
  std::tuple<Numbers<const Index, 2>, Numbers<const double, 3>, Numbers<const Index, 2>,
             Numbers<const double, 2>, Numbers<double, 3>>
      kept_;
};

}  // namespace hcbf
