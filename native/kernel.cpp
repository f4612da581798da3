// One translation unit, compiled once for each instruction set with ARMID_ISA and ARMID_LANES set by the build.
#include "kernel.hpp"

#include "decimate.hpp"
#include "dynamics.hpp"
#include "factor.hpp"
#include "gram.hpp"

namespace armid {
namespace ARMID_ISA {

// Wanted columns (columns, N) as they stand in tiles: the regressor in the form that streams.
void columns(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t N, double* out) {
  State state(arm);
  Tile tile(arm, layout);
  for (std::ptrdiff_t s = 0; s < N; s += TILE) {
    const int count = static_cast<int>(smaller(TILE, N - s));
    fill(arm, layout, in, s, count, state, tile);
    for (int c = 0; c < tile.width; ++c) std::memcpy(out + c * N + s, tile.column(c), sizeof(double) * count);
  }
}

void factor(const Arm& arm, const Layout& layout, const Samples& in, const std::int64_t* bounds, int from, int to,
            std::ptrdiff_t size, bool by_gram, double* R) {
  State state(arm);
  Tile tile(arm, layout);
  for (int b = from; b < to; ++b) {
    const auto of_block = by_gram ? gram_factor_block : factor_block;
    of_block(arm, layout, in, bounds[b], bounds[b + 1], state, tile, R + b * size);
  }
}

void factor_all_columns(const double* x, std::ptrdiff_t stride, int K, const std::int64_t* bounds, int blocks,
                        double* R) {
  for (int b = 0; b < blocks; ++b) {
    factor_columns(x, stride, K, bounds[b], bounds[b + 1], R + static_cast<std::size_t>(b) * K * K);
  }
}

void decimate_columns(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t begin,
                      std::ptrdiff_t end, const double* taps, std::ptrdiff_t length, std::ptrdiff_t step,
                      std::ptrdiff_t first, std::ptrdiff_t rows, double* out) {
  decimate(arm, layout, in, begin, end, Decimator{taps, length, step, first, rows}, out, rows);
}

}  // namespace ARMID_ISA

#define ARMID_STRING2(x) #x
#define ARMID_STRING(x) ARMID_STRING2(x)
#define ARMID_TABLE2(isa) kernel_##isa
#define ARMID_TABLE(isa) ARMID_TABLE2(isa)

const Kernel ARMID_TABLE(ARMID_ISA) = {
    ARMID_STRING(ARMID_ISA),
    ARMID_ISA::W,
    ARMID_ISA::regressor,
    ARMID_ISA::columns,
    ARMID_ISA::inverse_dynamics,
    ARMID_ISA::mass_matrix,
    ARMID_ISA::factor,
    ARMID_ISA::factor_all_columns,
    ARMID_ISA::decimate_columns,
};

}  // namespace armid
