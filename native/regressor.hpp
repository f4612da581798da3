// Rows of the regressor: tau_j = sum over links i carried by j of S_ijᵀ (force and moment of link i).
//
// With force f = m a + B h and moment n = h x a + K I about the link's origin, where h is the first moment,
// B = S(dw) + S(w)², K = L(dw) + S(w) L(w) and L(x) I = inertia · x, the coefficient of each parameter in row j is
//     m: v·a        h: Bᵀ v + a x w        I: Kᵀ w,        S_ij = (w, v).
#pragma once

#include "recursion.hpp"

namespace armid::ARMID_ISA {

struct BodyRegressor {
  V a[3], B[9], K[18];

  explicit BodyRegressor(const Link& link) {
    const V x = link.w[0], y = link.w[1], z = link.w[2];
    const V ax = link.dw[0], ay = link.dw[1], az = link.dw[2];
    const V xx = x * x, yy = y * y, zz = z * z, xy = x * y, xz = x * z, yz = y * z;
    for (int k = 0; k < 3; ++k) a[k] = link.a[k];
    B[0] = -(yy + zz);
    B[1] = xy - az;
    B[2] = xz + ay;
    B[3] = xy + az;
    B[4] = -(xx + zz);
    B[5] = yz - ax;
    B[6] = xz - ay;
    B[7] = yz + ax;
    B[8] = -(xx + yy);
    // Columns of K for Ixx, Ixy, Iyy, Ixz, Iyz, Izz, each (x, y, z).
    K[0] = ax;
    K[1] = xz;
    K[2] = -xy;
    K[3] = ay - xz;
    K[4] = ax + yz;
    K[5] = xx - yy;
    K[6] = -yz;
    K[7] = ay;
    K[8] = xy;
    K[9] = az + xy;
    K[10] = zz - xx;
    K[11] = ax - yz;
    K[12] = yy - zz;
    K[13] = az - xy;
    K[14] = ay + xz;
    K[15] = yz;
    K[16] = -xz;
    K[17] = az;
  }
};

// Stores the wanted parameters of one pair: parameter k goes to out + wanted[k] stride, or nowhere if that is negative.
inline void pair_row(const BodyRegressor& body, const Twist& S, const std::int32_t* wanted, double* out,
                     std::ptrdiff_t stride) {
  const V w0 = S.w[0], w1 = S.w[1], w2 = S.w[2], v0 = S.v[0], v1 = S.v[1], v2 = S.v[2];
  const V *a = body.a, *B = body.B;
  if (wanted[0] >= 0) store(out + wanted[0] * stride, a[0] * v0 + a[1] * v1 + a[2] * v2);
  if (wanted[1] >= 0) store(out + wanted[1] * stride, B[0] * v0 + B[3] * v1 + B[6] * v2 + (a[1] * w2 - a[2] * w1));
  if (wanted[2] >= 0) store(out + wanted[2] * stride, B[1] * v0 + B[4] * v1 + B[7] * v2 + (a[2] * w0 - a[0] * w2));
  if (wanted[3] >= 0) store(out + wanted[3] * stride, B[2] * v0 + B[5] * v1 + B[8] * v2 + (a[0] * w1 - a[1] * w0));
#pragma GCC unroll 6
  for (int k = 0; k < 6; ++k) {
    const V* K = body.K + 3 * k;
    if (wanted[4 + k] >= 0) store(out + wanted[4 + k] * stride, K[0] * w0 + K[1] * w1 + K[2] * w2);
  }
}

// Loads W samples of joint i, repeating the last one past the end.
inline V gather(const double* x, std::ptrdiff_t sample, std::ptrdiff_t last, int n, int i) {
  V v;
  if (sample + W - 1 <= last) {
    for (int l = 0; l < W; ++l) v[l] = x[(sample + l) * n + i];
  } else {
    for (int l = 0; l < W; ++l) v[l] = x[(sample + l < last ? sample + l : last) * n + i];
  }
  return v;
}

// Makes the wanted entries of W samples. Those of pair (i, j) go to out + start(pair, j) + wanted[k] stride.
template <class Start>
inline void rows(const Arm& arm, State& state, const Samples& in, std::ptrdiff_t sample, std::ptrdiff_t last,
                 const std::int32_t* wanted, double* out, std::ptrdiff_t stride, Start&& start) {
  const int n = arm.n;
  for (int i = 0; i < n; ++i) {
    const JointConstants& joint = arm.joints[i];
    Link& link = state.links[i];
    place(joint, gather(in.q, sample, last, n, i), link);
    move(arm, joint, joint.parent < 0 ? nullptr : &state.links[joint.parent], gather(in.dq, sample, last, n, i),
         gather(in.ddq, sample, last, n, i), link);
    jacobian(arm, i, state);
    const BodyRegressor body(link);
    for (int pair = arm.first[i]; pair < arm.first[i + 1]; ++pair) {
      pair_row(body, state.S[pair], wanted + 10 * pair, out + start(pair, arm.ancestor[pair]), stride);
    }
  }
}

// Dense regressor (N, n, 10 n), row-major, zero where link i is not carried by joint j.
inline void regressor(const Arm& arm, const Samples& in, std::ptrdiff_t N, double* out) {
  const int n = arm.n;
  const std::ptrdiff_t row = 10 * n, block = n * row;
  State state(arm);
  Buffer<std::int32_t> wanted(10 * arm.first[n]);
  for (int e = 0; e < 10 * arm.first[n]; ++e) wanted[e] = e % 10;
  Buffer<double> lanes(10 * arm.first[n] * W);
  for (std::ptrdiff_t s = 0; s < N; s += W) {
    rows(arm, state, in, s, N - 1, wanted.data(), lanes.data(), W, [](int pair, int) { return 10 * pair * W; });
    const int count = static_cast<int>(N - s < W ? N - s : W);
    for (int l = 0; l < count; ++l) {
      double* sample = out + (s + l) * block;
      std::memset(sample, 0, sizeof(double) * block);
      for (int i = 0; i < n; ++i) {
        for (int pair = arm.first[i]; pair < arm.first[i + 1]; ++pair) {
          const double* from = lanes.data() + 10 * pair * W + l;
          double* to = sample + arm.ancestor[pair] * row + 10 * i;
          for (int k = 0; k < 10; ++k) to[k] = from[k * W];
        }
      }
    }
  }
}

}  // namespace armid::ARMID_ISA
