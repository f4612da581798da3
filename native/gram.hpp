// The fast way to a triangular factor: G = Xᵀ X over a block, then R from G by Cholesky, half the arithmetic of QR.
//
// Its error is ε times the square of the condition number of the scaled columns, so the caller accepts it only where
// that number, known from R itself, is small, and otherwise runs the QR. A block alone may lack rank: a pivot within
// rounding of zero makes a zero row, which keeps Rᵀ R = G to rounding [Higham2002, section 10.3].
#pragma once

#include "tile.hpp"

namespace armid::ARMID_ISA {

// G[a .. a + P) x [b .. b + Q) += products of the tile's columns.
template <int P, int Q>
inline void gram_block(double* G, int K, double* const* columns, int a, int b, int rows) {
  V acc[P][Q] = {};
  for (int s = 0; s < rows; s += W) {
    V x[P];
    for (int i = 0; i < P; ++i) x[i] = load(columns[a + i] + s);
    for (int j = 0; j < Q; ++j) {
      const V y = load(columns[b + j] + s);
      for (int i = 0; i < P; ++i) acc[i][j] += x[i] * y;
    }
  }
  for (int i = 0; i < P; ++i) {
    double* g = G + (a + i) * K + b;
    if constexpr (Q == 4) {
      double total[4];
      sum4(acc[i][0], acc[i][1], acc[i][2], acc[i][3], total);
      for (int j = 0; j < 4; ++j) g[j] += total[j];
    } else {
      for (int j = 0; j < Q; ++j) g[j] += sum(acc[i][j]);
    }
  }
}

// Adds the upper triangle (and a little below it, within blocks of four) of the tile's products to G (K x K).
inline void gram(double* G, int K, double* const* columns, int rows) {
  constexpr int P = W == 8 ? 4 : 2;
  for (int a = 0; a < K; a += P) {
    const bool full = a + P <= K;
    for (int b = a / 4 * 4; b < K; b += 4) {
      if (full && b + 4 <= K) {
        gram_block<P, 4>(G, K, columns, a, b, rows);
        continue;
      }
      for (int i = a; i < smaller(a + P, K); ++i) {
        for (int j = b; j < smaller(b + 4, K); ++j) gram_block<1, 1>(G, K, columns, i, j, rows);
      }
    }
  }
}

// R with Rᵀ R = G, upper, in place; below the diagonal zero.
inline void semidefinite_cholesky(double* G, int K, std::ptrdiff_t samples) {
  Buffer<double> floor(K);
  const double epsilon = 2.220446049250313e-16;
  for (int c = 0; c < K; ++c) floor[c] = G[c * K + c] * epsilon * (K + std::sqrt(static_cast<double>(samples)));
  for (int c = 0; c < K; ++c) {
    double* row = G + c * K;
    for (int d = 0; d < c; ++d) row[d] = 0.0;
    if (row[c] <= floor[c]) {
      for (int d = c; d < K; ++d) row[d] = 0.0;
      continue;
    }
    const double pivot = std::sqrt(row[c]);
    row[c] = pivot;
    for (int d = c + 1; d < K; ++d) row[d] /= pivot;
    for (int e = c + 1; e < K; ++e) {
      const double r = row[e];
      double* below = G + e * K;
      for (int d = e; d < K; ++d) below[d] -= r * row[d];
    }
  }
}

// Factors of one block of samples [begin, end) for all joints by their Gram matrices.
inline void gram_factor_block(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t begin,
                              std::ptrdiff_t end, State& state, Tile& tile, double* R) {
  Buffer<double*> columns(tile.width);
  for (int c = 0; c < tile.width; ++c) columns[c] = tile.column(c);
  for (std::ptrdiff_t s = begin; s < end; s += TILE) {
    const int count = static_cast<int>(smaller(TILE, end - s));
    fill(arm, layout, in, s, count, state, tile);
    double* to = R;
    for (int j = 0; j < arm.n; ++j) {
      const int K = layout.offset[j + 1] - layout.offset[j];
      gram(to, K, columns.data() + layout.offset[j], padded(count));
      to += static_cast<std::size_t>(K) * K;
    }
  }
  for (int j = 0; j < arm.n; ++j) {
    const int K = layout.offset[j + 1] - layout.offset[j];
    semidefinite_cholesky(R, K, end - begin);
    R += static_cast<std::size_t>(K) * K;
  }
}

}  // namespace armid::ARMID_ISA
