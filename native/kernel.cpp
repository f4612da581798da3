// One translation unit, compiled once for each instruction set with ARMID_ISA and ARMID_LANES set by the build.
#include "kernel.hpp"

#include "adjoint.hpp"
#include "channels.hpp"
#include "column_filter.hpp"
#include "decimate.hpp"
#include "dynamics.hpp"
#include "factor.hpp"
#include "gram.hpp"
#include "play.hpp"
#include "reduction.hpp"
#include "reweighted.hpp"
#include "rollout.hpp"
#include "worth.hpp"

namespace armid {
namespace ARMID_ISA {

// Wanted columns (columns, N) as they stand in tiles: the regressor in the form that streams.
void columns(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t N, double* out) {
  if (N < W) {
    Tile tile(arm, layout, TILE);
    fill(arm, layout, in, 0, static_cast<int>(N), tile);
    for (int c = 0; c < tile.width; ++c) std::memcpy(out + c * N, tile.column(c), sizeof(double) * N);
    return;
  }
  Columns maker(arm, layout, N);
  // The first register stands where `out` begins, the last where it ends, the others where stores are aligned, if rows
  // of this length are: what two of them cover is made twice.
  const std::ptrdiff_t aligned = (64 - reinterpret_cast<std::uintptr_t>(out) % 64) % 64 / sizeof(double) % W;
  for (std::ptrdiff_t s = 0; s < N; s = s == 0 && aligned > 0 ? aligned : s + W) {
    const std::ptrdiff_t at = smaller(s, N - W);
    maker.make(arm, layout, in, at, N - 1, out + at);
  }
  for (int e = 0; e < layout.terms; ++e) {
    std::memcpy(out + layout.term[e] * N, in.terms + e * in.term_stride, sizeof(double) * N);
  }
}

void factor(const Arm& arm, const Layout& layout, const Samples& in, const std::int64_t* bounds, int from, int to,
            std::ptrdiff_t size, bool by_gram, double* R) {
  Tile tile(arm, layout, TILE);
  for (int b = from; b < to; ++b) {
    const auto of_block = by_gram ? gram_factor_block : factor_block;
    of_block(arm, layout, in, bounds[b], bounds[b + 1], tile, R + b * size);
  }
}

void factor_all_columns(const double* x, std::ptrdiff_t stride, int K, const std::int64_t* bounds, int blocks,
                        double* R) {
  for (int b = 0; b < blocks; ++b) {
    factor_columns(x, stride, K, bounds[b], bounds[b + 1], R + static_cast<std::size_t>(b) * K * K);
  }
}

void decimate_columns(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t begin, std::ptrdiff_t end,
                      const double* taps, std::ptrdiff_t length, std::ptrdiff_t step, std::ptrdiff_t first,
                      std::ptrdiff_t rows, double* out) {
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
    ARMID_ISA::play,
    ARMID_ISA::zero_phase,
    ARMID_ISA::filter_columns,
    ARMID_ISA::speeds,
    ARMID_ISA::third_differences,
    ARMID_ISA::decimate_channels,
    ARMID_ISA::heights,
    ARMID_ISA::columns_adjoint,
    ARMID_ISA::information,
    ARMID_ISA::information_adjoint,
    ARMID_ISA::reweighted,
    ARMID_ISA::roll_out,
    ARMID_ISA::roll_out_sensitivities,
};

}  // namespace armid
