// Linear-phase decimation of every column of the regressor while it streams by.
//
// Row r of the output is sum over s of taps[s - first - r step] · column[s]: row r is centred on sample
// first + (length - 1) / 2 + r step. Every sample meets about length / step rows, so the cost is that many
// multiplications a column and sample, and the full-rate regressor is never held. The rows' taps stand beside the tile
// as columns, and the sums are products of columns as in gram.hpp.
#pragma once

#include "gram.hpp"

namespace armid::ARMID_ISA {

struct Decimator {
  const double* taps;
  std::ptrdiff_t length, step, first, rows;
};

// Taps of output rows r0, r0 + 1, ... as columns beside the tile's, and the samples of the tile where not all are zero.
struct Window {
  static constexpr int ROWS = 4;
  Buffer<double> taps;
  double* columns[ROWS];
  int from, to;

  Window() : taps(ROWS * STRIDE) {
    for (int r = 0; r < ROWS; ++r) columns[r] = taps.data() + r * STRIDE;
  }

  void set(const Decimator& filter, std::ptrdiff_t begin, int count, std::ptrdiff_t r0, int rows) {
    std::memset(taps.data(), 0, sizeof(double) * ROWS * STRIDE);
    from = count;
    to = 0;
    for (int r = 0; r < rows; ++r) {
      const std::ptrdiff_t shift = begin - filter.first - (r0 + r) * filter.step;
      const int a = static_cast<int>(larger(0, -shift));
      const int b = static_cast<int>(smaller(count, filter.length - shift));
      for (int s = a; s < b; ++s) columns[r][s] = filter.taps[s + shift];
      if (a < b) {
        from = static_cast<int>(smaller(from, a / W * W));
        to = static_cast<int>(larger(to, padded(b)));
      }
    }
  }
};

// Adds the tile's part, samples [begin, begin + count), to out (columns, rows), row-major with the given stride.
inline void accumulate(const Decimator& filter, Tile& tile, double* const* columns, std::ptrdiff_t begin, int count,
                       double* out, std::ptrdiff_t stride, Window& window) {
  constexpr int P = COLUMNS_AT_ONCE;
  const auto lowest = begin - filter.first - filter.length + 1;
  std::ptrdiff_t r0 = lowest <= 0 ? 0 : (lowest + filter.step - 1) / filter.step;
  const auto highest = begin + count - 1 - filter.first;
  if (highest < 0) return;
  const std::ptrdiff_t r1 = smaller(filter.rows - 1, highest / filter.step);
  for (; r0 <= r1; r0 += Window::ROWS) {
    const int many = static_cast<int>(smaller(Window::ROWS, r1 - r0 + 1));
    window.set(filter, begin, count, r0, many);
    double part[P * Window::ROWS];
    for (int c = 0; c < tile.width; c += P) {
      const int wide = static_cast<int>(smaller(P, tile.width - c));
      std::memset(part, 0, sizeof part);
      if (wide == P) {
        rectangle<P, Window::ROWS>(part, Window::ROWS, columns + c, window.columns, window.from, window.to);
      } else {
        for (int i = 0; i < wide; ++i) {
          rectangle<1, Window::ROWS>(part + i * Window::ROWS, 0, columns + c + i, window.columns, window.from,
                                     window.to);
        }
      }
      for (int i = 0; i < wide; ++i) {
        for (int r = 0; r < many; ++r) out[(c + i) * stride + r0 + r] += part[i * Window::ROWS + r];
      }
    }
  }
}

// Columns of samples [begin, end), decimated, added to out (columns, rows).
inline void decimate(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t begin, std::ptrdiff_t end,
                     const Decimator& filter, double* out, std::ptrdiff_t stride) {
  Tile tile(arm, layout, TILE);
  Window window;
  Buffer<double*> columns(tile.width);
  for (int c = 0; c < tile.width; ++c) columns[c] = tile.column(c);
  for (std::ptrdiff_t s = begin; s < end; s += TILE) {
    const int count = static_cast<int>(smaller(TILE, end - s));
    fill(arm, layout, in, s, count, tile);
    accumulate(filter, tile, columns.data(), s, count, out, stride, window);
  }
}

}  // namespace armid::ARMID_ISA
