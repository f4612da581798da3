// Adjoint of the rows: given a cotangent for every entry of the regressor, how their weighted sum
//
//     phi = sum over links i and joints j that carry them of  S_ijᵀ (force and moment of link i under theta_ij)
//
// changes with positions, velocities and accelerations. theta_ij is the cotangent of link i in row j, ten fictitious
// inertial parameters. Every quantity of the forward recursion gets an adjoint (its name with `_bar`), links are gone
// through from the tips to the base, and one sweep costs a few forward ones whatever the number of parameters.
#pragma once

#include "regressor.hpp"

namespace armid::ARMID_ISA {

// What changes of a link's motion are worth.
struct LinkBar {
  V w[3], dw[3], a[3];
};

struct Sweep {
  State state;
  Buffer<LinkBar> links;
  Buffer<Twist> S;
  Buffer<V> q, dq, ddq;

  explicit Sweep(const Arm& arm) : state(arm), links(arm.n), S(arm.first[arm.n]), q(arm.n), dq(arm.n), ddq(arm.n) {}
};

ARMID_INLINE void zero(V* x) { x[0] = x[1] = x[2] = V{}; }

ARMID_INLINE void add(const V* x, V* out) {
  for (int k = 0; k < 3; ++k) out[k] += x[k];
}

// out += derivative by w of v · (w x (w x l)).
ARMID_INLINE void add_centripetal_bar(const V* v, const V* w, const V* l, V* out) {
  const V vw = dot(v, w), wl = dot(w, l), vl = dot(v, l);
  for (int k = 0; k < 3; ++k) out[k] += v[k] * wl + l[k] * vw - 2.0 * (w[k] * vl);
}

// A vector of the rest frame, added to one of the parent's frame.
ARMID_INLINE void add_from_rest(const JointConstants& joint, const V* x, V* out) {
  for (int k = 0; k < 3; ++k) out[joint.from[k]] += flipped(x[k], joint.flip[k]);
}

// axis · (x x y), with the joint's axis in its own frame.
template <int A>
ARMID_INLINE V along_axis(const JointConstants& joint, const V* x, const V* y) {
  if constexpr (A == GENERAL) {
    V out[3];
    cross(x, y, out);
    return out[0] * joint.axis[0] + out[1] * joint.axis[1] + out[2] * joint.axis[2];
  } else {
    constexpr int B = (A + 1) % 3, C = (A + 2) % 3;
    return (x[B] * y[C] - x[C] * y[B]) * joint.sense;
  }
}

// One link's rows: what they are worth to the link's motion and to its Jacobian's columns.
inline void pair_bars(const Arm& arm, int i, const std::ptrdiff_t* to, const double* cotangent, Sweep& sweep) {
  const Link& link = sweep.state.links[i];
  const V* W = link.w;
  LinkBar bar = sweep.links[i];
  for (int pair = arm.first[i]; pair < arm.first[i + 1]; ++pair) {
    V theta[10];
    for (int k = 0; k < 10; ++k) theta[k] = to[10 * pair + k] < 0 ? V{} : load(cotangent + to[10 * pair + k]);
    const V m = theta[0];
    const V* h = theta + 1;
    const V xx = theta[4], xy = theta[5], yy = theta[6], xz = theta[7], yz = theta[8], zz = theta[9];
    const auto inertia = [&](const V* x, V* out) {
      out[0] = xx * x[0] + xy * x[1] + xz * x[2];
      out[1] = xy * x[0] + yy * x[1] + yz * x[2];
      out[2] = xz * x[0] + yz * x[1] + zz * x[2];
    };
    const V* w = sweep.state.S[pair].w;
    const V* v = sweep.state.S[pair].v;
    V force[3], moment[3], Wh[3], IW[3], Iw[3], wW[3], IwW[3];
    // force = m a + dw x h + W x (W x h), moment = h x a + I dw + W x I W
    cross(W, h, Wh);
    inertia(W, IW);
    inertia(link.dw, moment);
    for (int k = 0; k < 3; ++k) force[k] = m * link.a[k];
    add_cross(link.dw, h, GENERAL, force);
    add_cross(W, Wh, GENERAL, force);
    add_cross(h, link.a, GENERAL, moment);
    add_cross(W, IW, GENERAL, moment);
    add(moment, sweep.S[pair].w);
    add(force, sweep.S[pair].v);
    // a: m v + w x h
    for (int k = 0; k < 3; ++k) bar.a[k] += m * v[k];
    add_cross(w, h, GENERAL, bar.a);
    // dw: h x v + I w
    inertia(w, Iw);
    add(Iw, bar.dw);
    add_cross(h, v, GENERAL, bar.dw);
    // W: that of v · (W x (W x h)), and I W x w + I (w x W)
    add_centripetal_bar(v, W, h, bar.w);
    add_cross(IW, w, GENERAL, bar.w);
    cross(w, W, wW);
    inertia(wW, IwW);
    add(IwW, bar.w);
  }
  sweep.links[i] = bar;
}

// From the Jacobian's columns of link i back to those of its parent; returns what turning or sliding the joint is
// worth.
template <int A>
ARMID_INLINE V jacobian_bar(const Arm& arm, int i, Sweep& sweep) {
  const JointConstants& joint = arm.joints[i];
  V q = {};
  if (joint.parent < 0) return q;
  const Link& link = sweep.state.links[i];
  const int count = arm.first[joint.parent + 1] - arm.first[joint.parent];
  for (int p = 0; p < count; ++p) {
    const Twist& own = sweep.state.S[arm.first[i] + p];
    const Twist& bar = sweep.S[arm.first[i] + p];
    const Twist& from = sweep.state.S[arm.first[joint.parent] + p];
    Twist& to = sweep.S[arm.first[joint.parent] + p];
    V w[3], v[3];
    turn_back<A>(link, bar.w, w);
    turn_back<A>(link, bar.v, v);
    if (joint.prismatic) {
      V w_rest[3], lever[3];
      to_rest(joint, from.w, w_rest);
      cross(v, w_rest, lever);
      q += lever[0] * joint.slide[0] + lever[1] * joint.slide[1] + lever[2] * joint.slide[2];
    } else {
      q -= along_axis<A>(joint, own.w, bar.w) + along_axis<A>(joint, own.v, bar.v);
    }
    add_cross(link.lever, v, GENERAL, w);
    add_from_rest(joint, w, to.w);
    add_from_rest(joint, v, to.v);
  }
  return q;
}

// From link i back to its joint and to its parent's motion.
template <int A>
ARMID_INLINE void move_bar(const Arm& arm, int i, Sweep& sweep) {
  const JointConstants& joint = arm.joints[i];
  const Link& link = sweep.state.links[i];
  LinkBar& bar = sweep.links[i];
  const V axis[3] = {splat(joint.axis[0]), splat(joint.axis[1]), splat(joint.axis[2])};
  const V dq = sweep.state.dq[i];
  V q = jacobian_bar<A>(arm, i, sweep);
  V turned[3];
  if (joint.prismatic) {
    // a has 2 dq w x axis + ddq axis
    sweep.ddq[i] = dot(bar.a, axis);
    sweep.dq[i] = 2.0 * along_axis<A>(joint, bar.a, link.w);
    cross(axis, bar.a, turned);
    for (int k = 0; k < 3; ++k) bar.w[k] += 2.0 * dq * turned[k];
  } else {
    // w has dq axis; dw has dq w x axis + ddq axis, and w x axis does not feel the axis in w
    sweep.ddq[i] = dot(bar.dw, axis);
    sweep.dq[i] = dot(bar.w, axis) + along_axis<A>(joint, bar.dw, link.w);
    cross(axis, bar.dw, turned);
    for (int k = 0; k < 3; ++k) bar.w[k] += dq * turned[k];
    V dw[3];
    cross(link.w, axis, dw);
    for (int k = 0; k < 3; ++k) dw[k] = link.dw[k] - dq * dw[k];
    q -= along_axis<A>(joint, link.w, bar.w) + along_axis<A>(joint, dw, bar.dw) + along_axis<A>(joint, link.a, bar.a);
  }
  if (joint.parent >= 0) {
    const Link& parent = sweep.state.links[joint.parent];
    LinkBar& to = sweep.links[joint.parent];
    V w[3], dw[3], a[3], w_rest[3], dw_rest[3];
    turn_back<A>(link, bar.w, w);
    turn_back<A>(link, bar.dw, dw);
    turn_back<A>(link, bar.a, a);
    to_rest(joint, parent.w, w_rest);
    if (joint.prismatic) {
      // a has dw x lever + w x (w x lever)
      to_rest(joint, parent.dw, dw_rest);
      V lever[3];
      cross(a, dw_rest, lever);
      const V aw = dot(a, w_rest), ww = dot(w_rest, w_rest);
      for (int k = 0; k < 3; ++k) q += (lever[k] + w_rest[k] * aw - a[k] * ww) * joint.slide[k];
    }
    add_cross(link.lever, a, GENERAL, dw);
    add_centripetal_bar(a, w_rest, link.lever, w);
    add_from_rest(joint, w, to.w);
    add_from_rest(joint, dw, to.dw);
    add_from_rest(joint, a, to.a);
  }
  sweep.q[i] = q;
}

// The adjoint of the columns of `layout` under cotangents that stand `stride` apart from column to column.
class Adjoint {
 public:
  Adjoint(const Arm& arm, const Layout& layout, std::ptrdiff_t stride)
      : arm_(arm), sweep_(arm), to_(layout.target == nullptr ? 0 : 10 * arm.first[arm.n]) {
    for (int e = 0; e < 10 * arm.first[arm.n] && layout.target != nullptr; ++e) {
      const int column = layout.target[e];
      to_[e] = column < 0 ? -1 : (layout.offset[arm.ancestor[e / 10]] + column) * stride;
    }
  }

  // W samples from `at` on; `last` stands for those behind it.
  void sweep(const Samples& in, std::ptrdiff_t at, std::ptrdiff_t last, const double* cotangent) {
    State& state = sweep_.state;
    place_all(arm_, in.q, at, last, state);
    read(in.dq, at, last, arm_.n, state.dq.data());
    read(in.ddq, at, last, arm_.n, state.ddq.data());
    for (int i = 0; i < arm_.n; ++i) {
      move_link(arm_, i, state);
      by_kind(arm_.joints[i], [&](auto kind) { jacobian<kind.axis>(arm_, i, state); });
      zero(sweep_.links[i].w);
      zero(sweep_.links[i].dw);
      zero(sweep_.links[i].a);
    }
    for (int pair = 0; pair < arm_.first[arm_.n]; ++pair) {
      zero(sweep_.S[pair].w);
      zero(sweep_.S[pair].v);
    }
    for (int i = arm_.n - 1; i >= 0; --i) {
      pair_bars(arm_, i, to_.data(), cotangent, sweep_);
      by_kind(arm_.joints[i], [&](auto kind) { move_bar<kind.axis>(arm_, i, sweep_); });
    }
  }

  // Gradients (N, n) of `count` samples from `at` on.
  void write(std::ptrdiff_t at, int count, double* q, double* dq, double* ddq) {
    for (int i = 0; i < arm_.n; ++i) {
      for (int l = 0; l < count; ++l) {
        q[(at + l) * arm_.n + i] = sweep_.q[i][l];
        dq[(at + l) * arm_.n + i] = sweep_.dq[i][l];
        ddq[(at + l) * arm_.n + i] = sweep_.ddq[i][l];
      }
    }
  }

 private:
  const Arm& arm_;
  Sweep sweep_;
  Buffer<std::ptrdiff_t> to_;
};

// Adjoint of the columns of `layout` under cotangents (columns, N), N at least W: gradients (N, n).
inline void columns_adjoint(const Arm& arm, const Layout& layout, const Samples& in, const double* cotangent,
                            std::ptrdiff_t N, double* q, double* dq, double* ddq) {
  Adjoint adjoint(arm, layout, N);
  for (std::ptrdiff_t s = 0; s < N; s += W) {
    const std::ptrdiff_t at = smaller(s, N - W);  // the last register covers some samples twice
    adjoint.sweep(in, at, N - 1, cotangent + at);
    adjoint.write(at, W, q, dq, ddq);
  }
}

}  // namespace armid::ARMID_ISA
