// Zero-phase filter of regressor columns, one column a row of memory, of which only some samples are kept.
//
// Lanes are columns, as in channels.hpp, because a recursion has only one time. Columns are transposed on their way in
// and out, so that memory is read and written in the order in which it lies.
#pragma once

#include "channels.hpp"

namespace armid::ARMID_ISA {

// Columns from..from + width of x (columns, samples): all samples as groups, one after another.
template <int G>
inline void gather(const double* x, std::ptrdiff_t samples, int from, int width, Group<G>* to) {
  for (std::ptrdiff_t s = 0; s < samples; s += W) {
    const int count = static_cast<int>(smaller(W, samples - s));
    for (int g = 0; g < G; ++g) {
      V held[W] = {};
      for (int l = 0; l < W && g * W + l < width; ++l) {
        const double* own = x + (from + g * W + l) * samples + s;
        if (count == W) {
          held[l] = load(own);
        } else {
          std::memcpy(&held[l], own, sizeof(double) * count);
        }
      }
      transpose(held);
      for (int t = 0; t < count; ++t) to[s + t].v[g] = held[t];
    }
  }
}

// The samples first, first + step, … of columns (columns, samples) after the filter, `rows` of them: out (columns,
// rows). The line through the first and last sample passes unchanged; both ends are continued by odd reflection, by
// `reach` samples.
template <int G>
inline void filter_group(const double* x, std::ptrdiff_t samples, int from, int width, const Filter& filter,
                         std::ptrdiff_t first, std::ptrdiff_t step, std::ptrdiff_t rows, double* out) {
  const std::ptrdiff_t reach = filter.reach, all = samples + 2 * reach;
  Buffer<Group<G>> line(static_cast<std::size_t>(all));
  Group<G>* own = line.data() + reach;
  gather(x, samples, from, width, own);
  const Group<G> start = own[0];
  Group<G> slope;
  for (int g = 0; g < G; ++g) {
    slope.v[g] = (own[samples - 1].v[g] - start.v[g]) / static_cast<double>(samples - 1);
  }
  for (std::ptrdiff_t s = 0; s < samples; ++s) {
    for (int g = 0; g < G; ++g) own[s].v[g] -= start.v[g] + slope.v[g] * static_cast<double>(s);
  }
  for (std::ptrdiff_t k = 1; k <= reach; ++k) {
    for (int g = 0; g < G; ++g) {
      own[-k].v[g] = -own[k].v[g];
      own[samples - 1 + k].v[g] = -own[samples - 1 - k].v[g];
    }
  }
  Sections<G> forwards(filter), backwards(filter);
  forwards.settle(line[0]);
  for (std::ptrdiff_t s = 0; s < all; s += BLOCK) {
    forwards.run(line.data() + s, static_cast<int>(smaller(BLOCK, all - s)));
  }
  backwards.settle(line[all - 1]);
  Group<G> block[BLOCK];
  std::ptrdiff_t row = rows - 1;  // the last one that is not yet stored
  for (std::ptrdiff_t s = all; row >= 0; s -= BLOCK) {
    const int count = static_cast<int>(smaller(BLOCK, s));
    for (int t = 0; t < count; ++t) block[t] = line[s - 1 - t];
    backwards.run(block, count);
    const std::ptrdiff_t lowest = s - count - reach;  // sample of the last entry of the block
    for (; row >= 0 && first + row * step >= lowest; --row) {
      const std::ptrdiff_t at = first + row * step;
      for (int g = 0; g < G; ++g) {
        const V value = block[s - 1 - reach - at].v[g] + (start.v[g] + slope.v[g] * static_cast<double>(at));
        for (int l = 0; l < W && g * W + l < width; ++l) out[(from + g * W + l) * rows + row] = value[l];
      }
    }
  }
}

inline void filter_columns(const double* x, std::ptrdiff_t samples, int columns, const Filter& filter,
                           std::ptrdiff_t first, std::ptrdiff_t step, std::ptrdiff_t rows, double* out) {
  in_groups(columns, [&]<int G>(int from, int width) {
    filter_group<G>(x, samples, from, width, filter, first, step, rows, out);
  });
}

}  // namespace armid::ARMID_ISA
