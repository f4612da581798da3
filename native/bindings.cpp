// Python bindings: conversion of arrays, choice of the instruction set, threads over blocks. No mathematics.
#include "bindings.hpp"

#include "tape.hpp"
#include "workers.hpp"

using armid::Arm;
using armid::ArmData;
using armid::In;
using armid::Kernel;
using armid::kernel;
using armid::Layout;
using armid::layout_of;
using armid::Out;
using armid::require;
using armid::run_workers;
using armid::Samples;

namespace {

std::vector<std::string> instruction_sets() {
  std::vector<std::string> names;
  for (const Kernel* k : armid::kernels()) names.emplace_back(k->name);
  return names;
}

std::ptrdiff_t samples_of(const ArmData& data, const In<double>& q, const In<double>& dq, const In<double>& ddq) {
  require(q.size() % data.arm.n == 0 && dq.size() == q.size() && ddq.size() == q.size(),
          "q, dq and ddq must have one column a joint");
  return static_cast<std::ptrdiff_t>(q.size()) / data.arm.n;
}

Samples samples(const ArmData& data, const In<double>& q, const In<double>& dq, const In<double>& ddq,
                const In<double>& torque, const In<double>& terms, const In<std::uint8_t>& mask, int term_count) {
  const std::ptrdiff_t N = samples_of(data, q, dq, ddq);
  require(torque.size() == q.size(), "torque must have the shape of q");
  require(mask.size() == 0 || mask.size() == q.size(), "mask must have the shape of q");
  require(terms.size() == static_cast<std::size_t>(term_count) * N, "terms must have one row an entry");
  return {q.data(), dq.data(), ddq.data(), torque.data(), terms.data(), N, mask.size() ? mask.data() : nullptr};
}

void require_bounds(const In<std::int64_t>& bounds, std::ptrdiff_t N) {
  require(bounds.size() >= 2, "bounds must name at least one block");
  for (std::size_t k = 0; k < bounds.size(); ++k) {
    require((k == 0 ? 0 : bounds.data()[k - 1]) <= bounds.data()[k] && bounds.data()[k] <= N,
            "bounds must rise and stay within the samples");
  }
}

void regressor(const std::string& isa, const ArmData& data, In<double> q, In<double> dq, In<double> ddq,
               Out<double> out) {
  const std::ptrdiff_t N = samples_of(data, q, dq, ddq);
  require(out.size() == static_cast<std::size_t>(10 * N) * data.arm.n * data.arm.n, "out must be (N, n, 10 n)");
  const Samples in{q.data(), dq.data(), ddq.data(), nullptr, nullptr, 0, nullptr};
  const Kernel& k = kernel(isa);
  double* to = out.data();
  nb::gil_scoped_release release;
  k.regressor(data.arm, in, N, to);
}

void columns(const std::string& isa, const ArmData& data, In<std::int32_t> offset, In<std::int32_t> target,
             In<std::int32_t> term, In<double> q, In<double> dq, In<double> ddq, In<double> torque, In<double> terms,
             Out<double> out) {
  const Layout layout = layout_of(data, offset, target, term);
  const Samples in = samples(data, q, dq, ddq, torque, terms, {}, layout.terms);
  const std::ptrdiff_t N = samples_of(data, q, dq, ddq);
  require(out.size() == static_cast<std::size_t>(offset.data()[data.arm.n]) * N, "out must be (columns, N)");
  const Kernel& k = kernel(isa);
  double* to = out.data();
  nb::gil_scoped_release release;
  k.columns(data.arm, layout, in, N, to);
}

void inverse_dynamics(const std::string& isa, const ArmData& data, In<double> inertial, In<double> q, In<double> dq,
                      In<double> ddq, Out<double> out) {
  const std::ptrdiff_t N = samples_of(data, q, dq, ddq);
  require(inertial.size() == static_cast<std::size_t>(10 * data.arm.n), "inertial must be (n, 10)");
  require(out.size() == q.size(), "out must be (N, n)");
  const Samples in{q.data(), dq.data(), ddq.data(), nullptr, nullptr, 0, nullptr};
  const Kernel& k = kernel(isa);
  const double* m = inertial.data();
  double* to = out.data();
  nb::gil_scoped_release release;
  k.inverse_dynamics(data.arm, m, in, N, to);
}

void mass_matrix(const std::string& isa, const ArmData& data, In<double> inertial, In<double> q, Out<double> out) {
  const std::ptrdiff_t N = samples_of(data, q, q, q);
  require(inertial.size() == static_cast<std::size_t>(10 * data.arm.n), "inertial must be (n, 10)");
  require(out.size() == q.size() * data.arm.n, "out must be (N, n, n)");
  const Kernel& k = kernel(isa);
  const double *m = inertial.data(), *at = q.data();
  double* to = out.data();
  nb::gil_scoped_release release;
  k.mass_matrix(data.arm, m, at, N, to);
}

void factor(const std::string& isa, const ArmData& data, In<std::int32_t> offset, In<std::int32_t> target,
            In<std::int32_t> term, In<double> q, In<double> dq, In<double> ddq, In<double> torque, In<double> terms,
            In<std::uint8_t> mask, In<std::int64_t> bounds, bool by_gram, int threads, Out<double> out) {
  const Layout layout = layout_of(data, offset, target, term);
  const Samples in = samples(data, q, dq, ddq, torque, terms, mask, layout.terms);
  require_bounds(bounds, samples_of(data, q, dq, ddq));
  std::ptrdiff_t size = 0;
  for (int j = 0; j < data.arm.n; ++j) {
    const std::ptrdiff_t width = layout.offset[j + 1] - layout.offset[j];
    size += width * width;
  }
  const int blocks = static_cast<int>(bounds.size()) - 1;
  require(out.size() == static_cast<std::size_t>(size) * blocks, "out must hold every joint's factor for each block");
  const Kernel& k = kernel(isa);
  double* R = out.data();
  const std::int64_t* bound = bounds.data();
  nb::gil_scoped_release release;
  const int workers = std::clamp(threads, 1, blocks);
  run_workers(workers, [&](int w) {
    k.factor(data.arm, layout, in, bound, blocks * w / workers, blocks * (w + 1) / workers, size, by_gram, R);
  });
}

void factor_columns(const std::string& isa, In<double> x, In<std::int64_t> bounds, Out<double> out) {
  require(x.ndim() == 2, "x must be (columns, rows)");
  const int K = static_cast<int>(x.shape(0));
  const std::ptrdiff_t rows = static_cast<std::ptrdiff_t>(x.shape(1));
  require_bounds(bounds, rows);
  const int blocks = static_cast<int>(bounds.size()) - 1;
  require(out.size() == static_cast<std::size_t>(K) * K * blocks, "out must be (blocks, columns, columns)");
  const Kernel& k = kernel(isa);
  const double* from = x.data();
  const std::int64_t* bound = bounds.data();
  double* R = out.data();
  nb::gil_scoped_release release;
  k.factor_columns(from, rows, K, bound, blocks, R);
}

void decimate(const std::string& isa, const ArmData& data, In<std::int32_t> offset, In<std::int32_t> target,
              In<std::int32_t> term, In<double> q, In<double> dq, In<double> ddq, In<double> torque, In<double> terms,
              In<double> taps, std::int64_t step, std::int64_t first, Out<double> out) {
  const Layout layout = layout_of(data, offset, target, term);
  const Samples in = samples(data, q, dq, ddq, torque, terms, {}, layout.terms);
  const std::ptrdiff_t N = samples_of(data, q, dq, ddq);
  require(out.ndim() == 2 && static_cast<std::int64_t>(out.shape(0)) == offset.data()[data.arm.n],
          "out must be (columns, rows)");
  require(step >= 1 && taps.size() >= 1, "the decimation needs taps and a step of at least one");
  constexpr std::int64_t FAR = std::int64_t{1} << 40;
  require(step < FAR && -FAR < first && first < FAR, "the decimation steps too far");
  const Kernel& k = kernel(isa);
  const double* h = taps.data();
  const std::ptrdiff_t length = static_cast<std::ptrdiff_t>(taps.size());
  const std::ptrdiff_t rows = static_cast<std::ptrdiff_t>(out.shape(1));
  double* to = out.data();
  nb::gil_scoped_release release;
  k.decimate(data.arm, layout, in, 0, N, h, length, step, first, rows, to);
}

void play(const std::string& isa, In<double> x, In<std::int32_t> column, In<double> width, Out<double> out,
          Out<std::int64_t> known) {
  require(x.ndim() == 2, "x must be (N, coordinates)");
  const std::ptrdiff_t N = static_cast<std::ptrdiff_t>(x.shape(0)), across = static_cast<std::ptrdiff_t>(x.shape(1));
  const int nodes = static_cast<int>(column.size());
  for (int k = 0; k < nodes; ++k) {
    require(0 <= column.data()[k] && column.data()[k] < across, "a node follows a coordinate that is not there");
  }
  require(width.size() == column.size() && known.size() == column.size(), "width and known need one entry a node");
  require(out.size() == column.size() * static_cast<std::size_t>(N), "out must be (N, nodes)");
  const Kernel& k = kernel(isa);
  const double *from = x.data(), *r = width.data();
  const std::int32_t* follows = column.data();
  double* to = out.data();
  std::int64_t* since = known.data();
  nb::gil_scoped_release release;
  k.play(from, N, across, follows, r, nodes, to, since);
}

void columns_adjoint(const std::string& isa, const ArmData& data, In<std::int32_t> offset, In<std::int32_t> target,
                     In<double> q, In<double> dq, In<double> ddq, In<double> cotangent, Out<double> q_bar,
                     Out<double> dq_bar, Out<double> ddq_bar) {
  const Layout layout = layout_of(data, offset, target, {});
  const std::ptrdiff_t N = samples_of(data, q, dq, ddq);
  const Kernel& k = kernel(isa);
  require(layout.target != nullptr, "the layout has no rigid bodies");
  require(N >= k.lanes, "there must be as many samples as lanes");
  require(cotangent.size() == static_cast<std::size_t>(offset.data()[data.arm.n]) * N,
          "cotangent must be (columns, N)");
  require(q_bar.size() == q.size() && dq_bar.size() == q.size() && ddq_bar.size() == q.size(),
          "gradients must have the shape of q");
  const Samples in{q.data(), dq.data(), ddq.data(), nullptr, nullptr, 0, nullptr};
  const double* from = cotangent.data();
  double *to_q = q_bar.data(), *to_dq = dq_bar.data(), *to_ddq = ddq_bar.data();
  nb::gil_scoped_release release;
  k.columns_adjoint(data.arm, layout, in, from, N, to_q, to_dq, to_ddq);
}

// Columns without torque, and what they tell about parameters.
struct Weighed {
  Layout layout;
  Samples in;
  armid::Weighing weighing;
  std::ptrdiff_t N;

  Weighed(const ArmData& data, const In<std::int32_t>& offset, const In<std::int32_t>& target,
          const In<std::int32_t>& term, const In<std::int32_t>& parameter, const In<double>& q, const In<double>& dq,
          const In<double>& ddq, const In<double>& terms, const In<double>& weight, std::size_t size)
      : layout(layout_of(data, offset, target, term)), N(samples_of(data, q, dq, ddq)) {
    require(terms.size() == static_cast<std::size_t>(layout.terms) * N, "terms must have one row an entry");
    require(weight.size() == static_cast<std::size_t>(data.arm.n), "weight must have one entry a joint");
    const auto columns = static_cast<std::size_t>(offset.data()[data.arm.n]);
    require(parameter.size() == columns, "parameter must have one entry a column");
    const auto count = static_cast<std::size_t>(std::lround(std::sqrt(static_cast<double>(size))));
    require(count * count == size, "information must be square");
    for (std::size_t c = 0; c < columns; ++c) {
      require(0 <= parameter.data()[c] && static_cast<std::size_t>(parameter.data()[c]) < count,
              "a column stands for a parameter that is not there");
    }
    in = {q.data(), dq.data(), ddq.data(), nullptr, terms.data(), N, nullptr};
    weighing = {static_cast<int>(count), parameter.data(), weight.data()};
  }
};

void information(const std::string& isa, const ArmData& data, In<std::int32_t> offset, In<std::int32_t> target,
                 In<std::int32_t> term, In<std::int32_t> parameter, In<double> q, In<double> dq, In<double> ddq,
                 In<double> terms, In<double> weight, Out<double> out) {
  const Weighed of(data, offset, target, term, parameter, q, dq, ddq, terms, weight, out.size());
  const Kernel& k = kernel(isa);
  double* G = out.data();
  nb::gil_scoped_release release;
  k.information(data.arm, of.layout, of.in, of.N, of.weighing, G);
}

void information_adjoint(const std::string& isa, const ArmData& data, In<std::int32_t> offset, In<std::int32_t> target,
                         In<std::int32_t> term, In<std::int32_t> parameter, In<double> q, In<double> dq, In<double> ddq,
                         In<double> terms, In<double> weight, In<double> slopes, Out<double> q_bar, Out<double> dq_bar,
                         Out<double> ddq_bar, Out<double> terms_bar) {
  const Weighed of(data, offset, target, term, parameter, q, dq, ddq, terms, weight, slopes.size());
  require(q_bar.size() == q.size() && dq_bar.size() == q.size() && ddq_bar.size() == q.size(),
          "gradients must have the shape of q");
  require(terms_bar.size() == terms.size(), "the gradient by terms must have their shape");
  const Kernel& k = kernel(isa);
  const double* from = slopes.data();
  double *to_q = q_bar.data(), *to_dq = dq_bar.data(), *to_ddq = ddq_bar.data(), *to_terms = terms_bar.data();
  nb::gil_scoped_release release;
  k.information_adjoint(data.arm, of.layout, of.in, of.N, of.weighing, from, to_q, to_dq, to_ddq, to_terms);
}

void reweighted(const std::string& isa, In<std::int32_t> offset, In<std::int32_t> parameter, In<double> products,
                In<double> sign, In<double> rows, int passes, double settled, double floor, double ridge, Out<double> x,
                Out<double> sigma) {
  require(offset.size() >= 2 && offset.data()[0] == 0, "offset must begin with 0 and have n + 1 entries");
  const int n = static_cast<int>(offset.size()) - 1, count = static_cast<int>(x.size());
  std::size_t size = 0;
  for (int j = 0; j < n; ++j) {
    const std::int32_t begin = offset.data()[j], end = offset.data()[j + 1];
    require(begin <= end && static_cast<std::size_t>(end) <= parameter.size(), "offset must rise to the columns");
    for (std::int32_t c = begin; c < end; ++c) {
      require((c == begin ? -1 : parameter.data()[c - 1]) < parameter.data()[c] && parameter.data()[c] < count,
              "the parameters of a joint must rise and be there");
    }
    size += static_cast<std::size_t>(end - begin + 1) * (end - begin + 1);
  }
  require(products.size() == size, "products must be square, one a joint");
  const auto joints = static_cast<std::size_t>(n);
  require(sign.size() == joints && rows.size() == joints && sigma.size() == joints,
          "sign, rows and sigma must have one entry a joint");
  const armid::JointProducts of{n, count, offset.data(), parameter.data(), products.data(), sign.data(), rows.data()};
  const Kernel& k = kernel(isa);
  double *values = x.data(), *residual = sigma.data();
  nb::gil_scoped_release release;
  k.reweighted(of, {passes, settled, floor, ridge}, values, residual);
}

armid::Tape make_tape(In<std::int32_t> sizes, In<double> constants, In<std::int32_t> runs, In<std::int32_t> operands,
                      In<std::int32_t> results) {
  require(runs.size() % 2 == 0 && operands.size() % 2 == 0, "runs and operands come in pairs");
  std::vector<armid::TapeRun> kinds(runs.size() / 2);
  for (std::size_t k = 0; k < kinds.size(); ++k) kinds[k] = {runs.data()[2 * k], runs.data()[2 * k + 1]};
  std::vector<armid::TapeOperands> read(operands.size() / 2);
  for (std::size_t k = 0; k < read.size(); ++k) read[k] = {operands.data()[2 * k], operands.data()[2 * k + 1]};
  return {{sizes.data(), sizes.data() + sizes.size()},
          {constants.data(), constants.data() + constants.size()},
          std::move(kinds),
          std::move(read),
          {results.data(), results.data() + results.size()}};
}

// Fills `out`; 0, or what is wrong: k + 1 where input k has another length, -k - 1 where it is not finite. The lock of
// the interpreter is kept, since giving it back would cost more than the run.
template <class... Inputs>
int run_tape(const armid::Tape& tape, Out<double> out, const Inputs&... inputs) {
  const double* from[] = {inputs.data()...};
  const std::size_t sizes[] = {inputs.size()...};
  require(tape.inputs() == static_cast<int>(sizeof...(inputs)), "the tape has another number of inputs");
  require(out.size() == tape.results(), "out must have one element a result");
  for (int k = 0; k < tape.inputs(); ++k) {
    if (sizes[k] != tape.size(k)) return k + 1;
  }
  return -tape.run(from, out.data());
}

}  // namespace

NB_MODULE(_native, m) {
  using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
  nb::class_<armid::Tape>(m, "Tape")
      .def(nb::new_(&make_tape), "sizes"_a.noconvert(), "constants"_a.noconvert(), "runs"_a.noconvert(),
           "operands"_a.noconvert(), "results"_a.noconvert())
      .def_static("operations", &armid::Tape::operations)
      .def("run", &run_tape<Vector>, nb::arg().noconvert(), nb::arg().noconvert())
      .def("run", &run_tape<Vector, Vector>, nb::arg().noconvert(), nb::arg().noconvert(), nb::arg().noconvert())
      .def("run", &run_tape<Vector, Vector, Vector>, nb::arg().noconvert(), nb::arg().noconvert(),
           nb::arg().noconvert(), nb::arg().noconvert())
      .def("run", &run_tape<Vector, Vector, Vector, Vector>, nb::arg().noconvert(), nb::arg().noconvert(),
           nb::arg().noconvert(), nb::arg().noconvert(), nb::arg().noconvert())
      .def("run", &run_tape<Vector, Vector, Vector, Vector, Vector>, nb::arg().noconvert(), nb::arg().noconvert(),
           nb::arg().noconvert(), nb::arg().noconvert(), nb::arg().noconvert(), nb::arg().noconvert());
  nb::class_<ArmData>(m, "Arm").def(
      nb::init<In<std::int32_t>, In<std::uint8_t>, In<double>, In<double>, In<double>, In<double>>(),
      "parent"_a.noconvert(), "prismatic"_a.noconvert(), "axis"_a.noconvert(), "rotation"_a.noconvert(),
      "translation"_a.noconvert(), "gravity"_a.noconvert());
  m.def("instruction_sets", &instruction_sets);
  armid::bind(m, "regressor", &regressor);
  armid::bind(m, "columns", &columns);
  armid::bind(m, "inverse_dynamics", &inverse_dynamics);
  armid::bind(m, "mass_matrix", &mass_matrix);
  armid::bind(m, "factor", &factor);
  armid::bind(m, "factor_columns", &factor_columns);
  armid::bind(m, "decimate", &decimate);
  armid::bind(m, "play", &play);
  armid::bind(m, "columns_adjoint", &columns_adjoint);
  armid::bind(m, "information", &information);
  armid::bind(m, "information_adjoint", &information_adjoint);
  armid::bind(m, "reweighted", &reweighted);
  armid::bind_rollout(m);
  armid::bind_channels(m);
}
