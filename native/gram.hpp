// The fast way to a triangular factor: G = Xᵀ X over a block, then R from G by Cholesky, half the arithmetic of QR.
//
// Its error is ε times the square of the condition number of the scaled columns, so the caller accepts it only where
// that number, known from R itself, is small, and otherwise runs the QR. That holds for all blocks together; a block
// alone often lacks rank, because a second of motion is smooth. Hence the pivots: without them whatever stands beside
// a pivot of size δ is lost, and that may be as large as √δ.
#pragma once

#include "factor.hpp"

namespace armid::ARMID_ISA {

// Columns to a side of a block of products: as many sums as fit the registers.
constexpr int COLUMNS_AT_ONCE = W == 8 ? 4 : 3;

// Sums of `count` registers.
template <int count>
ARMID_INLINE void sums(const V* acc, double* total) {
  constexpr int whole = count / 4 * 4;
  for (int k = 0; k < whole; k += 4) sum4(acc[k], acc[k + 1], acc[k + 2], acc[k + 3], total + k);
  if constexpr (whole < count) {
    V rest[4] = {};
    double last[4];
    for (int k = whole; k < count; ++k) rest[k - whole] = acc[k];
    sum4(rest[0], rest[1], rest[2], rest[3], last);
    for (int k = whole; k < count; ++k) total[k] = last[k - whole];
  }
}

// G (P x Q, with K from row to row) += products of P columns x with Q columns y.
template <int P, int Q>
inline void rectangle(double* G, std::ptrdiff_t K, double* const* x, double* const* y, int from, int to) {
  V acc[P][Q] = {};
  for (int s = from; s < to; s += W) {
    V left[P];
    for (int i = 0; i < P; ++i) left[i] = load(x[i] + s);
    for (int j = 0; j < Q; ++j) {
      const V right = load(y[j] + s);
      for (int i = 0; i < P; ++i) acc[i][j] += left[i] * right;
    }
  }
  for (int i = 0; i < P; ++i) {
    double total[Q];
    sums<Q>(acc[i], total);
    for (int j = 0; j < Q; ++j) G[i * K + j] += total[j];
  }
}

// The upper triangle of G (P x P) += products of P columns with each other.
template <int P>
inline void triangle(double* G, int K, double* const* x, int rows) {
  constexpr int count = P * (P + 1) / 2;
  V acc[count] = {};
  for (int s = 0; s < rows; s += W) {
    V v[P];
    for (int i = 0; i < P; ++i) v[i] = load(x[i] + s);
    for (int i = 0, k = 0; i < P; ++i) {
      for (int j = i; j < P; ++j, ++k) acc[k] += v[i] * v[j];
    }
  }
  double total[count];
  sums<count>(acc, total);
  for (int i = 0, k = 0; i < P; ++i) {
    for (int j = i; j < P; ++j, ++k) G[i * K + j] += total[k];
  }
}

// Adds the upper triangle of the tile's products to G (K x K).
inline void gram(double* G, int K, double* const* columns, int rows) {
  constexpr int P = COLUMNS_AT_ONCE;
  int a = 0;
  for (; a + P <= K; a += P) {
    double* const* x = columns + a;
    double* g = G + a * K;
    triangle<P>(g + a, K, x, rows);
    int b = a + P;
    for (; b + 4 <= K; b += 4) rectangle<P, 4>(g + b, K, x, columns + b, 0, rows);
    if (K - b == 1) rectangle<P, 1>(g + b, K, x, columns + b, 0, rows);
    if (K - b == 2) rectangle<P, 2>(g + b, K, x, columns + b, 0, rows);
    if (K - b == 3) rectangle<P, 3>(g + b, K, x, columns + b, 0, rows);
  }
  double* corner = G + a * K + a;
  if (K - a == 1) triangle<1>(corner, K, columns + a, rows);
  if (K - a == 2) triangle<2>(corner, K, columns + a, rows);
  if (K - a == 3) triangle<3>(corner, K, columns + a, rows);
}

// R with Rᵀ R = G to rounding, upper, in place of G, of which the upper triangle is read. Complete pivoting on the
// scaled matrix leaves a remainder within rounding when it stops [Higham2002, section 10.3]; reflections then bring the
// permuted factor back to triangular form.
inline void semidefinite_cholesky(double* G, int K, std::ptrdiff_t samples) {
  const double floor = 2.220446049250313e-16 * (K + std::sqrt(static_cast<double>(samples)));
  const std::ptrdiff_t stride = padded(K);
  Buffer<double> factor(K * stride), size(K), row(K);  // factor: column c of the permuted factor from c * stride on
  Buffer<double*> columns(K);
  for (int c = 0; c < K; ++c) {
    columns[c] = factor.data() + c * stride;
    size[c] = G[c * K + c];
    for (int d = 0; d < c; ++d) G[c * K + d] = G[d * K + c];
  }
  int rank = 0;
  for (; rank < K; ++rank) {
    int p = 0;
    double largest = floor;
    for (int c = 0; c < K; ++c) {
      const double left = G[c * K + c];
      if (left > largest * size[c]) {
        largest = left / size[c];
        p = c;
      }
    }
    if (largest == floor) break;
    const double root = std::sqrt(G[p * K + p]);
    for (int d = 0; d < K; ++d) {
      row[d] = G[p * K + d] / root;
      columns[d][rank] = row[d];
    }
    for (int e = 0; e < K; ++e) {
      const double r = row[e];
      if (r == 0.0) continue;
      for (int d = 0; d < K; ++d) G[e * K + d] -= r * row[d];
    }
    for (int d = 0; d < K; ++d) G[p * K + d] = G[d * K + p] = 0.0;
  }
  std::memset(G, 0, sizeof(double) * K * K);
  absorb(G, K, columns.data(), padded(rank));
}

// Factors of one block of samples [begin, end) for all joints by their Gram matrices.
inline void gram_factor_block(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t begin,
                              std::ptrdiff_t end, Tile& tile, double* R) {
  add_block(arm, layout, in, begin, end, tile, R,
            [](double* to, int K, double* const* columns, int rows) { gram(to, K, columns, rows); });
  for (int j = 0; j < arm.n; ++j) {
    const int K = layout.offset[j + 1] - layout.offset[j];
    semidefinite_cholesky(R, K, end - begin);
    R += static_cast<std::size_t>(K) * K;
  }
}

}  // namespace armid::ARMID_ISA
