// Inverse dynamics (Newton-Euler) and mass matrix, W samples at a time.
#pragma once

#include "regressor.hpp"

namespace armid::ARMID_ISA {

// force f and moment n about the link's origin for the ten parameters of a link.
inline void wrench(const double* m, const Link& link, V* f, V* n) {
  const BodyRegressor body(link);
  const double* h = m + 1;
  for (int r = 0; r < 3; ++r) {
    f[r] = m[0] * body.a[r] + body.B[3 * r] * h[0] + body.B[3 * r + 1] * h[1] + body.B[3 * r + 2] * h[2];
    n[r] = V{};
    for (int k = 0; k < 6; ++k) n[r] += body.K[3 * k + r] * m[4 + k];
  }
  n[0] += h[1] * body.a[2] - h[2] * body.a[1];
  n[1] += h[2] * body.a[0] - h[0] * body.a[2];
  n[2] += h[0] * body.a[1] - h[1] * body.a[0];
}

// Torque (N, n) for inertial parameters (n, 10).
inline void inverse_dynamics(const Arm& arm, const double* inertial, const Samples& in, std::ptrdiff_t N,
                             double* torque) {
  const int n = arm.n;
  State state(arm);
  Buffer<Twist> wrenches(n);  // moment in w, force in v
  for (std::ptrdiff_t s = 0; s < N; s += W) {
    for (int i = 0; i < n; ++i) {
      const JointConstants& joint = arm.joints[i];
      Link& link = state.links[i];
      place(joint, gather(in.q, s, N - 1, n, i), link);
      move(arm, joint, joint.parent < 0 ? nullptr : &state.links[joint.parent], gather(in.dq, s, N - 1, n, i),
           gather(in.ddq, s, N - 1, n, i), link);
      wrench(inertial + 10 * i, link, wrenches[i].v, wrenches[i].w);
    }
    const int count = static_cast<int>(N - s < W ? N - s : W);
    for (int i = n - 1; i >= 0; --i) {
      const JointConstants& joint = arm.joints[i];
      const V* along = joint.prismatic ? wrenches[i].v : wrenches[i].w;
      const V tau = joint.axis[0] * along[0] + joint.axis[1] * along[1] + joint.axis[2] * along[2];
      for (int l = 0; l < count; ++l) torque[(s + l) * n + i] = tau[l];
      if (joint.parent < 0) continue;
      const Link& link = state.links[i];
      V f[3], m[3], lever[3];
      to_parent(link.R, wrenches[i].v, f);
      to_parent(link.R, wrenches[i].w, m);
      cross(link.p, f, lever);
      for (int d = 0; d < 3; ++d) {
        wrenches[joint.parent].v[d] += f[d];
        wrenches[joint.parent].w[d] += m[d] + lever[d];
      }
    }
  }
}

// Mass matrix (N, n, n): M_jk = sum over links i carried by both of S_ijᵀ (spatial inertia of i) S_ik.
inline void mass_matrix(const Arm& arm, const double* inertial, const double* q, std::ptrdiff_t N, double* out) {
  const int n = arm.n;
  State state(arm);
  Buffer<V> M(static_cast<std::size_t>(n) * n);
  for (std::ptrdiff_t s = 0; s < N; s += W) {
    std::memset(M.data(), 0, sizeof(V) * n * n);
    for (int i = 0; i < n; ++i) {
      place(arm.joints[i], gather(q, s, N - 1, n, i), state.links[i]);
      jacobian(arm, i, state);
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
