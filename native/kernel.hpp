// The kernel as a table of functions, one table an instruction set.
#pragma once

#include "arm.hpp"
#include "signals.hpp"

namespace armid {

struct Kernel {
  const char* name;
  int lanes;
  void (*regressor)(const Arm&, const Samples&, std::ptrdiff_t N, double* out);
  void (*columns)(const Arm&, const Layout&, const Samples&, std::ptrdiff_t N, double* out);
  void (*inverse_dynamics)(const Arm&, const double* inertial, const Samples&, std::ptrdiff_t N, double* torque);
  void (*mass_matrix)(const Arm&, const double* inertial, const double* q, std::ptrdiff_t N, double* out);
  // Blocks [from, to) of the samples between bounds[k] and bounds[k + 1]; `R` holds one K x K factor a
  // joint for each block, `size` doubles a block, zero at first.
  void (*factor)(const Arm&, const Layout&, const Samples&, const std::int64_t* bounds, int from, int to,
                 std::ptrdiff_t size, bool by_gram, double* R);
  void (*factor_columns)(const double* x, std::ptrdiff_t stride, int K, const std::int64_t* bounds, int blocks,
                         double* R);
  void (*decimate)(const Arm&, const Layout&, const Samples&, std::ptrdiff_t begin, std::ptrdiff_t end,
                   const double* taps, std::ptrdiff_t length, std::ptrdiff_t step, std::ptrdiff_t first,
                   std::ptrdiff_t rows, double* out);
  void (*play)(const double* x, std::ptrdiff_t N, std::ptrdiff_t width, const std::int32_t* column, const double* r,
               int nodes, double* out, std::int64_t* known);
  // Filtered samples [begin, end) and their derivatives; `begin` is a multiple of `piece`.
  void (*zero_phase)(const Channels&, const Filter&, std::ptrdiff_t piece, std::ptrdiff_t begin, std::ptrdiff_t end,
                     const Filtered&);
  // Samples first, first + step, … of columns (columns, samples) after the filter: out (columns, rows).
  void (*filter_columns)(const double* x, std::ptrdiff_t samples, int columns, const Filter&, std::ptrdiff_t first,
                         std::ptrdiff_t step, std::ptrdiff_t rows, double* out);
  // Speeds and third differences (n, end - begin) of samples [begin, end), one row a channel.
  void (*speeds)(const Channels&, std::ptrdiff_t half, double scale, std::ptrdiff_t begin, std::ptrdiff_t end,
                 double* out);
  void (*third_differences)(const Channels&, const double* time, std::ptrdiff_t begin, std::ptrdiff_t end, double* out,
                            double* smallest);
  // Sums (rows, n) of taps times the samples from r * step on; all samples lie inside of the channels.
  void (*decimate_channels)(const Channels&, const double* taps, int length, std::ptrdiff_t step, std::ptrdiff_t rows,
                            double* out);
  // Heights (runs,) of runs of `length` samples of one channel, and differences of the medians beside them; `padded`
  // has three samples more at both ends.
  void (*heights)(const double* padded, std::ptrdiff_t runs, int length, double* height, double* difference);
  // Gradients (N, n) of the sum of cotangents (columns, N) times columns; N at least `lanes`.
  void (*columns_adjoint)(const Arm&, const Layout&, const Samples&, const double* cotangent, std::ptrdiff_t N,
                          double* q, double* dq, double* ddq);
  // Information (count, count), zero at first, and the gradients of a function of it with derivative `slopes`: by
  // states (N, n) and by the terms' rows (terms, N). The samples' torque is null.
  void (*information)(const Arm&, const Layout&, const Samples&, std::ptrdiff_t N, const Weighing&, double* G);
  void (*information_adjoint)(const Arm&, const Layout&, const Samples&, std::ptrdiff_t N, const Weighing&,
                              const double* slopes, double* q, double* dq, double* ddq, double* terms);
  // Parameters (count,) and the RMS residual of each joint (n,).
  void (*reweighted)(const JointProducts&, const Reweighting&, double* x, double* sigma);
  // States (windows, N + 1, n), the first of each window given; the number of steps that did not settle.
  std::ptrdiff_t (*roll_out)(const Arm&, const double* inertial, const Servos&, const Commands&, std::ptrdiff_t windows,
                             std::ptrdiff_t N, double* q, double* dq);
  // Derivatives (N / every, n, count) of the positions of one window by parameters, from those of its first state.
  void (*roll_out_sensitivities)(const Arm&, const double* inertial, const Servos&, const RolloutParameters&,
                                 const Commands&, std::ptrdiff_t N, const double* q, const double* dq,
                                 const double* S_q, const double* S_dq, std::ptrdiff_t every, double* out);
};

// Linked where the build makes them; the bindings ask only for those.
extern const Kernel kernel_avx512;
extern const Kernel kernel_avx2;
extern const Kernel kernel_baseline;

}  // namespace armid
