// Models, what their rows reserve, and their step up to the rows.
#include "model_step.hpp"

namespace hcbf {

namespace {

using Line = Numbers<const double, 1>;
using Table = Numbers<const double, 2>;
using Stack = Numbers<const double, 3>;

nb::object copied(Matrix<const double> numbers) {
  return nb::cast(owned<double>(std::vector<double>(numbers.data, numbers.data + numbers.rows * numbers.columns),
                                {std::size_t(numbers.rows), std::size_t(numbers.columns)}));
}

void take(const nb::handle& answer, double* out) {
  const auto numbers = nb::cast<nb::ndarray<const double, nb::c_contig, nb::device::cpu>>(answer);
  std::copy_n(numbers.data(), numbers.size(), out);
}

// A model of Python, which answers by arrays of the right shapes.
class PythonModel final : public model::Model {
 public:
  PythonModel(Index n, Index n_u, Index n_p, nb::object asked)
      : Model(n, n_u, n_p), terms_(asked.attr("terms")), jacobians_(asked.attr("jacobians")),
        steps_(asked.attr("steps")), brakes_(asked.attr("brakes")) {}

  void terms(model::States x, Matrix<double> f, Cube<double> g) const override {
    const nb::object answer = terms_(copied(x));
    take(answer[0], f.data), take(answer[1], g.data);
  }
  void jacobians(model::States x, Cube<double> out) const override { take(jacobians_(copied(x)), out.data); }
  void steps(model::States x, model::States u, double dt, Matrix<double> after) const override {
    take(steps_(copied(x), copied(u), dt), after.data);
  }
  void brakes(model::States x, double dt, Matrix<double> u) const override {
    take(brakes_(copied(x), dt), u.data);
  }

 private:
  nb::object terms_, jacobians_, steps_, brakes_;
};

std::vector<double> numbers_of(const Line& line) { return {line.data(), line.data() + line.size()}; }

std::size_t count_of(const Table& rows, Index columns) {
  if (Index(rows.shape(1)) != columns) throw nb::value_error("got rows of another length than the model's");
  return rows.shape(0);
}

void bind_model(nb::module_& m) {
  using model::Model;
  nb::class_<Model>(m, "Model", "A model ẋ = f(x) + g(x)u of N states at once.")
      .def("terms", [](const Model& self, const Table& x) {
        const std::size_t count = count_of(x, self.n), n = self.n, n_u = self.n_u;
        std::vector<double> f(count * n), g(count * n * n_u);
        self.terms(view(x), {f.data(), Index(count), self.n}, {g.data(), Index(count), self.n, self.n_u});
        return nb::make_tuple(owned<double>(std::move(f), {count, n}), owned<double>(std::move(g), {count, n, n_u}));
      }, "x"_a, "Return f (N, n) and g (N, n, n_u) at N states.")
      .def("jacobians", [](const Model& self, const Table& x) {
        const std::size_t count = count_of(x, self.n), n = self.n;
        std::vector<double> out(count * n * n);
        self.jacobians(view(x), {out.data(), Index(count), self.n, self.n});
        return owned<double>(std::move(out), {count, n, n});
      }, "x"_a, "Return ∂f/∂x (N, n, n) at N states.")
      .def("steps", [](const Model& self, const Table& x, const Table& u, double dt) {
        const std::size_t count = std::min(count_of(x, self.n), count_of(u, self.n_u)), n = self.n;
        std::vector<double> after(count * n);
        self.steps({x.data(), Index(count), self.n}, view(u), dt, {after.data(), Index(count), self.n});
        return owned<double>(std::move(after), {count, n});
      }, "x"_a, "u"_a, "dt"_a, "Return (N, n) the states after dt [s] under constant inputs.")
      .def("brakes", [](const Model& self, const Table& x, double dt) {
        const std::size_t count = count_of(x, self.n), n_u = self.n_u;
        std::vector<double> u(count * n_u);
        self.brakes(view(x), dt, {u.data(), Index(count), self.n_u});
        return owned<double>(std::move(u), {count, n_u});
      }, "x"_a, "dt"_a, "Return (N, n_u) the inputs that stop the plants within dt [s].");
  nb::class_<model::SingleIntegrator, Model>(m, "SingleIntegrator", "ẋ = u.").def(nb::init<Index>(), "n"_a);
  nb::class_<model::DoubleIntegrator, Model>(m, "DoubleIntegrator", "p̈ = u − c ṗ.")
      .def(nb::init<Index, double>(), "n_u"_a, "drag"_a);
  nb::class_<model::Unicycle, Model>(m, "Unicycle", "A robot that drives ahead and turns.").def(nb::init<>());
  nb::class_<model::KinematicBicycle, Model>(m, "KinematicBicycle", "A car of a small slip angle.")
      .def(nb::init<double>(), "rear"_a);
  nb::class_<PythonModel, Model>(m, "PythonModel", "A model whose methods are Python's.")
      .def(nb::init<Index, Index, Index, nb::object>(), "n"_a, "n_u"_a, "n_p"_a, "asked"_a);
}

void bind_reserve(nb::module_& m) {
  using model_margins::Reserve;
  nb::class_<Reserve>(m, "Reserve", "What the rows of N plants of a model reserve.")
      .def("__init__", [](Reserve* self, const model::Model& model, const Line& settings, const Line& largest,
                          double period, Index count) {
        const auto& numbers = *reinterpret_cast<const Uncertainty*>(settings.data());
        new (self) Reserve(model, numbers, view(largest), period, count);
      }, "model"_a, "settings"_a, "largest"_a, "period"_a, "count"_a, nb::keep_alive<1, 2>())
      .def("write", [](Reserve& self, const Table& x, const Line& time, const Table& model, const Table& lag,
                       const Stack& covariance, const Line& growth, const Numbers<const Index, 2>& kind,
                       const Stack& parameters, const Table& least, const Stack& gradient, const Table& bend,
                       Index n_p, const Numbers<double, 3>& out) {
        self.know(view(x), view(model), view(lag), view(covariance));
        std::copy_n(time.data(), time.size(), self.time.data());
        std::copy_n(growth.data(), growth.size(), self.growth.data());
        self.write({view(kind), view(parameters), view(least), view(gradient), view(bend), n_p}, view(out));
      }, "x"_a, "time"_a, "model"_a, "lag"_a, "covariance"_a, "growth"_a, "kind"_a, "parameters"_a, "least"_a,
         "gradient"_a, "bend"_a, "n_p"_a, "out"_a.noconvert(),
         "Write into `MARGIN` to `FAST` of rows (N, m, WIDTH + n_u) what they reserve.");
}

void bind_step(nb::module_& m) {
  nb::class_<ModelStep>(m, "ModelStep", "The step of N plants of any model, up to their rows.")
      .def("__init__", [](ModelStep* self, const model::Model& model, const Line& uncertainty, const Table& alphas,
                          const std::tuple<Line, Line, Line>& inputs, const Line& largest,
                          const Numbers<const bool, 1>& steered, double radius, double confidence,
                          double period, Index velocity_at, Index count) {
        const auto& [low, high, corners] = inputs;
        const auto* classes = reinterpret_cast<const class_k::ClassK*>(alphas.data());
        new (self) ModelStep(model,
                        {*reinterpret_cast<const Uncertainty*>(uncertainty.data()), classes[0], classes[1], classes[2],
                         {numbers_of(low), numbers_of(high), numbers_of(corners)}, numbers_of(largest),
                         {steered.data(), steered.data() + steered.size()}, radius, confidence, period,
                         velocity_at},
                        count);
      }, "model"_a, "uncertainty"_a, "alphas"_a, "inputs"_a, "largest"_a, "steered"_a, "radius"_a, "confidence"_a,
         "period"_a, "velocity_at"_a, "count"_a, nb::keep_alive<1, 2>())
      .def("bind", &ModelStep::bind, "kind"_a.noconvert(), "parameters"_a.noconvert(), "degree"_a.noconvert(),
           "least"_a.noconvert(), "out"_a.noconvert(), "Make the rows of these scenes from now on.")
      .def("reserve", [](ModelStep& self, const Stack& gradient, const Table& bend) {
        self.reserve(view(gradient), view(bend));
      }, "gradient"_a, "bend"_a, "Write what rows reserve, those of users' own conditions too.")
      .def("terms", [](ModelStep& self) {
        const auto copies = [](double* of, Index size) { return std::vector<double>(of, of + size); };
        const Matrix<double> f = self.drifts();
        const Cube<double> g = self.inputs();
        const std::size_t count = f.rows, n = f.columns, n_u = g.columns;
        return nb::make_tuple(owned<double>(copies(f.data, count * n), {count, n}),
                              owned<double>(copies(g.data, count * n * n_u), {count, n, n_u}));
      }, "Return f (N, n) and g (N, n, n_u) at the states.")
      .def("memory", [](ModelStep& self) {
        return owned<double>(std::vector<double>(self.memory()), {self.memory().size()});
      }, "Return what the monitor remembers.")
      .def("restore", [](ModelStep& self, const Line& memory) {
        std::copy_n(memory.data(), self.memory().size(), self.memory().data());
      }, "memory"_a, "Remember what `memory` returned.");
}

}  // namespace

void bind_model_step(nb::module_& m) {
  bind_model(m);
  bind_reserve(m);
  bind_step(m);
}

}  // namespace hcbf
