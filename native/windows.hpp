// The motion of several windows, side by side in lanes.
#pragma once

#include "step.hpp"

namespace armid::ARMID_ISA {

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
    factor_small(n, n, A_.data());
    solve_small(n, n, A_.data(), G_.data(), 1, 1);
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

}  // namespace armid::ARMID_ISA
