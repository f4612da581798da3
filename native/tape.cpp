#include "tape.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace armid {

namespace {

enum Operation { ADD, SUB, MUL, DIV, NEG, SIN, COS, TANH, EXP, SQRT, POW, ABS, SIGN, MAX, MIN, OPERATIONS };

void require(bool ok, const char* what) {
  if (!ok) throw std::invalid_argument(what);
}

// One run of operations; `from` and `to` move on by as many.
template <class F>
inline void apply(F f, std::int32_t count, double* values, const TapeOperands*& from, double*& to) {
  for (const TapeOperands* end = from + count; from != end; ++from) *to++ = f(values[from->a], values[from->b]);
}

void step(const TapeRun& run, double* values, const TapeOperands*& from, double*& to) {
  const auto go = [&](auto f) { apply(f, run.count, values, from, to); };
  switch (run.operation) {
    case ADD: return go([](double a, double b) { return a + b; });
    case SUB: return go([](double a, double b) { return a - b; });
    case MUL: return go([](double a, double b) { return a * b; });
    case DIV: return go([](double a, double b) { return a / b; });
    case NEG: return go([](double a, double) { return -a; });
    case SIN: return go([](double a, double) { return std::sin(a); });
    case COS: return go([](double a, double) { return std::cos(a); });
    case TANH: return go([](double a, double) { return std::tanh(a); });
    case EXP: return go([](double a, double) { return std::exp(a); });
    case SQRT: return go([](double a, double) { return std::sqrt(a); });
    case POW: return go([](double a, double b) { return std::pow(a, b); });
    case ABS: return go([](double a, double) { return std::fabs(a); });
    case SIGN: return go([](double a, double) { return static_cast<double>((a > 0.0) - (a < 0.0)); });
    case MAX: return go([](double a, double b) { return a > b ? a : b; });
    case MIN: return go([](double a, double b) { return a < b ? a : b; });
  }
}

}  // namespace

const std::vector<std::string>& Tape::operations() {
  static const std::vector<std::string> names{"add", "sub",  "mul", "div", "neg",  "sin", "cos", "tanh",
                                              "exp", "sqrt", "pow", "abs", "sign", "max", "min"};
  return names;
}

Tape::Tape(std::vector<std::int32_t> sizes, std::vector<double> constants, std::vector<TapeRun> runs,
           std::vector<TapeOperands> operands, std::vector<std::int32_t> results)
    : sizes_(std::move(sizes)), constants_(std::move(constants)), runs_(std::move(runs)),
      operands_(std::move(operands)), results_(std::move(results)) {
  std::size_t known = constants_.size(), next = 0;
  for (const std::int32_t size : sizes_) {
    require(size >= 0, "an input has a length");
    known += static_cast<std::size_t>(size);
  }
  for (const TapeRun& run : runs_) {
    require(0 <= run.operation && run.operation < OPERATIONS, "an operation that there is not");
    require(run.count > 0 && next + static_cast<std::size_t>(run.count) <= operands_.size(), "runs are too long");
    for (std::int32_t k = 0; k < run.count; ++k, ++next, ++known) {
      const auto [a, b] = operands_[next];
      require(0 <= a && static_cast<std::size_t>(a) < known && 0 <= b && static_cast<std::size_t>(b) < known,
              "an operand must stand before what reads it");
    }
  }
  require(next == operands_.size(), "runs are too short");
  for (const std::int32_t r : results_) {
    require(-1 <= r && r < static_cast<std::int64_t>(known), "a result that there is not");
  }
  length_ = known;
}

int Tape::run(const double* const* inputs, double* out) const {
  thread_local std::vector<double> workspace;
  if (workspace.size() < length_) workspace.resize(length_);
  double* const values = workspace.data();
  double* to = values;
  for (std::size_t k = 0; k < sizes_.size(); ++k) {
    for (std::int32_t i = 0; i < sizes_[k]; ++i) {
      const double x = inputs[k][i];
      if (!std::isfinite(x)) return static_cast<int>(k) + 1;
      *to++ = x;
    }
  }
  to = std::copy(constants_.begin(), constants_.end(), to);
  const TapeOperands* from = operands_.data();
  for (const TapeRun& run : runs_) step(run, values, from, to);
  for (const std::int32_t r : results_) *out++ = r < 0 ? 0.0 : values[r];
  return 0;
}

}  // namespace armid
