// Information about base parameters, G = sum over joints j of weight_j X_jᵀ X_j, and its adjoint, a tile at a time: the
// columns are made where they are used, and what they are worth is turned into gradients before it leaves the cache.
#pragma once

#include "adjoint.hpp"
#include "gram.hpp"

namespace armid::ARMID_ISA {

constexpr int BAND = 8 * W;  // samples between whose columns and their worths the adjoint goes to and fro

// Adds each joint's products to its place in the upper triangle of G (count x count).
inline void scatter(const Layout& layout, const Weighing& weighing, int n, const double* products, double* G) {
  const int b = weighing.count;
  for (int j = 0; j < n; ++j) {
    const int K = layout.offset[j + 1] - layout.offset[j] - 1;
    const std::int32_t* p = weighing.parameter + layout.offset[j];
    for (int c = 0; c < K; ++c) {
      for (int d = c; d < K; ++d) G[p[c] * b + p[d]] += weighing.weight[j] * products[c * K + d];
    }
    products += static_cast<std::size_t>(K) * K;
  }
}

inline std::size_t squares(const Layout& layout, int n) {
  std::size_t size = 0;
  for (int j = 0; j < n; ++j) {
    const std::size_t K = layout.offset[j + 1] - layout.offset[j] - 1;
    size += K * K;
  }
  return size;
}

// G (count x count), zero at first, of N samples.
inline void information(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t N,
                        const Weighing& weighing, double* G) {
  Tile tile(arm, layout, TILE);
  Buffer<double*> columns(tile.width);
  for (int c = 0; c < tile.width; ++c) columns[c] = tile.column(c);
  Buffer<double> products(squares(layout, arm.n));
  // Tiles of one size: the sums at the end of each cost as much as a dozen registers of samples.
  const std::ptrdiff_t tiles = (N + TILE - 1) / TILE, size = padded((N + tiles - 1) / larger(tiles, 1));
  for (std::ptrdiff_t s = 0; s < N; s += size) {
    const int count = static_cast<int>(smaller(size, N - s));
    fill(arm, layout, in, s, count, tile);
    double* to = products.data();
    for (int j = 0; j < arm.n; ++j) {
      const int K = layout.offset[j + 1] - layout.offset[j] - 1;
      gram(to, K, columns.data() + layout.offset[j], padded(count));
      to += static_cast<std::size_t>(K) * K;
    }
  }
  scatter(layout, weighing, arm.n, products.data(), G);
  for (int c = 0; c < weighing.count; ++c) {
    for (int d = 0; d < c; ++d) G[c * weighing.count + d] = G[d * weighing.count + c];
  }
}

// Rows [r, r + P) of M x for Q registers of samples; M is K x K and symmetric, rows of x and out are `stride` apart.
template <int P, int Q>
inline void product(const double* M, int K, int r, const double* x, double* out, std::ptrdiff_t stride) {
  V acc[P][Q] = {};
  for (int c = 0; c < K; ++c) {
    V v[Q];
    for (int q = 0; q < Q; ++q) v[q] = load(x + c * stride + q * W);
    for (int i = 0; i < P; ++i) {
      const double m = M[c * K + r + i];
      for (int q = 0; q < Q; ++q) acc[i][q] += m * v[q];
    }
  }
  for (int i = 0; i < P; ++i) {
    for (int q = 0; q < Q; ++q) store(out + (r + i) * stride + q * W, acc[i][q]);
  }
}

template <int Q>
inline void products(const double* M, int K, const double* x, double* out, std::ptrdiff_t stride) {
  int r = 0;
  for (; r + 4 <= K; r += 4) product<4, Q>(M, K, r, x, out, stride);
  for (; r < K; ++r) product<1, Q>(M, K, r, x, out, stride);
}

// Derivatives of a function of G, by the columns: M_j = 2 weight_j (the joint's part of `slopes`), one behind another.
inline void gather(const Layout& layout, const Weighing& weighing, int n, const double* slopes, double* M) {
  for (int j = 0; j < n; ++j) {
    const int K = layout.offset[j + 1] - layout.offset[j] - 1;
    const std::int32_t* p = weighing.parameter + layout.offset[j];
    const double twice = 2.0 * weighing.weight[j];
    for (int c = 0; c < K; ++c) {
      for (int d = 0; d < K; ++d) *M++ = twice * slopes[p[c] * weighing.count + p[d]];
    }
  }
}

// Gradients of a function of G with symmetric derivative `slopes` (count x count): by positions, velocities and
// accelerations (N, n), and by the rows of the terms (terms, N).
inline void information_adjoint(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t N,
                                const Weighing& weighing, const double* slopes, double* q, double* dq, double* ddq,
                                double* terms) {
  constexpr int Q = W == 2 ? 2 : 4;
  Tile tile(arm, layout, BAND);
  Buffer<double> worth(static_cast<std::size_t>(tile.width) * tile.stride), M(squares(layout, arm.n));
  gather(layout, weighing, arm.n, slopes, M.data());
  Adjoint adjoint(arm, layout, tile.stride);
  for (std::ptrdiff_t s = 0; s < N; s += BAND) {
    const int count = static_cast<int>(smaller(BAND, N - s)), rows = padded(count);
    fill(arm, layout, in, s, count, tile);
    const double* own = M.data();
    for (int j = 0; j < arm.n; ++j) {
      const int K = layout.offset[j + 1] - layout.offset[j] - 1;
      const double* x = tile.column(layout.offset[j]);
      double* out = worth.data() + layout.offset[j] * tile.stride;
      int r = 0;
      for (; r + Q * W <= rows; r += Q * W) products<Q>(own, K, x + r, out + r, tile.stride);
      for (; r < rows; r += W) products<1>(own, K, x + r, out + r, tile.stride);
      own += static_cast<std::size_t>(K) * K;
    }
    for (int e = 0; e < layout.terms; ++e) {
      std::memcpy(terms + e * in.term_stride + s, worth.data() + layout.term[e] * tile.stride, sizeof(double) * count);
    }
    if (layout.target == nullptr) continue;
    for (int r = 0; r < count; r += W) {
      adjoint.sweep(in, s + r, N - 1, worth.data() + r);
      adjoint.write(s + r, static_cast<int>(smaller(W, count - r)), q, dq, ddq);
    }
  }
}

}  // namespace armid::ARMID_ISA
