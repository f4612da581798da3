// Rows of the regressor: tau_j = sum over links i carried by j of S_ijᵀ (force and moment of link i).
//
// With force f = m a + B h and moment n = h x a + K I about the link's origin, where h is the first moment,
// B = S(dw) + S(w)², K = L(dw) + S(w) L(w) and L(x) I = inertia · x, the coefficient of each parameter in row j is
//     m: v·a        h: Bᵀ v + a x w        I: Kᵀ w,        S_ij = (w, v).
#pragma once

#include "recursion.hpp"

namespace armid::ARMID_ISA {

// Columns of K for Ixx, Ixy, Iyy, Ixz, Iyz, Izz, each (x, y, z).
ARMID_INLINE void inertia_columns(const Link& link, V* K) {
  const V x = link.w[0], y = link.w[1], z = link.w[2];
  const V ax = link.dw[0], ay = link.dw[1], az = link.dw[2];
  const V xy = x * y, xz = x * z, yz = y * z;
  K[0] = ax;
  K[1] = xz;
  K[2] = -xy;
  K[3] = ay - xz;
  K[4] = ax + yz;
  K[5] = x * x - y * y;
  K[6] = -yz;
  K[7] = ay;
  K[8] = xy;
  K[9] = az + xy;
  K[10] = z * z - x * x;
  K[11] = ax - yz;
  K[12] = y * y - z * z;
  K[13] = az - xy;
  K[14] = ay + xz;
  K[15] = yz;
  K[16] = -xz;
  K[17] = az;
}

ARMID_INLINE void first_moment_matrix(const Link& link, V* B) {
  const V x = link.w[0], y = link.w[1], z = link.w[2];
  const V ax = link.dw[0], ay = link.dw[1], az = link.dw[2];
  const V xx = x * x, yy = y * y, zz = z * z, xy = x * y, xz = x * z, yz = y * z;
  B[0] = -(yy + zz);
  B[1] = xy - az;
  B[2] = xz + ay;
  B[3] = xy + az;
  B[4] = -(xx + zz);
  B[5] = yz - ax;
  B[6] = xz - ay;
  B[7] = yz + ax;
  B[8] = -(xx + yy);
}

// Entries of a link in its rows [first, last). Parameter k of a pair goes to out + to[10 pair + k], or nowhere where
// that is negative.
ARMID_INLINE void pair_rows(const Link& link, const Twist* S, int first, int last, const std::ptrdiff_t* to,
                            double* out) {
  V K[18], B[9];
  inertia_columns(link, K);
  first_moment_matrix(link, B);
  const V a[3] = {link.a[0], link.a[1], link.a[2]};
  for (int pair = first; pair < last; ++pair) {
    const std::ptrdiff_t* at = to + 10 * pair;
    const V w0 = S[pair].w[0], w1 = S[pair].w[1], w2 = S[pair].w[2];
    const V v0 = S[pair].v[0], v1 = S[pair].v[1], v2 = S[pair].v[2];
    if (at[0] >= 0) store(out + at[0], a[0] * v0 + a[1] * v1 + a[2] * v2);
    if (at[1] >= 0) store(out + at[1], B[0] * v0 + B[3] * v1 + B[6] * v2 + (a[1] * w2 - a[2] * w1));
    if (at[2] >= 0) store(out + at[2], B[1] * v0 + B[4] * v1 + B[7] * v2 + (a[2] * w0 - a[0] * w2));
    if (at[3] >= 0) store(out + at[3], B[2] * v0 + B[5] * v1 + B[8] * v2 + (a[0] * w1 - a[1] * w0));
#pragma GCC unroll 6
    for (int k = 0; k < 6; ++k) {
      if (at[4 + k] >= 0) store(out + at[4 + k], K[3 * k] * w0 + K[3 * k + 1] * w1 + K[3 * k + 2] * w2);
    }
  }
}

// Entries of a link in the row of its own joint, whose axis is coordinate axis A.
template <int A>
ARMID_INLINE void own_row(const JointConstants& joint, const Link& link, const std::ptrdiff_t* to, double* out) {
  constexpr int B = (A + 1) % 3, C = (A + 2) % 3;
  V row[10] = {};
  if (joint.prismatic) {
    V moments[9];
    first_moment_matrix(link, moments);
    row[0] = link.a[A];
    for (int k = 0; k < 3; ++k) row[1 + k] = moments[3 * A + k];
  } else {
    V K[18];
    inertia_columns(link, K);
    row[1 + B] = link.a[C];
    row[1 + C] = -link.a[B];
    for (int k = 0; k < 6; ++k) row[4 + k] = K[3 * k + A];
  }
#pragma GCC unroll 10
  for (int k = 0; k < 10; ++k) {
    if (to[k] >= 0) store(out + to[k], row[k] * joint.sense);
  }
}

// Loads W samples of all joints of x (N, n), repeating the last one past the end.
inline void read(const double* x, std::ptrdiff_t sample, std::ptrdiff_t last, int n, V* out) {
  if ((sample + W - 1) * n + padded(n) <= (last + 1) * n) {
    for (int i = 0; i < n; i += W) {
      for (int l = 0; l < W; ++l) out[i + l] = load(x + (sample + l) * n + i);
      transpose(out + i);
    }
    return;
  }
  for (int i = 0; i < n; ++i) {
    for (int l = 0; l < W; ++l) out[i][l] = x[smaller(sample + l, last) * n + i];
  }
}

// Places all links and moves them, W samples from `sample` on.
inline void place_all(const Arm& arm, const double* q, std::ptrdiff_t sample, std::ptrdiff_t last, State& state) {
  read(q, sample, last, arm.n, state.q.data());
  for (int i = 0; i < arm.n; ++i) {
    const JointConstants& joint = arm.joints[i];
    by_kind(joint, [&](auto kind) { place<kind.axis>(joint, state.q[i], state.links[i]); });
  }
}

inline void move_link(const Arm& arm, int i, State& state) {
  const JointConstants& joint = arm.joints[i];
  const Link* parent = joint.parent < 0 ? nullptr : &state.links[joint.parent];
  by_kind(joint, [&](auto kind) { move<kind.axis>(arm, joint, parent, state.dq[i], state.ddq[i], state.links[i]); });
}

// Makes the wanted entries of W samples: parameter k of a pair goes to out + to[10 pair + k], or nowhere where that is
// negative.
[[gnu::flatten]] inline void rows(const Arm& arm, State& state, const Samples& in, std::ptrdiff_t sample,
                                  std::ptrdiff_t last, const std::ptrdiff_t* to, double* out) {
  place_all(arm, in.q, sample, last, state);
  read(in.dq, sample, last, arm.n, state.dq.data());
  read(in.ddq, sample, last, arm.n, state.ddq.data());
  move_link(arm, 0, state);
  for (int i = 0; i < arm.n; ++i) {
    // Each motion waits for the one before; made one link ahead, the rows fill the time.
    if (i + 1 < arm.n) move_link(arm, i + 1, state);
    int end = arm.first[i + 1];
    by_kind(arm.joints[i], [&](auto kind) {
      jacobian<kind.axis>(arm, i, state);
      if constexpr (kind.axis != GENERAL) {
        --end;
        own_row<kind.axis>(arm.joints[i], state.links[i], to + 10 * end, out);
      }
    });
    pair_rows(state.links[i], state.S.data(), arm.first[i], end, to, out);
  }
}

// Dense regressor (N, n, 10 n), row-major, zero where link i is not carried by joint j.
class Dense {
 public:
  explicit Dense(const Arm& arm)
      : arm_(arm), to_(10 * arm.first[arm.n]), lanes_(10 * arm.first[arm.n] * W), carried_(arm.n * arm.n) {
    for (int e = 0; e < 10 * arm.first[arm.n]; ++e) to_[e] = e * W;
    for (int i = 0; i < arm.n; ++i) {
      for (int pair = arm.first[i]; pair < arm.first[i + 1]; ++pair) carried_[arm.ancestor[pair] * arm.n + i] = 1;
    }
  }

  // Samples [sample, sample + count), count <= W, into out, where the first of them stands.
  void fill(const Samples& in, State& state, std::ptrdiff_t sample, std::ptrdiff_t last, int count, double* out) {
    rows(arm_, state, in, sample, last, to_.data(), lanes_.data());
    const std::ptrdiff_t row = 10 * arm_.n, block = arm_.n * row;
    for (int i = 0; i < arm_.n; ++i) {
      for (int pair = arm_.first[i]; pair < arm_.first[i + 1]; ++pair) {
        scatter_ten(lanes_.data() + 10 * pair * W, out + arm_.ancestor[pair] * row + 10 * i, block, count);
      }
    }
    for (int e = 0; e < arm_.n * arm_.n; ++e) {
      for (int l = 0; l < count && !carried_[e]; ++l) zero_ten(out + l * block + 10 * e);
    }
  }

 private:
  const Arm& arm_;
  Buffer<std::ptrdiff_t> to_;
  Buffer<double> lanes_;
  Buffer<std::uint8_t> carried_;

  static void zero_ten(double* to) {
    for (int k = 0; k + W <= 10; k += W) store(to + k, V{});
    store(to + 10 - W, V{});
  }

  // Ten registers into ten numbers for each lane. Where ten is no multiple of W the last numbers are written twice.
  static void scatter_ten(const double* from, double* to, std::ptrdiff_t stride, int count) {
    for (int k = 0; k < 10; k += W) {
      const int begin = static_cast<int>(smaller(k, 10 - W));
      V x[W];
      for (int l = 0; l < W; ++l) x[l] = load(from + (begin + l) * W);
      transpose(x);
      for (int l = 0; l < W; ++l) {
        if (l < count) store(to + l * stride + begin, x[l]);
      }
    }
  }
};

inline void regressor(const Arm& arm, const Samples& in, std::ptrdiff_t N, double* out) {
  State state(arm);
  Dense dense(arm);
  const std::ptrdiff_t block = 10 * arm.n * arm.n;
  for (std::ptrdiff_t s = 0; s < N; s += W) {
    dense.fill(in, state, s, N - 1, static_cast<int>(smaller(W, N - s)), out + s * block);
  }
}

}  // namespace armid::ARMID_ISA
