// Streaming QR: R <- the triangular factor of [R; tile], by blocked Householder reflections.
//
// Four reflections are made at a time and applied together to the columns behind them (compact WY form
// [Schreiber1989]): each pass over a column then does eight times the arithmetic of its loads. The top part of a
// reflection is a unit vector, because R is already triangular.
#pragma once

#include "tile.hpp"

namespace armid::ARMID_ISA {

constexpr int PANEL = 4;

// Householder reflection of [pivot; column]: returns tau and replaces pivot by the new diagonal, column by the vector
// v behind a leading one. Zero columns reflect nothing.
inline double reflect(double& pivot, double* column, int rows) {
  V squares = {};
  for (int s = 0; s < rows; s += W) {
    const V x = load(column + s);
    squares += x * x;
  }
  const double below = sum(squares);
  if (below == 0.0) return 0.0;
  const double norm = std::sqrt(pivot * pivot + below);
  const double beta = pivot >= 0.0 ? -norm : norm;
  const double scale = 1.0 / (pivot - beta), tau = (beta - pivot) / beta;
  for (int s = 0; s < rows; s += W) store(column + s, load(column + s) * scale);
  pivot = beta;
  return tau;
}

inline double inner(const double* a, const double* b, int rows) {
  V total = {};
  for (int s = 0; s < rows; s += W) total += load(a + s) * load(b + s);
  return sum(total);
}

// Factors columns [p, p + m) against each other; T is the triangular factor of the block reflection I - V T Vᵀ.
inline void factor_panel(double* R, int K, double* const* columns, int p, int m, int rows, double* T) {
  for (int c = 0; c < m; ++c) {
    double* v = columns[p + c];
    const double tau = reflect(R[(p + c) * K + p + c], v, rows);
    for (int d = c + 1; d < m; ++d) {
      double* x = columns[p + d];
      const double w = tau * (R[(p + c) * K + p + d] + inner(v, x, rows));
      R[(p + c) * K + p + d] -= w;
      for (int s = 0; s < rows; s += W) store(x + s, load(x + s) - w * load(v + s));
    }
    T[PANEL * c + c] = tau;
    double z[PANEL];
    for (int i = 0; i < c; ++i) z[i] = inner(columns[p + i], v, rows);
    for (int i = 0; i < c; ++i) {
      double t = 0.0;
      for (int k = i; k < c; ++k) t += T[PANEL * i + k] * z[k];
      T[PANEL * i + c] = -tau * t;
    }
  }
}

// Applies a full panel's reflections to `D` columns from d on.
template <int D>
inline void apply_panel(double* R, int K, double* const* columns, int p, int d, int rows, const double* T) {
  const double *v0 = columns[p], *v1 = columns[p + 1], *v2 = columns[p + 2], *v3 = columns[p + 3];
  V acc[D][PANEL] = {};
  for (int s = 0; s < rows; s += W) {
    const V a = load(v0 + s), b = load(v1 + s), c = load(v2 + s), e = load(v3 + s);
    for (int t = 0; t < D; ++t) {
      const V x = load(columns[d + t] + s);
      acc[t][0] += a * x;
      acc[t][1] += b * x;
      acc[t][2] += c * x;
      acc[t][3] += e * x;
    }
  }
  double u[D][PANEL];
  for (int t = 0; t < D; ++t) {
    double w[4];
    sum4(acc[t][0], acc[t][1], acc[t][2], acc[t][3], w);
    double* r = R + p * K + d + t;
    for (int i = 0; i < PANEL; ++i) w[i] += r[i * K];
    // u = Tᵀ w
    u[t][0] = T[0] * w[0];
    u[t][1] = T[1] * w[0] + T[5] * w[1];
    u[t][2] = T[2] * w[0] + T[6] * w[1] + T[10] * w[2];
    u[t][3] = T[3] * w[0] + T[7] * w[1] + T[11] * w[2] + T[15] * w[3];
    for (int i = 0; i < PANEL; ++i) r[i * K] -= u[t][i];
  }
  for (int s = 0; s < rows; s += W) {
    const V a = load(v0 + s), b = load(v1 + s), c = load(v2 + s), e = load(v3 + s);
    for (int t = 0; t < D; ++t) {
      double* x = columns[d + t] + s;
      store(x, load(x) - (u[t][0] * a + u[t][1] * b) - (u[t][2] * c + u[t][3] * e));
    }
  }
}

// R (K x K, row-major, upper) absorbs `rows` rows (a multiple of W) held column by column, which it destroys.
inline void absorb(double* R, int K, double* const* columns, int rows) {
  constexpr int D = W == 8 ? 4 : 2;
  double T[PANEL * PANEL];
  for (int p = 0; p < K; p += PANEL) {
    const int m = static_cast<int>(smaller(PANEL, K - p));
    factor_panel(R, K, columns, p, m, rows, T);
    if (m < PANEL) break;  // nothing stands behind the last, narrower panel
    int d = p + PANEL;
    for (; d + D <= K; d += D) apply_panel<D>(R, K, columns, p, d, rows, T);
    for (; d < K; ++d) apply_panel<1>(R, K, columns, p, d, rows, T);
  }
}

// Adds the columns of one block of samples [begin, end) to a K x K matrix of each joint, a tile at a time; `R` holds
// the matrices one behind another, and `add` is called with a matrix, K, its columns and the number of their rows.
template <class Add>
inline void add_block(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t begin, std::ptrdiff_t end,
                      Tile& tile, double* R, const Add& add) {
  Buffer<double*> columns(tile.width);
  for (int c = 0; c < tile.width; ++c) columns[c] = tile.column(c);
  for (std::ptrdiff_t s = begin; s < end; s += TILE) {
    const int count = static_cast<int>(smaller(TILE, end - s));
    fill(arm, layout, in, s, count, tile);
    double* to = R;
    for (int j = 0; j < arm.n; ++j) {
      const int K = layout.offset[j + 1] - layout.offset[j];
      add(to, K, columns.data() + layout.offset[j], padded(count));
      to += static_cast<std::size_t>(K) * K;
    }
  }
}

// Factors of one block of samples [begin, end) for all joints, into R (one K x K matrix a joint, one behind another).
inline void factor_block(const Arm& arm, const Layout& layout, const Samples& in, std::ptrdiff_t begin,
                         std::ptrdiff_t end, Tile& tile, double* R) {
  add_block(arm, layout, in, begin, end, tile, R,
            [](double* to, int K, double* const* columns, int rows) { absorb(to, K, columns, rows); });
}

// Factor of rows that are already columns of numbers: x is (K, M) with the given stride between columns.
inline void factor_columns(const double* x, std::ptrdiff_t stride, int K, std::ptrdiff_t begin, std::ptrdiff_t end,
                           double* R) {
  Buffer<double> copy(static_cast<std::size_t>(K) * STRIDE);
  Buffer<double*> columns(K);
  for (int c = 0; c < K; ++c) columns[c] = copy.data() + static_cast<std::size_t>(c) * STRIDE;
  for (std::ptrdiff_t s = begin; s < end; s += TILE) {
    const int count = static_cast<int>(smaller(TILE, end - s));
    for (int c = 0; c < K; ++c) {
      std::memcpy(columns[c], x + c * stride + s, sizeof(double) * count);
      for (int r = count; r < padded(count); ++r) columns[c][r] = 0.0;
    }
    absorb(R, K, columns.data(), padded(count));
  }
}

}  // namespace armid::ARMID_ISA
