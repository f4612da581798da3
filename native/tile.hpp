// A tile: the wanted columns of a few hundred samples, column by column, small enough to stay in cache.
#pragma once

#include "regressor.hpp"

namespace armid::ARMID_ISA {

constexpr int TILE = 192;  // samples; one tile of a seven-joint arm takes 0.3 MB
constexpr int GAP = 8;     // behind each column; a power of two between them would crowd a few sets of the cache
constexpr int STRIDE = TILE + GAP;

// Makes columns of W samples, a stride from one to the next.
class Columns {
 public:
  Columns(const Arm& arm, const Layout& layout, std::ptrdiff_t stride)
      : state_(arm), to_(layout.target == nullptr ? 0 : 10 * arm.first[arm.n]), stride_(stride) {
    for (int e = 0; e < 10 * arm.first[arm.n] && layout.target != nullptr; ++e) {
      const int column = layout.target[e];
      to_[e] = column < 0 ? -1 : (layout.offset[arm.ancestor[e / 10]] + column) * stride;
    }
  }

  void make(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t sample, std::ptrdiff_t last,
            double* out) {
    if (layout.target != nullptr) rows(arm, state_, in, sample, last, to_.data(), out);
    if (in.torque == nullptr) return;
    read(in.torque, sample, last, arm.n, state_.torque.data());
    for (int j = 0; j < arm.n; ++j) store(out + (layout.offset[j + 1] - 1) * stride_, state_.torque[j]);
  }

 private:
  State state_;
  Buffer<std::ptrdiff_t> to_;
  std::ptrdiff_t stride_;
};

struct Tile {
  int width;  // number of columns
  std::ptrdiff_t stride;
  Buffer<double> columns;
  Columns maker;

  Tile(const Arm& arm, const Layout& layout, int samples)
      : width(layout.offset[arm.n]), stride(samples + GAP),
        columns(static_cast<std::size_t>(layout.offset[arm.n]) * stride), maker(arm, layout, stride) {}

  double* column(int c) { return columns.data() + c * stride; }
};

// Fills the tile with samples [begin, begin + count), no more than it holds. Rows up to the next multiple of W are
// zeroed.
inline void fill(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t begin, int count, Tile& tile) {
  const std::ptrdiff_t last = begin + count - 1;
  for (int s = 0; s < count; s += W) tile.maker.make(arm, layout, in, begin + s, last, tile.column(0) + s);
  for (int e = 0; e < layout.terms; ++e) {
    std::memcpy(tile.column(layout.term[e]), in.terms + e * in.term_stride + begin, sizeof(double) * count);
  }
  for (int c = 0; c < tile.width; ++c) {
    for (int s = count; s < padded(count); ++s) tile.column(c)[s] = 0.0;
  }
  if (in.mask == nullptr) return;
  for (int j = 0; j < arm.n; ++j) {
    for (int s = 0; s < count; ++s) {
      if (in.mask[(begin + s) * arm.n + j]) continue;
      for (int c = layout.offset[j]; c < layout.offset[j + 1]; ++c) tile.column(c)[s] = 0.0;
    }
  }
}

}  // namespace armid::ARMID_ISA
