// Least squares in which each joint is weighted by its residual, from the products of each joint's columns.
//
// The normal equations are solved by Cholesky's method in the order of outer products, four at a time, whose inner loop
// runs along rows of memory; the right side is one more column.
#pragma once

#include "arm.hpp"
#include "lanes.hpp"

namespace armid::ARMID_ISA {

constexpr int FEW = 4;  // outer products that are subtracted from a row while it is in registers

// Solves A x = r for a positive definite A of which `U` (count, count + 1) holds the upper half, and r behind it. No
// pivot of A is below `least` but by rounding.
inline void solve_positive(double* U, int count, double least, double* x) {
  const int width = count + 1;
  for (int k = 0; k < count; k += FEW) {
    const int end = k + FEW < count ? k + FEW : count;
    for (int a = k; a < end; ++a) {
      double* __restrict own = U + a * width;
      own[a] = std::sqrt(own[a] < least ? least : own[a]);  // what is not a number stays so
      const double inverse = 1.0 / own[a];
      for (int c = a + 1; c < width; ++c) own[c] *= inverse;
      for (int i = a + 1; i < end; ++i) {
        const double factor = own[i];
        double* __restrict row = U + i * width;
        for (int c = i; c < width; ++c) row[c] -= factor * own[c];
      }
    }
    const double* __restrict o = U + k * width;  // FEW rows: where fewer are left, none is below them
    for (int i = end; i < count; ++i) {
      const double f0 = o[i], f1 = o[width + i], f2 = o[2 * width + i], f3 = o[3 * width + i];
      double* __restrict row = U + i * width;
      for (int c = i; c < width; ++c) {
        row[c] = row[c] - f0 * o[c] - f1 * o[width + c] - f2 * o[2 * width + c] - f3 * o[3 * width + c];
      }
    }
  }
  for (int k = count - 1; k >= 0; --k) {
    const double* own = U + k * width;
    double rest = own[count];
    for (int c = k + 1; c < count; ++c) rest -= own[c] * x[c];
    x[k] = rest / own[k];
  }
}

// Parameters (count,), and the RMS residual of each joint (n,).
inline void reweighted(const JointProducts& of, const Reweighting& how, double* x, double* sigma) {
  const int n = of.joints, b = of.count, width = b + 1;
  const int columns = of.offset[n];
  Buffer<double> U(static_cast<std::size_t>(b) * width), scale(b), size(n), both(columns + 1), image(columns + 1);
  const double* P = of.values;
  for (int j = 0; j < n; ++j) {
    const int k = of.offset[j + 1] - of.offset[j];
    const double power = of.sign[j] * of.sign[j] * P[(k + 1) * (k + 1) - 1] / of.rows[j];
    size[j] = power > 0.0 ? std::sqrt(power) : 1.0;
    sigma[j] = size[j];
    P += (k + 1) * (k + 1);
  }
  for (int pass = 0; pass < how.passes; ++pass) {
    std::memset(U.data(), 0, sizeof(double) * b * width);
    P = of.values;
    for (int j = 0; j < n; ++j) {
      const int k = of.offset[j + 1] - of.offset[j];
      const std::int32_t* to = of.parameter + of.offset[j];
      const double weight = 1.0 / (sigma[j] * sigma[j]), torque = weight * of.sign[j];
      for (int r = 0; r < k; ++r, P += k + 1) {
        double* row = U.data() + to[r] * width;
        for (int c = r; c < k; ++c) row[to[c]] += weight * P[c];
        row[b] += torque * P[k];
      }
      P += k + 1;
    }
    for (int i = 0; i < b; ++i) {
      const double square = U[i * width + i];
      scale[i] =
          1.0 / std::sqrt(square > std::numeric_limits<double>::min() ? square : std::numeric_limits<double>::min());
    }
    for (int i = 0; i < b; ++i) {
      double* row = U.data() + i * width;
      for (int c = i; c < b; ++c) row[c] *= scale[i] * scale[c];
      row[b] *= scale[i];
      row[i] += how.ridge;
    }
    solve_positive(U.data(), b, how.ridge, x);
    for (int i = 0; i < b; ++i) x[i] *= scale[i];
    bool settled = true;
    P = of.values;
    for (int j = 0; j < n; ++j) {
      const int k = of.offset[j + 1] - of.offset[j];
      for (int c = 0; c < k; ++c) both[c] = -x[of.parameter[of.offset[j] + c]];
      both[k] = of.sign[j];
      for (int c = 0; c <= k; ++c) image[c] = 0.0;
      for (int r = 0; r <= k; ++r, P += k + 1) {
        for (int c = 0; c <= k; ++c) image[c] += both[r] * P[c];
      }
      double power = 0.0;
      for (int c = 0; c <= k; ++c) power += image[c] * both[c];
      const double found = power < 0.0 ? 0.0 : std::sqrt(power / of.rows[j]), least = how.floor * size[j];
      const double now = found < least ? least : found;
      settled = settled && std::abs(now - sigma[j]) < how.settled * now;
      sigma[j] = now;
    }
    if (settled) break;
  }
}

}  // namespace armid::ARMID_ISA
