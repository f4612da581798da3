// The motion of one window: links and joints side by side in lanes, since its steps cannot be.
//
// Lane l of group g is link and joint g W + l. Only the poses go from link to link. Velocities, and what a joint
// carries, are sums over ancestors and over carried links: a broadcast for each link, under a mask of ones and zeros.
#pragma once

#include "step.hpp"

namespace armid::ARMID_ISA {

// The constant geometry of W links. Prismatic joints have no sine and cosine part, revolute ones no slide.
struct LinkConstants {
  V along[9], cross[9], across[9];  // rotation of a link in its parent's frame
  V lever[3], slide[3], axis[3], revolute;
  V inertial[10];
};

struct Pose {
  V R[9], p[3];
};

// A law of as many joints as there are lanes, each with its own weight and parameter.
struct LawGroup {
  int law;    // one of them: their programs are the same
  int group;  // of joints
  bool dry;
  V weight, value;
  I used;
};

class OneWindow {
 public:
  OneWindow(const Arm& arm, const double* inertial, const Servos& servos)
      : arm_(arm), servos_(servos), groups_(padded(arm.n) / W), constants_(groups_), turns_(groups_), bodies_(groups_),
        carried_(groups_), masks_(2 * arm.n * groups_), below_(arm.n * groups_), above_(arm.n * groups_),
        gains_(4 * groups_), q_(groups_), dq_(groups_), y_(groups_), middle_(groups_), bias_(groups_), G_(groups_),
        slope_(groups_), command_(groups_), torque_(groups_), M_(arm.n * groups_), A_(arm.n * groups_),
        pushed_(groups_), laws_(servos.laws.count), coupled_(servos.laws.count), slopes_(groups_ + servos.laws.count),
        factored_(groups_ + servos.laws.count) {
    for (int i = 0; i < arm.n; ++i) start_link(i, inertial + 10 * i);
    for (int g = 0; g < groups_; ++g) gains_[2 * groups_ + g] = splat(std::numeric_limits<double>::infinity());
    const double* gains[4] = {servos.stiffness, servos.damping, servos.limit, servos.armature};
    for (int k = 0; k < 4; ++k) {
      for (int i = 0; i < arm.n; ++i) gains_[k * groups_ + i / W][i % W] = gains[k][i];
    }
    for (int e = 0; e < servos.laws.count; ++e) start_law(e);
  }

  // States at N + 1 instants, q and dq (N + 1, n), the first of each given. Returns the number of steps that did not
  // settle.
  std::ptrdiff_t run(const Commands& commands, std::ptrdiff_t N, double* q, double* dq) {
    const int n = arm_.n;
    std::ptrdiff_t open = 0;
    std::memcpy(q_.data(), q, sizeof(double) * n);
    std::memcpy(dq_.data(), dq, sizeof(double) * n);
    for (int g = 0; g < groups_; ++g) y_[g] = dq_[g];
    for (std::ptrdiff_t s = 0; s < N; ++s) {
      std::memcpy(command_.data(), commands.position + s * n, sizeof(double) * n);
      if (commands.torque != nullptr) std::memcpy(torque_.data(), commands.torque + s * n, sizeof(double) * n);
      open += !step();
      std::memcpy(q + (s + 1) * n, q_.data(), sizeof(double) * n);
      std::memcpy(dq + (s + 1) * n, dq_.data(), sizeof(double) * n);
    }
    return open;
  }

 private:
  const Arm& arm_;
  const Servos& servos_;
  int groups_;
  Buffer<LinkConstants> constants_;
  Buffer<Pose> turns_;  // of links in their parents' frames
  Buffer<Body> bodies_, carried_;
  Buffer<V> masks_;          // for each link: 1 where it is carried by a lane's joint, then where it carries
  Buffer<V> below_, above_;  // for each row of the mass matrix: 1 / step at ancestors, and at carried links
  Buffer<V> gains_, q_, dq_, y_, middle_, bias_, G_, slope_, command_, torque_, M_, A_, pushed_;
  Buffer<LawGroup> laws_;
  Buffer<int> coupled_;          // laws whose coordinate is not one joint
  Buffer<V> slopes_, factored_;  // of servos, laws and coupled laws: now, and in the factor that A_ holds
  int law_groups_ = 0, coupled_laws_ = 0;
  bool dry_ = false;

  const double* numbers(const Buffer<V>& x) const { return reinterpret_cast<const double*>(&x[0]); }

  V* carried_by(int link) { return masks_.data() + link * groups_; }
  V* carries(int link) { return masks_.data() + (arm_.n + link) * groups_; }

  void start_link(int i, const double* inertial) {
    const JointConstants& joint = arm_.joints[i];
    LinkConstants& of = constants_[i / W];
    const int l = i % W;
    for (int k = 0; k < 9; ++k) {
      of.along[k][l] = joint.along[k] + (joint.prismatic ? joint.across[k] : 0.0);
      of.cross[k][l] = joint.prismatic ? 0.0 : joint.cross[k];
      of.across[k][l] = joint.prismatic ? 0.0 : joint.across[k];
    }
    for (int k = 0; k < 3; ++k) {
      const double sign = joint.flip[k] < 0 ? -1.0 : 1.0;
      of.lever[joint.from[k]][l] = sign * joint.lever[k];
      of.slide[joint.from[k]][l] = joint.prismatic ? sign * joint.slide[k] : 0.0;
      of.axis[k][l] = joint.axis[k];
    }
    of.revolute[l] = joint.prismatic ? 0.0 : 1.0;
    for (int k = 0; k < 10; ++k) of.inertial[k][l] = inertial[k];
    for (int pair = arm_.first[i]; pair < arm_.first[i + 1]; ++pair) {
      const int j = arm_.ancestor[pair];
      carried_by(i)[j / W][j % W] = 1.0;
      carries(j)[i / W][i % W] = 1.0;
      below_[i * groups_ + j / W][j % W] = 1.0 / servos_.step;
      if (j != i) above_[j * groups_ + i / W][i % W] = 1.0 / servos_.step;
    }
  }

  static bool same_program(const Laws& laws, int a, int b) {
    const int count = laws.first[a + 1] - laws.first[a];
    if (laws.first[b + 1] - laws.first[b] != count) return false;
    for (int k = 0; k < count; ++k) {
      const int at = laws.first[a] + k, other = laws.first[b] + k;
      if (laws.operation[at] != laws.operation[other] || laws.constant[at] != laws.constant[other]) return false;
    }
    return true;
  }

  void start_law(int e) {
    const Laws& laws = servos_.laws;
    dry_ = dry_ || is_dry(laws, e);
    if (laws.link[e + 1] - laws.link[e] != 1) {
      coupled_[coupled_laws_++] = e;
      return;
    }
    const int joint = laws.joint[laws.link[e]], l = joint % W;
    LawGroup* to = nullptr;
    for (int k = 0; k < law_groups_; ++k) {
      LawGroup& each = laws_[k];
      if (each.group == joint / W && each.used[l] == 0 && same_program(laws, each.law, e)) to = &each;
    }
    if (to == nullptr) {
      to = &laws_[law_groups_++];
      *to = {e, joint / W, is_dry(laws, e), V{}, V{}, I{}};
    }
    to->weight[l] = laws.weight[laws.link[e]];
    to->value[l] = laws.value[e];
    to->used[l] = -1;
  }

  bool step() {
    const double h = servos_.step;
    for (int g = 0; g < groups_; ++g) middle_[g] = q_[g] + 0.5 * h * dq_[g];
    place();
    move();
    torque_and_inertia();
    bool settled = false;
    for (int pass = 0; pass < NEWTON_PASSES && !settled; ++pass) settled = newton(pass == 0);
    for (int g = 0; g < groups_; ++g) {
      // A motion that diverges is not iterated any more, and has not settled.
      settled = settled && !any(y_[g] != y_[g]);
      q_[g] += 0.5 * h * (dq_[g] + y_[g]);
      dq_[g] = y_[g];
    }
    return settled;
  }

  // Poses and axes of all links in the base frame.
  void place() {
    for (int g = 0; g < groups_; ++g) {
      const LinkConstants& of = constants_[g];
      V s, c;
      sincos(middle_[g], s, c);
      for (int k = 0; k < 9; ++k) turns_[g].R[k] = of.along[k] + s * of.cross[k] + c * of.across[k];
      for (int k = 0; k < 3; ++k) turns_[g].p[k] = of.lever[k] + middle_[g] * of.slide[k];
    }
    for (int i = 0; i < arm_.n; ++i) {
      const int from = arm_.joints[i].parent, l = i % W;
      const Pose& turn = turns_[i / W];
      Body& to = bodies_[i / W];
      if (from < 0) {
        for (int k = 0; k < 9; ++k) to.R[k][l] = turn.R[k][l];
        for (int k = 0; k < 3; ++k) to.p[k][l] = turn.p[k][l];
        continue;
      }
      const Body& parent = bodies_[from / W];
      const int m = from % W;
      for (int r = 0; r < 3; ++r) {
        const double x = parent.R[3 * r][m], y = parent.R[3 * r + 1][m], z = parent.R[3 * r + 2][m];
        for (int k = 0; k < 3; ++k) to.R[3 * r + k][l] = x * turn.R[k][l] + y * turn.R[3 + k][l] + z * turn.R[6 + k][l];
        to.p[r][l] = parent.p[r][m] + x * turn.p[0][l] + y * turn.p[1][l] + z * turn.p[2][l];
      }
    }
    for (int g = 0; g < groups_; ++g) {
      Body& body = bodies_[g];
      const V revolute = constants_[g].revolute;
      V along[3], turned[3];
      rotate(body.R, constants_[g].axis, along);
      cross(body.p, along, turned);
      for (int k = 0; k < 3; ++k) {
        body.axis_w[k] = revolute * along[k];
        body.axis_v[k] = revolute * turned[k] + (1.0 - revolute) * along[k];
      }
    }
  }

  // Velocities and accelerations of all links, their inertias and forces.
  void move() {
    for (int g = 0; g < groups_; ++g) {
      Body& body = bodies_[g];
      V sum[6] = {};
      for (int j = 0; j < arm_.n; ++j) {
        const Body& from = bodies_[j / W];
        const V share = dq_[j / W][j % W] * carries(j)[g];
        for (int k = 0; k < 3; ++k) {
          sum[k] += share * from.axis_w[k][j % W];
          sum[3 + k] += share * from.axis_v[k][j % W];
        }
      }
      for (int k = 0; k < 3; ++k) {
        body.w[k] = sum[k];
        body.v[k] = sum[3 + k];
      }
      // The own axis does not turn itself: the velocity of the link does for that of its parent.
      cross(body.w, body.axis_w, body.rate_w);
      cross(body.w, body.axis_v, body.rate_v);
      add_crossed(body.v, body.axis_w, body.rate_v);
    }
    for (int g = 0; g < groups_; ++g) {
      Body& body = bodies_[g];
      V sum[6] = {};
      for (int k = 0; k < 3; ++k) sum[3 + k] = splat(-arm_.gravity[k]);
      for (int j = 0; j < arm_.n; ++j) {
        const Body& from = bodies_[j / W];
        const V share = dq_[j / W][j % W] * carries(j)[g];
        for (int k = 0; k < 3; ++k) {
          sum[k] += share * from.rate_w[k][j % W];
          sum[3 + k] += share * from.rate_v[k][j % W];
        }
      }
      for (int k = 0; k < 3; ++k) {
        body.aw[k] = sum[k];
        body.av[k] = sum[3 + k];
      }
      load_body(constants_[g].inertial, body);
    }
  }

  // Torque at no acceleration, and the rows of the mass matrix with the rotors over the step.
  void torque_and_inertia() {
    for (int g = 0; g < groups_; ++g) {
      V sum[16] = {};
      for (int j = 0; j < arm_.n; ++j) {
        const Body& from = bodies_[j / W];
        const V mask = carried_by(j)[g];
        const int l = j % W;
        sum[0] += mask * from.m[l];
        for (int k = 0; k < 3; ++k) {
          sum[1 + k] += mask * from.h[k][l];
          sum[4 + k] += mask * from.n[k][l];
          sum[7 + k] += mask * from.f[k][l];
        }
        for (int k = 0; k < 6; ++k) sum[10 + k] += mask * from.J[k][l];
      }
      Body& to = carried_[g];
      const Body& body = bodies_[g];
      to.m = sum[0];
      for (int k = 0; k < 3; ++k) to.h[k] = sum[1 + k];
      for (int k = 0; k < 6; ++k) to.J[k] = sum[10 + k];
      bias_[g] = power(body.axis_w, body.axis_v, sum + 4, sum + 7);
      times_inertia(to, body.axis_w, body.axis_v, to.n, to.f);
    }
    for (int i = 0; i < arm_.n; ++i) {
      const Body &own = bodies_[i / W], &load = carried_[i / W];
      const int l = i % W;
      for (int g = 0; g < groups_; ++g) {
        const Body &body = bodies_[g], &other = carried_[g];
        V below = {}, above = {};
        for (int k = 0; k < 3; ++k) {
          below += load.n[k][l] * body.axis_w[k] + load.f[k][l] * body.axis_v[k];
          above += own.axis_w[k][l] * other.n[k] + own.axis_v[k][l] * other.f[k];
        }
        M_[i * groups_ + g] = below_[i * groups_ + g] * below + above_[i * groups_ + g] * above;
      }
      M_[i * groups_ + i / W][l] += servos_.armature[i] / servos_.step;
    }
  }

  // Laws of single joints, side by side: torques added to G_, slopes that are not below zero to slope_.
  void add_straight_laws() {
    for (int e = 0; e < law_groups_; ++e) {
      const LawGroup& of = laws_[e];
      const int g = of.group;
      const V rate = of.dry ? y_[g] : 0.5 * (dq_[g] + y_[g]);
      const Dual law = law_value(servos_.laws, of.law, of.weight * middle_[g], of.weight * rate, servos_.steep);
      const V value = of.weight * of.value, slope = (of.dry ? 1.0 : 0.5) * of.weight * value * law.by_dq;
      G_[g] += choose(of.used, value * law.x, V{});
      slopes_[groups_ + e] = choose(of.used & (slope > 0.0), slope, V{});
      slope_[g] += slopes_[groups_ + e];
    }
  }

  // Laws of coordinates that several joints make; the same in all lanes.
  void add_coupled_laws() {
    const Laws& laws = servos_.laws;
    for (int c = 0; c < coupled_laws_; ++c) {
      const int e = coupled_[c];
      const bool dry = is_dry(laws, e);
      double position = 0.0, rate = 0.0;
      for (int k = laws.link[e]; k < laws.link[e + 1]; ++k) {
        const int i = laws.joint[k];
        position += laws.weight[k] * numbers(middle_)[i];
        rate += laws.weight[k] * (dry ? numbers(y_)[i] : 0.5 * (numbers(dq_)[i] + numbers(y_)[i]));
      }
      const Dual law = law_value(laws, e, splat(position), splat(rate), servos_.steep);
      const double slope = (dry ? 1.0 : 0.5) * laws.value[e] * law.by_dq[0];
      slopes_[groups_ + law_groups_ + c] = splat(slope < 0.0 ? 0.0 : slope);
      for (int k = laws.link[e]; k < laws.link[e + 1]; ++k) {
        G_[laws.joint[k] / W][laws.joint[k] % W] += laws.weight[k] * laws.value[e] * law.x[0];
      }
    }
  }

  // One pass; true where no velocity changes any more.
  bool newton(bool first) {
    const int n = arm_.n;
    const double h = servos_.step;
    for (int g = 0; g < groups_; ++g) {
      const V kp = gains_[g], kd = gains_[groups_ + g], limit = gains_[2 * groups_ + g];
      const V both = dq_[g] + y_[g];
      const V raw = kp * (command_[g] - q_[g] - 0.25 * h * both) - 0.5 * kd * both + torque_[g];
      const I inside = (raw < limit) & (raw > -limit);
      G_[g] = bias_[g] - choose(raw > limit, limit, choose(raw < -limit, -limit, raw));
      slope_[g] = choose(inside, 0.25 * h * kp + 0.5 * kd, V{});
      slopes_[g] = slope_[g];
      pushed_[g] = y_[g] - dq_[g];
    }
    add_straight_laws();
    add_coupled_laws();
    for (int k = 0; k < n; ++k) {
      const double x = numbers(pushed_)[k];
      for (int g = 0; g < groups_; ++g) G_[g] += x * M_[k * groups_ + g];
    }
    if (first || changed()) factor();
    double* G = reinterpret_cast<double*>(G_.data());
    solve_small(n, groups_ * W, numbers(A_), G, 1, 1);
    I moved = {};
    for (int g = 0; g < groups_; ++g) {
      V next = y_[g] - G_[g];
      // Through zero only by way of zero, where dry friction is steep; else Newton's steps may alternate.
      if (dry_) next = choose(next * y_[g] < 0.0, V{}, next);
      const V change = next - y_[g];
      moved |= choose(change < 0.0, -change, change) > NEWTON_SETTLED * (1.0 + choose(next < 0.0, -next, next));
      y_[g] = next;
    }
    return !any(moved);
  }

  // The matrix of an iteration is that of the factor as long as no slope changes.
  bool changed() const {
    I differs = {};
    for (int e = 0; e < groups_ + law_groups_ + coupled_laws_; ++e) differs |= slopes_[e] != factored_[e];
    return any(differs);
  }

  void factor() {
    const Laws& laws = servos_.laws;
    const int stride = groups_ * W;
    double* A = reinterpret_cast<double*>(A_.data());
    for (int k = 0; k < arm_.n * groups_; ++k) A_[k] = M_[k];
    for (int i = 0; i < arm_.n; ++i) A[i * stride + i] += numbers(slope_)[i];
    for (int c = 0; c < coupled_laws_; ++c) {
      const int e = coupled_[c];
      for (int k = laws.link[e]; k < laws.link[e + 1]; ++k) {
        for (int m = laws.link[e]; m < laws.link[e + 1]; ++m) {
          A[laws.joint[k] * stride + laws.joint[m]] +=
              laws.weight[k] * laws.weight[m] * slopes_[groups_ + law_groups_ + c][0];
        }
      }
    }
    factor_small(arm_.n, stride, A);
    for (int e = 0; e < groups_ + law_groups_ + coupled_laws_; ++e) factored_[e] = slopes_[e];
  }
};

}  // namespace armid::ARMID_ISA
