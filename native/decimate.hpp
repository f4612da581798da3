// Linear-phase decimation of every column of the regressor while it streams by.
//
// Row r of the output is sum over s of taps[s - first - r step] · column[s]: row r is centred on sample
// first + (length - 1) / 2 + r step. Every sample meets about length / step rows, so the cost is that many
// multiplications a column and sample, and the full-rate regressor is never held.
#pragma once

#include "tile.hpp"

namespace armid::ARMID_ISA {

struct Decimator {
  const double* taps;
  std::ptrdiff_t length, step, first, rows;
};

// Adds the tile's part, samples [begin, begin + count), to out (columns, rows), row-major with the given stride.
inline void accumulate(const Decimator& filter, Tile& tile, std::ptrdiff_t begin, int count, double* out,
                       std::ptrdiff_t stride, double* window) {
  const auto lowest = begin - filter.first - filter.length + 1;
  std::ptrdiff_t r0 = lowest <= 0 ? 0 : (lowest + filter.step - 1) / filter.step;
  const auto highest = begin + count - 1 - filter.first;
  if (highest < 0) return;
  const std::ptrdiff_t r1 = smaller(filter.rows - 1, highest / filter.step);
  for (; r0 <= r1; r0 += 4) {
    const int many = static_cast<int>(smaller(4, r1 - r0 + 1));
    std::memset(window, 0, sizeof(double) * 4 * TILE);
    for (int r = 0; r < many; ++r) {
      const std::ptrdiff_t shift = begin - filter.first - (r0 + r) * filter.step;
      const int from = static_cast<int>(larger(0, -shift));
      const int to = static_cast<int>(smaller(count, filter.length - shift));
      for (int s = from; s < to; ++s) window[r * TILE + s] = filter.taps[s + shift];
    }
    for (int c = 0; c < tile.width; ++c) {
      const double* x = tile.column(c);
      V acc[4] = {};
      for (int s = 0; s < padded(count); s += W) {
        const V v = load(x + s);
        for (int r = 0; r < 4; ++r) acc[r] += v * load(window + r * TILE + s);
      }
      double total[4];
      sum4(acc[0], acc[1], acc[2], acc[3], total);
      for (int r = 0; r < many; ++r) out[c * stride + r0 + r] += total[r];
    }
  }
}

// Columns of samples [begin, end), decimated, added to out (columns, rows).
inline void decimate(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t begin, std::ptrdiff_t end,
                     const Decimator& filter, double* out, std::ptrdiff_t stride) {
  State state(arm);
  Tile tile(arm, layout);
  Buffer<double> window(4 * TILE);
  for (std::ptrdiff_t s = begin; s < end; s += TILE) {
    const int count = static_cast<int>(smaller(TILE, end - s));
    fill(arm, layout, in, s, count, state, tile);
    accumulate(filter, tile, s, count, out, stride, window.data());
  }
}

}  // namespace armid::ARMID_ISA
