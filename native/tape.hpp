// A tape: operations on numbers in a row, to be run for one sample at a time.
//
// Values stand in one array: inputs one after another, constants, then what each operation gives. Operations come in
// runs of one kind, so that choosing the kind costs next to nothing. Compiled once, for any machine: a single sample
// leaves wide registers nothing to do, and nothing here is shared with the builds of the kernel.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace armid {

struct TapeRun {
  std::int32_t operation, count;
};

struct TapeOperands {
  std::int32_t a, b;
};

class Tape {
 public:
  // Throws std::invalid_argument where an operand does not stand before what reads it.
  Tape(std::vector<std::int32_t> sizes, std::vector<double> constants, std::vector<TapeRun> runs,
       std::vector<TapeOperands> operands, std::vector<std::int32_t> results);

  static const std::vector<std::string>& operations();

  int inputs() const { return static_cast<int>(sizes_.size()); }
  std::size_t size(int input) const { return static_cast<std::size_t>(sizes_[input]); }
  std::size_t results() const { return results_.size(); }

  // Runs it; 0, or k + 1 where input k has an element that is not finite. Several threads may run one tape.
  int run(const double* const* inputs, double* out) const;

 private:
  std::vector<std::int32_t> sizes_;
  std::vector<double> constants_;
  std::vector<TapeRun> runs_;
  std::vector<TapeOperands> operands_;
  std::vector<std::int32_t> results_;  // -1 for zero
  std::size_t length_;
};

}  // namespace armid
