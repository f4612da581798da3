// Closed-loop roll-out of an arm with servos, and its sensitivities to parameters.
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
#include "tile.hpp"
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

// Replaces the lower triangle of a positive definite A (n, n) by its Cholesky factor, its diagonal by the inverse.
template <class T>
inline void factor_small(int n, T* A) {
  for (int j = 0; j < n; ++j) {
    for (int k = 0; k < j; ++k) {
      const T x = A[j * n + k];
      for (int i = j; i < n; ++i) A[i * n + j] -= A[i * n + k] * x;
    }
    T root = A[j * n + j];
    if constexpr (sizeof(T) == sizeof(double)) {
      root = 1.0 / std::sqrt(root);
    } else {
      for (int l = 0; l < W; ++l) root[l] = 1.0 / std::sqrt(root[l]);
    }
    A[j * n + j] = root;
    for (int i = j + 1; i < n; ++i) A[i * n + j] *= root;
  }
}

template <class T, class X>
inline void solve_small(int n, const T* L, X* x, std::ptrdiff_t stride) {
  for (int i = 0; i < n; ++i) {
    X sum = x[i * stride];
    for (int k = 0; k < i; ++k) sum -= L[i * n + k] * x[k * stride];
    x[i * stride] = sum * L[i * n + i];
  }
  for (int i = n - 1; i >= 0; --i) {
    X sum = x[i * stride];
    for (int k = i + 1; k < n; ++k) sum -= L[k * n + i] * x[k * stride];
    x[i * stride] = sum * L[i * n + i];
  }
}

// W windows side by side, each in a lane; lanes without a window repeat the last one.
class Windows {
 public:
  Windows(const Arm& arm, const double* inertial, const Servos& servos)
      : arm_(arm), inertial_(inertial), servos_(servos), bodies_(arm.n), q_(arm.n), dq_(arm.n), y_(arm.n),
        middle_(arm.n), bias_(arm.n), G_(arm.n), M_(arm.n * arm.n), A_(arm.n * arm.n), command_(arm.n), torque_(arm.n) {
    for (int e = 0; e < servos.laws.count; ++e) dry_ = dry_ || is_dry(servos.laws, e);
  }

  // States of `count` windows at N + 1 instants: q and dq (windows, N + 1, n), the first of each given. Returns the
  // number of steps that did not settle.
  std::ptrdiff_t run(const Commands* commands, int count, std::ptrdiff_t N, double* const* q, double* const* dq) {
    const int n = arm_.n;
    std::ptrdiff_t open = 0;
    for (int i = 0; i < n; ++i) {
      for (int l = 0; l < W; ++l) {
        q_[i][l] = q[smaller(l, count - 1)][i];
        dq_[i][l] = dq[smaller(l, count - 1)][i];
        y_[i][l] = dq_[i][l];
      }
    }
    for (std::ptrdiff_t s = 0; s < N; ++s) {
      for (int i = 0; i < n; ++i) {
        for (int l = 0; l < W; ++l) {
          const Commands& from = commands[smaller(l, count - 1)];
          command_[i][l] = from.position[s * n + i];
          torque_[i][l] = from.torque == nullptr ? 0.0 : from.torque[s * n + i];
        }
      }
      open += !step();
      for (int l = 0; l < count; ++l) {
        for (int i = 0; i < n; ++i) {
          q[l][(s + 1) * n + i] = q_[i][l];
          dq[l][(s + 1) * n + i] = dq_[i][l];
        }
      }
    }
    return open;
  }

 private:
  const Arm& arm_;
  const double* inertial_;
  const Servos& servos_;
  Buffer<Body> bodies_;
  Buffer<V> q_, dq_, y_, middle_, bias_, G_, M_, A_, command_, torque_;
  bool dry_ = false;

  bool step() {
    const int n = arm_.n;
    const double h = servos_.step;
    for (int i = 0; i < n; ++i) middle_[i] = q_[i] + 0.5 * h * dq_[i];
    load_all(arm_, inertial_, middle_.data(), dq_.data(), nullptr, false, bodies_.data());
    torque_and_mass(arm_, bodies_.data(), bias_.data(), M_.data());
    for (int i = 0; i < n; ++i) M_[i * n + i] += servos_.armature[i];
    bool settled = false;
    for (int pass = 0; pass < NEWTON_PASSES && !settled; ++pass) settled = newton();
    // A motion that diverges is not iterated any more, and has not settled.
    for (int i = 0; i < n; ++i) settled = settled && !any(y_[i] != y_[i]);
    for (int i = 0; i < n; ++i) {
      q_[i] += 0.5 * h * (dq_[i] + y_[i]);
      dq_[i] = y_[i];
    }
    return settled;
  }

  // One pass; true where no velocity of any window changes any more.
  bool newton() {
    const int n = arm_.n;
    const double h = servos_.step;
    for (int k = 0; k < n * n; ++k) A_[k] = M_[k] / h;
    for (int i = 0; i < n; ++i) {
      G_[i] = bias_[i];
      for (int k = 0; k < n; ++k) G_[i] += A_[i * n + k] * (y_[k] - dq_[k]);
    }
    add_laws(servos_.laws, n, middle_.data(), dq_.data(), y_.data(), servos_.steep, true, G_.data(), nullptr, nullptr,
             A_.data());
    for (int i = 0; i < n; ++i) {
      const double kp = servos_.stiffness[i], kd = servos_.damping[i];
      const V limit = splat(servos_.limit[i]);
      const V both = dq_[i] + y_[i];
      const V raw = kp * (command_[i] - q_[i] - 0.25 * h * both) - 0.5 * kd * both + torque_[i];
      const I inside = (raw < limit) & (raw > -limit);
      G_[i] -= choose(raw > limit, limit, choose(raw < -limit, -limit, raw));
      A_[i * n + i] += choose(inside, splat(0.25 * h * kp + 0.5 * kd), V{});
    }
    factor_small(n, A_.data());
    solve_small(n, A_.data(), G_.data(), 1);
    I moved = {};
    for (int i = 0; i < n; ++i) {
      V next = y_[i] - G_[i];
      // Through zero only by way of zero, where dry friction is steep; else Newton's steps may alternate.
      if (dry_) next = choose(next * y_[i] < 0.0, V{}, next);
      const V change = next - y_[i];
      moved |= choose(change < 0.0, -change, change) > NEWTON_SETTLED * (1.0 + choose(next < 0.0, -next, next));
      y_[i] = next;
    }
    return !any(moved);
  }
};

// Derivatives of the states of one window by parameters, beside a roll-out that is known.
class Sensitivities {
 public:
  Sensitivities(const Arm& arm, const double* inertial, const Servos& servos, const RolloutParameters& parameters)
      : arm_(arm), inertial_(inertial), servos_(servos), wanted_(parameters), n_(arm.n),
        width_(padded(parameters.count)), bodies_(arm.n), state_(4 * arm.n), middle_(W * arm.n), v_(W * arm.n),
        a_(W * arm.n), columns_(static_cast<std::size_t>(parameters.links.offset[arm.n]) * W),
        maker_(arm, parameters.links, W), M_(arm.n * arm.n), by_q_(arm.n * arm.n), by_dq_(arm.n * arm.n),
        law_q_(arm.n * arm.n), law_v_(arm.n * arm.n), law_y_(arm.n * arm.n), torque_(arm.n),
        laws_(larger(servos.laws.count, 1)), lanes_(3 * arm.n), A_(arm.n * arm.n), Gq_(arm.n * arm.n),
        Gv_(arm.n * arm.n), rhs_(arm.n * width_), q_(arm.n * width_), dq_(arm.n * width_) {}

  // q and dq (N + 1, n) of the roll-out. S_q and S_dq (n, count) at the first state; of the states every, 2 every, ...
  // the derivatives of q go to `out` (rows, n, count).
  void run(const Commands& commands, std::ptrdiff_t N, const double* q, const double* dq, const double* S_q,
           const double* S_dq, std::ptrdiff_t every, double* out) {
    for (int i = 0; i < n_; ++i) {
      for (int p = 0; p < wanted_.count; ++p) {
        q_[i * width_ + p] = S_q[i * wanted_.count + p];
        dq_[i * width_ + p] = S_dq[i * wanted_.count + p];
      }
    }
    for (std::ptrdiff_t s = 0; s < N; s += W) {
      linearise(N, q, dq, s);
      for (int l = 0; l < W && s + l < N; ++l) {
        advance(commands, N, q, dq, s + l, l);
        if ((s + l + 1) % every != 0) continue;
        double* to = out + ((s + l + 1) / every - 1) * n_ * wanted_.count;
        for (int i = 0; i < n_; ++i)
          std::memcpy(to + i * wanted_.count, &q_[i * width_], sizeof(double) * wanted_.count);
      }
    }
  }

 private:
  const Arm& arm_;
  const double* inertial_;
  const Servos& servos_;
  const RolloutParameters& wanted_;
  int n_, width_;
  Buffer<Body> bodies_;
  Buffer<V> state_;  // middle, velocity, acceleration, velocity at the step's end
  Buffer<double> middle_, v_, a_, columns_;
  Columns maker_;
  Buffer<V> M_, by_q_, by_dq_, law_q_, law_v_, law_y_, torque_, laws_, lanes_;
  Buffer<double> A_, Gq_, Gv_, rhs_, q_, dq_;

  // What G depends on, for the W steps from s on.
  void linearise(std::ptrdiff_t N, const double* q, const double* dq, std::ptrdiff_t s) {
    const double h = servos_.step;
    V *middle = state_.data(), *v = middle + n_, *a = v + n_, *y = a + n_;
    for (int l = 0; l < W; ++l) {
      const std::ptrdiff_t at = smaller(s + l, N - 1) * n_;
      for (int i = 0; i < n_; ++i) {
        v[i][l] = v_[l * n_ + i] = dq[at + i];
        y[i][l] = dq[at + n_ + i];
        middle[i][l] = middle_[l * n_ + i] = q[at + i] + 0.5 * h * dq[at + i];
        a[i][l] = a_[l * n_ + i] = (dq[at + n_ + i] - dq[at + i]) / h;
      }
    }
    load_all(arm_, inertial_, middle, v, a, true, bodies_.data());
    torque_derivatives(arm_, bodies_.data(), M_.data(), by_q_.data(), by_dq_.data());
    std::memset(law_q_.data(), 0, sizeof(V) * n_ * n_);
    std::memset(law_v_.data(), 0, sizeof(V) * n_ * n_);
    std::memset(law_y_.data(), 0, sizeof(V) * n_ * n_);
    const Laws& laws = servos_.laws;
    add_laws(laws, n_, middle, v, y, servos_.steep, false, torque_.data(), law_q_.data(), law_v_.data(), law_y_.data());
    for (int e = 0; e < laws.count; ++e) laws_[e] = law_of_step(laws, e, middle, v, y, servos_.steep).x;
    if (wanted_.links.target == nullptr) return;
    const Samples in{middle_.data(), v_.data(), a_.data(), nullptr, nullptr, 0, nullptr};
    maker_.make(arm_, wanted_.links, in, 0, W - 1, columns_.data());
  }

  void advance(const Commands& commands, std::ptrdiff_t N, const double* q, const double* dq, std::ptrdiff_t s, int l) {
    const double h = servos_.step;
    std::memset(rhs_.data(), 0, sizeof(double) * n_ * width_);
    for (int e = 0; e < n_ * n_; ++e) {
      const double law_q = law_q_[e][l], m = M_[e][l] / h;
      A_[e] = m + law_y_[e][l];
      Gq_[e] = by_q_[e][l] + law_q;
      Gv_[e] = 0.5 * h * (by_q_[e][l] + law_q) + by_dq_[e][l] + law_v_[e][l] - m;
    }
    for (int i = 0; i < n_; ++i) {
      const double v = dq[s * n_ + i], y = dq[(s + 1) * n_ + i], kp = servos_.stiffness[i], kd = servos_.damping[i];
      const double error = commands.position[s * n_ + i] - q[s * n_ + i] - 0.25 * h * (v + y);
      const double mean = 0.5 * (v + y),
                   raw = kp * error - kd * mean + (commands.torque == nullptr ? 0.0 : commands.torque[s * n_ + i]);
      const bool inside = raw < servos_.limit[i] && raw > -servos_.limit[i];
      A_[i * n_ + i] += servos_.armature[i] / h;
      Gv_[i * n_ + i] -= servos_.armature[i] / h;
      double* row = &rhs_[i * width_];
      if (wanted_.armature[i] >= 0) row[wanted_.armature[i]] -= (y - v) / h;
      if (!inside) {
        if (wanted_.limit[i] >= 0) row[wanted_.limit[i]] += raw > 0.0 ? 1.0 : -1.0;
        continue;
      }
      A_[i * n_ + i] += 0.25 * h * kp + 0.5 * kd;
      Gq_[i * n_ + i] += kp;
      Gv_[i * n_ + i] += 0.25 * h * kp + 0.5 * kd;
      if (wanted_.stiffness[i] >= 0) row[wanted_.stiffness[i]] += error;
      if (wanted_.damping[i] >= 0) row[wanted_.damping[i]] -= mean;
      for (int e = 0; e < wanted_.inputs; ++e) {
        if (wanted_.input_joint[e] == i) row[wanted_.input_parameter[e]] += wanted_.input[e * N + s];
      }
    }
    add_sources(l);
    factor_small(n_, A_.data());
    for (int p = 0; p < width_; p += W) propagate(p);
  }

  // What links and laws give for a unit of their parameters.
  void add_sources(int l) {
    const Laws& laws = servos_.laws;
    for (int e = 0; e < laws.count; ++e) {
      if (wanted_.law[e] < 0) continue;
      for (int k = laws.link[e]; k < laws.link[e + 1]; ++k) {
        rhs_[laws.joint[k] * width_ + wanted_.law[e]] -= laws.weight[k] * laws_[e][l];
      }
    }
    if (wanted_.links.target == nullptr) return;
    const std::int32_t* offset = wanted_.links.offset;
    for (int i = 0; i < n_; ++i) {
      for (int c = offset[i]; c < offset[i + 1] - 1; ++c) {
        rhs_[i * width_ + wanted_.parameter[c]] -= columns_[c * W + l];
      }
    }
  }

  void propagate(int p) {
    const double h = servos_.step;
    V *q = lanes_.data(), *v = q + n_, *x = v + n_;
    for (int k = 0; k < n_; ++k) {
      q[k] = load(&q_[k * width_ + p]);
      v[k] = load(&dq_[k * width_ + p]);
    }
    for (int i = 0; i < n_; ++i) {
      V sum = load(&rhs_[i * width_ + p]);
      for (int k = 0; k < n_; ++k) sum -= Gq_[i * n_ + k] * q[k] + Gv_[i * n_ + k] * v[k];
      x[i] = sum;
    }
    solve_small(n_, A_.data(), x, 1);
    for (int i = 0; i < n_; ++i) {
      store(&q_[i * width_ + p], q[i] + 0.5 * h * (v[i] + x[i]));
      store(&dq_[i * width_ + p], x[i]);
    }
  }
};

// States of `windows` windows, q and dq (windows, N + 1, n) with the first of each given; the number of steps that did
// not settle.
inline std::ptrdiff_t roll_out(const Arm& arm, const double* inertial, const Servos& servos, const Commands& commands,
                               std::ptrdiff_t windows, std::ptrdiff_t N, double* q, double* dq) {
  Windows side_by_side(arm, inertial, servos);
  const std::ptrdiff_t inputs = N * arm.n, states = (N + 1) * arm.n;
  std::ptrdiff_t open = 0;
  for (std::ptrdiff_t w = 0; w < windows; w += W) {
    Commands of[W];
    double *to_q[W], *to_dq[W];
    const int count = static_cast<int>(smaller(W, windows - w));
    for (int l = 0; l < count; ++l) {
      of[l] = {commands.position + (w + l) * inputs,
               commands.torque == nullptr ? nullptr : commands.torque + (w + l) * inputs};
      to_q[l] = q + (w + l) * states;
      to_dq[l] = dq + (w + l) * states;
    }
    open += side_by_side.run(of, count, N, to_q, to_dq);
  }
  return open;
}

inline void roll_out_sensitivities(const Arm& arm, const double* inertial, const Servos& servos,
                                   const RolloutParameters& parameters, const Commands& commands, std::ptrdiff_t N,
                                   const double* q, const double* dq, const double* S_q, const double* S_dq,
                                   std::ptrdiff_t every, double* out) {
  Sensitivities(arm, inertial, servos, parameters).run(commands, N, q, dq, S_q, S_dq, every, out);
}

}  // namespace armid::ARMID_ISA
