// A tile: the wanted columns of a few hundred samples, column by column, small enough to stay in cache.
#pragma once

#include "regressor.hpp"

namespace armid::ARMID_ISA {

constexpr int TILE = 128;        // samples; one tile of a seven-joint arm takes 0.2 MB
constexpr int STRIDE = TILE + 8;  // between columns; a power of two would crowd them into a few sets of the cache

struct Tile {
  int width;  // number of columns
  Buffer<double> columns;

  Tile(const Arm& arm, const Layout& layout)
      : width(layout.offset[arm.n]), columns(static_cast<std::size_t>(layout.offset[arm.n]) * STRIDE) {}

  double* column(int c) { return columns.data() + static_cast<std::size_t>(c) * STRIDE; }
};

// Fills the tile with samples [begin, begin + count), count <= TILE. Rows up to the next multiple of W are zeroed.
inline void fill(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t begin, int count,
                 State& state, Tile& tile) {
  const int n = arm.n;
  const std::ptrdiff_t last = begin + count - 1;
  if (layout.target != nullptr) {
    for (int s = 0; s < count; s += W) {
      rows(arm, state, in, begin + s, last, layout.target, tile.column(0) + s, STRIDE,
           [&](int, int j) { return static_cast<std::ptrdiff_t>(layout.offset[j]) * STRIDE; });
    }
  }
  for (int e = 0; e < layout.terms; ++e) {
    std::memcpy(tile.column(layout.term[e]), in.terms + e * in.term_stride + begin, sizeof(double) * count);
  }
  for (int j = 0; j < n; ++j) {
    double* torque = tile.column(layout.offset[j + 1] - 1);
    for (int s = 0; s < count; ++s) torque[s] = in.torque[(begin + s) * n + j];
  }
  for (int c = 0; c < tile.width; ++c) {
    for (int s = count; s < padded(count); ++s) tile.column(c)[s] = 0.0;
  }
  if (in.mask == nullptr) return;
  for (int j = 0; j < n; ++j) {
    for (int s = 0; s < count; ++s) {
      if (in.mask[(begin + s) * n + j]) continue;
      for (int c = layout.offset[j]; c < layout.offset[j + 1]; ++c) tile.column(c)[s] = 0.0;
    }
  }
}

}  // namespace armid::ARMID_ISA
