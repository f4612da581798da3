// Play operators, the memory of Maxwell-slip friction: the centre of a window of half-width r that q drags along,
// z <- min(max(z, q - r), q + r).
//
// Where the window began is not known, so it is followed from both extremes; from where the two agree, whatever was
// before is forgotten. They agree to the last bit, since a window that is dragged stands at q - r or q + r exactly.
#pragma once

#include "lanes.hpp"

namespace armid::ARMID_ISA {

inline V dragged(V z, V low, V high) {
  z = choose(z < low, low, z);
  return choose(z > high, high, z);
}

// Nodes side by side in registers, so that they hide each other's latency; the last register is filled up with a node
// that follows the first coordinate and that nobody reads.
struct Nodes {
  int count, registers;
  Buffer<double> r, low, high;
  Buffer<std::int32_t> column;

  Nodes(const std::int32_t* columns, const double* widths, int nodes)
      : count(nodes), registers(padded(nodes) / W), r(padded(nodes)), low(padded(nodes)), high(padded(nodes)),
        column(padded(nodes)) {
    for (int k = 0; k < nodes; ++k) {
      r[k] = widths[k];
      column[k] = columns[k];
    }
  }

  V coordinates(const double* row, int group) {
    V v{};
    for (int l = 0; l < W; ++l) v[l] = row[column[group * W + l]];
    return v;
  }

  void begin(const double* row) {
    for (int k = 0; k < registers * W; ++k) {
      low[k] = row[column[k]] - r[k];
      high[k] = row[column[k]] + r[k];
    }
  }

  // One sample; the nodes' states, of which the last register may reach past `count`, into `states`.
  template <bool BOTH>
  void step(const double* row, double* states) {
    for (int g = 0; g < registers; ++g) {
      const V at = coordinates(row, g), width = load(r.data() + g * W);
      const V z = dragged(load(low.data() + g * W), at - width, at + width);
      store(low.data() + g * W, z);
      V state = z;
      if constexpr (BOTH) {
        const V top = dragged(load(high.data() + g * W), at - width, at + width);
        store(high.data() + g * W, top);
        state = 0.5 * (z + top);
      }
      if ((g + 1) * W <= count) {
        store(states + g * W, state);
      } else {
        for (int k = g * W; k < count; ++k) states[k] = state[k - g * W];
      }
    }
  }
};

// States (N, nodes) of nodes that follow columns of x (N, width); known[k] is the first sample at which node k is
// known. Before that, the state is the middle of the two extremes.
inline void play(const double* x, std::ptrdiff_t N, std::ptrdiff_t width, const std::int32_t* column, const double* r,
                 int count, double* out, std::int64_t* known) {
  for (int k = 0; k < count; ++k) known[k] = N;
  if (N == 0) return;
  Nodes nodes(column, r, count);
  nodes.begin(x);
  int unknown = count;
  std::ptrdiff_t s = 0;
  for (; s < N && unknown > 0; ++s) {
    nodes.step<true>(x + s * width, out + s * count);
    for (int k = 0; k < count; ++k) {
      if (known[k] < N || nodes.low[k] != nodes.high[k]) continue;
      known[k] = s;
      --unknown;
    }
  }
  for (; s < N; ++s) nodes.step<false>(x + s * width, out + s * count);
}

}  // namespace armid::ARMID_ISA
