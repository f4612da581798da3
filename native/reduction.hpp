// Passes of the reduction of a recording to a lower rate: decimation of all channels, and heights of short runs of
// samples of one channel, from which isolated samples are found.
#pragma once

#include "channels.hpp"

namespace armid::ARMID_ISA {

constexpr int TOGETHER = 4;  // decimated rows that are summed at a time, so that the sums hide each other's latency

// out (rows, n): row r is the sum of taps[t] times sample r * step + t; all samples lie inside of x.
inline void decimate_channels(const Channels& x, const double* taps, int length, std::ptrdiff_t step,
                              std::ptrdiff_t rows, double* out) {
  in_groups(x.n, [&]<int G>(int from, int width) {
    const Rows<G> samples(x, from, width);
    for (std::ptrdiff_t r = 0; r < rows; r += TOGETHER) {
      const int count = static_cast<int>(smaller(TOGETHER, rows - r));
      Group<G> sum[TOGETHER] = {};
      for (int t = 0; t < length; ++t) {
        for (int k = 0; k < TOGETHER; ++k) {
          // The last rows are made several times where fewer than TOGETHER are left.
          const Group<G> row = samples.row((r + (k < count ? k : count - 1)) * step + t);
          for (int g = 0; g < G; ++g) sum[k].v[g] += taps[t] * row.v[g];
        }
      }
      for (int k = 0; k < count; ++k) put<G>(out + (r + k) * x.n + from, sum[k], width);
    }
  });
}

inline V least(V a, V b) { return choose(a < b, a, b); }
inline V most(V a, V b) { return choose(a < b, b, a); }
inline V size_of(V a) { return choose(a < 0.0, -a, a); }
inline V median3(const double* p) {
  const V a = load(p), b = load(p + 1), c = load(p + 2);
  return most(least(a, b), least(most(a, b), c));
}

constexpr int SIDE = 3;  // samples on each side of a run from which a median is computed

// Of `runs` runs of `length` samples, of which run s begins at padded[s + SIDE]: the distance of its samples from the
// interval between the medians of the SIDE samples before and behind it, zero if a sample beside it is more than half
// as far from its median; and the difference of the two medians.
inline void heights(const double* padded, std::ptrdiff_t runs, int length, double* height, double* difference) {
  const auto at = [&](const double* p, V& h, V& d) {
    const double* behind_run = p + SIDE + length;
    const V before = median3(p), behind = median3(behind_run);
    V low = load(p + SIDE), high = low;
    for (int k = 1; k < length; ++k) {
      const V next = load(p + SIDE + k);
      low = least(low, next);
      high = most(high, next);
    }
    const V far = most(low - most(before, behind), least(before, behind) - high);
    h = most(far, V{});
    const V beside = most(size_of(load(p + SIDE - 1) - before), size_of(load(behind_run) - behind));
    h = choose(beside <= 0.5 * h, h, V{});
    d = size_of(before - behind);
  };
  std::ptrdiff_t s = 0;
  for (; s + W <= runs; s += W) {
    V h, d;
    at(padded + s, h, d);
    store(height + s, h);
    store(difference + s, d);
  }
  if (s == runs) return;
  // The last runs, fewer than W, from a copy that is long enough.
  const std::ptrdiff_t rest = runs - s, needed = rest + length + 2 * SIDE - 1;
  Buffer<double> part(static_cast<std::size_t>(needed + W));
  std::memcpy(part.data(), padded + s, sizeof(double) * static_cast<std::size_t>(needed));
  V h, d;
  at(part.data(), h, d);
  for (std::ptrdiff_t k = 0; k < rest; ++k) {
    height[s + k] = h[k];
    difference[s + k] = d[k];
  }
}

}  // namespace armid::ARMID_ISA
