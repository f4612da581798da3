// One step of the closed-loop roll-out: the scheme, its laws, and the solution of small symmetric systems.
//
// One step from (q, v) to (q + h/2 (v + y), y) solves for the velocity y at its end
//     G = ID(q + h/2 v, v, (y - v) / h) + armature (y - v) / h + laws(q + h/2 v, (v + y) / 2) - servo = 0,
//     servo = limited(stiffness (command - q - h/4 (v + y)) - damping (v + y) / 2 + torque).
// Springs and smooth laws follow the midpoint rule, which neither damps nor is unstable at any stiffness; velocity
// forces of the links are those of the step's beginning. Laws of dry friction, which have a sign, are taken at y, so
// that a joint comes to rest and stays there. A Newton iteration solves for y; its matrix is the mass matrix with a
// diagonal. The sensitivities of a step follow from the implicit function theorem.
#pragma once

#include "laws.hpp"
#include "world.hpp"

namespace armid::ARMID_ISA {

constexpr int NEWTON_PASSES = 40;
constexpr double NEWTON_SETTLED = 1e-11;  // change of a velocity, relative to 1 + its size

inline bool is_dry(const Laws& laws, int which) {
  for (int k = laws.first[which]; k < laws.first[which + 1]; ++k) {
    if (laws.operation[k] == LAW_SIGN) return true;
  }
  return false;
}

// A law between velocities v and y at the step's ends; its slope is that by y.
inline Dual law_of_step(const Laws& laws, int which, const V* q, const V* v, const V* y, double steep) {
  const bool dry = is_dry(laws, which);
  V at = {}, rate = {};
  for (int k = laws.link[which]; k < laws.link[which + 1]; ++k) {
    const int i = laws.joint[k];
    at += laws.weight[k] * q[i];
    rate += laws.weight[k] * (dry ? y[i] : 0.5 * (v[i] + y[i]));
  }
  Dual law = law_value(laws, which, at, rate, steep);
  if (!dry) law.by_dq *= 0.5;
  return law;
}

// Law torques and their derivatives by q and y, and by v where that is wanted, added to (n,) and to the diagonal blocks
// (n, n) of their coordinates. Slopes below zero are left out where `rising`, so that the matrix of an iteration stays
// positive definite.
inline void add_laws(const Laws& laws, int n, const V* q, const V* v, const V* y, double steep, bool rising, V* torque,
                     V* by_q, V* by_v, V* by_y) {
  for (int e = 0; e < laws.count; ++e) {
    const Dual law = law_of_step(laws, e, q, v, y, steep);
    const bool dry = is_dry(laws, e);
    for (int k = laws.link[e]; k < laws.link[e + 1]; ++k) {
      const int i = laws.joint[k];
      const double weight = laws.weight[k] * laws.value[e];
      torque[i] += weight * law.x;
      for (int m = laws.link[e]; m < laws.link[e + 1]; ++m) {
        const double both = weight * laws.weight[m];
        if (by_q != nullptr) by_q[i * n + laws.joint[m]] += both * law.by_q;
        V slope = both * law.by_dq;
        if (rising) slope = choose(law.by_dq * laws.value[e] < 0.0, V{}, slope);
        by_y[i * n + laws.joint[m]] += slope;
        if (by_v != nullptr && !dry) by_v[i * n + laws.joint[m]] += slope;
      }
    }
  }
}

// Calls work(Size<n>), so that loops over n unroll and their numbers stay in registers; Size<0> for larger n.
template <int N>
struct Size {
  static constexpr int size = N;
};

template <class Work>
ARMID_INLINE void by_size(int n, Work&& work) {
  switch (n) {
    case 1: return work(Size<1>{});
    case 2: return work(Size<2>{});
    case 3: return work(Size<3>{});
    case 4: return work(Size<4>{});
    case 5: return work(Size<5>{});
    case 6: return work(Size<6>{});
    case 7: return work(Size<7>{});
    default: return work(Size<0>{});
  }
}

// Replaces the lower triangle of a symmetric A = L D Lᵀ by the unit triangle L, its diagonal by the inverse of D.
template <int N, class T>
ARMID_INLINE void factor_in_place(int n, std::ptrdiff_t stride, T* A) {
  if constexpr (N > 0) n = N;
#pragma GCC unroll 8
  for (int j = 0; j < n; ++j) {
    const T inverse = 1.0 / A[j * stride + j];
    A[j * stride + j] = inverse;
#pragma GCC unroll 8
    for (int i = j + 1; i < n; ++i) {
      const T x = A[i * stride + j] * inverse;
#pragma GCC unroll 8
      for (int k = j + 1; k <= i; ++k) A[i * stride + k] -= x * A[k * stride + j];
    }
#pragma GCC unroll 8
    for (int i = j + 1; i < n; ++i) A[i * stride + j] *= inverse;
  }
}

// x <- A⁻¹ x for entries of x that stand `apart`. The newest entry comes last in each sum, so that no sum waits for
// more than that.
template <int N, class T>
ARMID_INLINE void solve_in_place(int n, std::ptrdiff_t stride, const T* L, T* x, std::ptrdiff_t apart) {
  if constexpr (N > 0) n = N;
#pragma GCC unroll 8
  for (int i = 1; i < n; ++i) {
    T sum = x[i * apart];
#pragma GCC unroll 8
    for (int k = 0; k < i; ++k) sum -= L[i * stride + k] * x[k * apart];
    x[i * apart] = sum;
  }
#pragma GCC unroll 8
  for (int i = n - 1; i >= 0; --i) {
    T sum = x[i * apart] * L[i * stride + i];
#pragma GCC unroll 8
    for (int k = n - 1; k > i; --k) sum -= L[k * stride + i] * x[k * apart];
    x[i * apart] = sum;
  }
}

template <class T>
inline void factor_small(int n, std::ptrdiff_t stride, T* A) {
  by_size(n, [&](auto of) {
    constexpr int N = of.size;
    if constexpr (N == 0) {
      factor_in_place<0>(n, stride, A);
    } else {
      T own[N * N];
#pragma GCC unroll 8
      for (int i = 0; i < N; ++i) {
#pragma GCC unroll 8
        for (int k = 0; k <= i; ++k) own[i * N + k] = A[i * stride + k];
      }
      factor_in_place<N>(N, N, own);
#pragma GCC unroll 8
      for (int i = 0; i < N; ++i) {
#pragma GCC unroll 8
        for (int k = 0; k <= i; ++k) A[i * stride + k] = own[i * N + k];
      }
    }
  });
}

// Solves for `columns` columns of x with entries `apart`, beside each other.
template <class T>
inline void solve_small(int n, std::ptrdiff_t stride, const T* L, T* x, std::ptrdiff_t apart, int columns) {
  by_size(n, [&](auto of) {
    constexpr int N = of.size;
    for (int c = 0; c < columns; ++c) {
      if constexpr (N == 0) {
        solve_in_place<0>(n, stride, L, x + c, apart);
      } else {
        T own[N];
#pragma GCC unroll 8
        for (int i = 0; i < N; ++i) own[i] = x[i * apart + c];
        solve_in_place<N>(N, stride, L, own, 1);
#pragma GCC unroll 8
        for (int i = 0; i < N; ++i) x[i * apart + c] = own[i];
      }
    }
  });
}

}  // namespace armid::ARMID_ISA
