// Inverse dynamics (Newton-Euler) and mass matrix, W samples at a time.
#pragma once

#include "regressor.hpp"

namespace armid::ARMID_ISA {

// Force f and moment m about the link's origin for its ten parameters.
inline void wrench(const double* inertial, const Link& link, V* f, V* m) {
  const double* h = inertial + 1;
  V K[18], M[9];
  inertia_columns(link, K);
  first_moment_matrix(link, M);
  for (int r = 0; r < 3; ++r) {
    const V* B = M + 3 * r;
    f[r] = inertial[0] * link.a[r] + B[0] * h[0] + B[1] * h[1] + B[2] * h[2];
    m[r] = V{};
    for (int k = 0; k < 6; ++k) m[r] += K[3 * k + r] * inertial[4 + k];
  }
  m[0] += h[1] * link.a[2] - h[2] * link.a[1];
  m[1] += h[2] * link.a[0] - h[0] * link.a[2];
  m[2] += h[0] * link.a[1] - h[1] * link.a[0];
}

// Forces and moments of all links from those each makes alone, and the torque of each joint into state.torque.
inline void collect(const Arm& arm, Twist* wrenches, State& state) {
  for (int i = arm.n - 1; i >= 0; --i) {
    const JointConstants& joint = arm.joints[i];
    const V *moment = wrenches[i].w, *force = wrenches[i].v;
    const V* along = joint.prismatic ? force : moment;
    state.torque[i] = joint.axis[0] * along[0] + joint.axis[1] * along[1] + joint.axis[2] * along[2];
    if (joint.parent < 0) continue;
    Twist& to = wrenches[joint.parent];
    by_kind(joint, [&](auto kind) { add_to_parent<kind.axis>(joint, state.links[i], moment, force, to.w, to.v); });
  }
}

// Torque (N, n) for inertial parameters (n, 10).
[[gnu::flatten]] inline void inverse_dynamics(const Arm& arm, const double* inertial, const Samples& in,
                                              std::ptrdiff_t N, double* torque) {
  const int n = arm.n;
  State state(arm);
  Buffer<Twist> wrenches(n);  // moment in w, force in v
  for (std::ptrdiff_t s = 0; s < N; s += W) {
    place_all(arm, in.q, s, N - 1, state);
    read(in.dq, s, N - 1, n, state.dq.data());
    read(in.ddq, s, N - 1, n, state.ddq.data());
    for (int i = 0; i < n; ++i) {
      move_link(arm, i, state);
      wrench(inertial + 10 * i, state.links[i], wrenches[i].v, wrenches[i].w);
    }
    collect(arm, wrenches.data(), state);
    const int count = static_cast<int>(smaller(W, N - s));
    for (int i = 0; i < n; ++i) {
      for (int l = 0; l < count; ++l) torque[(s + l) * n + i] = state.torque[i][l];
    }
  }
}

// Mass matrix (N, n, n): M_jk = sum over links i carried by both of S_ijᵀ (spatial inertia of i) S_ik.
[[gnu::flatten]] inline void mass_matrix(const Arm& arm, const double* inertial, const double* q, std::ptrdiff_t N,
                                         double* out) {
  const int n = arm.n;
  State state(arm);
  Buffer<V> M(static_cast<std::size_t>(n) * n);
  for (std::ptrdiff_t s = 0; s < N; s += W) {
    std::memset(M.data(), 0, sizeof(V) * n * n);
    place_all(arm, q, s, N - 1, state);
    for (int i = 0; i < n; ++i) {
      by_kind(arm.joints[i], [&](auto kind) { jacobian<kind.axis>(arm, i, state); });
      const double* m = inertial + 10 * i;
      const V h[3] = {splat(m[1]), splat(m[2]), splat(m[3])};
      for (int a = arm.first[i]; a < arm.first[i + 1]; ++a) {
        const Twist& S = state.S[a];
        V f[3], moment[3], wh[3], hv[3];
        cross(S.w, h, wh);
        cross(h, S.v, hv);
        for (int d = 0; d < 3; ++d) f[d] = m[0] * S.v[d] + wh[d];
        moment[0] = m[4] * S.w[0] + m[5] * S.w[1] + m[7] * S.w[2] + hv[0];
        moment[1] = m[5] * S.w[0] + m[6] * S.w[1] + m[8] * S.w[2] + hv[1];
        moment[2] = m[7] * S.w[0] + m[8] * S.w[1] + m[9] * S.w[2] + hv[2];
        for (int b = arm.first[i]; b <= a; ++b) {
          M[arm.ancestor[a] * n + arm.ancestor[b]] += dot(state.S[b].w, moment) + dot(state.S[b].v, f);
        }
      }
    }
    const int count = static_cast<int>(N - s < W ? N - s : W);
    for (int l = 0; l < count; ++l) {
      double* to = out + (s + l) * n * n;
      for (int j = 0; j < n; ++j) {
        for (int k = 0; k <= j; ++k) to[j * n + k] = to[k * n + j] = M[j * n + k][l];
      }
    }
  }
}

}  // namespace armid::ARMID_ISA
