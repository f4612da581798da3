// Forward recursion: velocity and acceleration of every link, W samples at a time.
//
// `a` is the acceleration of the link's origin less gravity, so that the base "accelerates" with -g. S[pair] is the
// velocity of link i for unit velocity of its ancestor j, seen and taken at the origin of link i: the columns of the
// body Jacobian, from which rows of the regressor are dot products [Featherstone2008].
//
// Functions with a parameter A are for a square joint about axis A, or for any joint where A = GENERAL.
#pragma once

#include "arm.hpp"
#include "lanes.hpp"

namespace armid::ARMID_ISA {

struct Link {
  V R[9];               // rotation in the parent's frame; of general joints
  V sine, cosine;       // of the turn about coordinate axis A; of square joints
  V lever[3];           // origin in the rest frame
  V w[3], dw[3], a[3];  // angular velocity and acceleration, acceleration of the origin less gravity
};

struct Twist {
  V w[3], v[3];
};

struct State {
  Buffer<Link> links;
  Buffer<Twist> S;
  Buffer<V> q, dq, ddq, torque;  // of each joint, with room for whole registers

  explicit State(const Arm& arm)
      : links(arm.n), S(arm.first[arm.n]), q(padded(arm.n)), dq(padded(arm.n)), ddq(padded(arm.n)),
        torque(padded(arm.n)) {
    for (int i = 0; i < arm.n; ++i) start(arm, i);
  }

 private:
  // What no sample changes: the origins of links that only turn, the axes.
  void start(const Arm& arm, int i) {
    const JointConstants& joint = arm.joints[i];
    Twist& own = S[arm.first[i + 1] - 1];
    for (int k = 0; k < 3; ++k) {
      links[i].lever[k] = splat(joint.lever[k]);
      own.w[k] = splat(joint.prismatic ? 0.0 : joint.axis[k]);
      own.v[k] = splat(joint.prismatic ? joint.axis[k] : 0.0);
    }
  }
};

template <int A>
struct Kind {
  static constexpr int axis = A;
};

// Calls work(Kind<A>) with the A of the joint.
template <class Work>
inline void by_kind(const JointConstants& joint, Work&& work) {
  switch (joint.about) {
    case 0: return work(Kind<0>{});
    case 1: return work(Kind<1>{});
    case 2: return work(Kind<2>{});
    default: return work(Kind<GENERAL>{});
  }
}

ARMID_INLINE void cross(const V* a, const V* b, V* out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

ARMID_INLINE V dot(const V* a, const V* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// out += a x b, where b has no component but `single`, or any if that is GENERAL.
ARMID_INLINE void add_cross(const V* a, const V* b, int single, V* out) {
  switch (single) {
    case 0:
      out[1] += a[2] * b[0];
      out[2] -= a[1] * b[0];
      return;
    case 1:
      out[2] += a[0] * b[1];
      out[0] -= a[2] * b[1];
      return;
    case 2:
      out[0] += a[1] * b[2];
      out[1] -= a[0] * b[2];
      return;
    default:
      out[0] += a[1] * b[2] - a[2] * b[1];
      out[1] += a[2] * b[0] - a[0] * b[2];
      out[2] += a[0] * b[1] - a[1] * b[0];
  }
}

// A vector of the parent's frame in the rest frame.
ARMID_INLINE void to_rest(const JointConstants& joint, const V* x, V* out) {
  for (int k = 0; k < 3; ++k) out[k] = flipped(x[joint.from[k]], joint.flip[k]);
}

// From the rest frame to the link's.
template <int A>
ARMID_INLINE void turn(const Link& link, const V* x, V* out) {
  if constexpr (A == GENERAL) {
    for (int k = 0; k < 3; ++k) out[k] = link.R[k] * x[0] + link.R[3 + k] * x[1] + link.R[6 + k] * x[2];
  } else {
    constexpr int B = (A + 1) % 3, C = (A + 2) % 3;
    out[A] = x[A];
    out[B] = link.cosine * x[B] + link.sine * x[C];
    out[C] = link.cosine * x[C] - link.sine * x[B];
  }
}

// From the link's frame to the rest frame.
template <int A>
ARMID_INLINE void turn_back(const Link& link, const V* x, V* out) {
  if constexpr (A == GENERAL) {
    for (int k = 0; k < 3; ++k) out[k] = dot(link.R + 3 * k, x);
  } else {
    constexpr int B = (A + 1) % 3, C = (A + 2) % 3;
    out[A] = x[A];
    out[B] = link.cosine * x[B] - link.sine * x[C];
    out[C] = link.cosine * x[C] + link.sine * x[B];
  }
}

template <int A>
inline void place(const JointConstants& joint, V q, Link& link) {
  V s = {}, c = splat(1.0);
  if (joint.prismatic) {
    for (int k = 0; k < 3; ++k) link.lever[k] = joint.lever[k] + q * joint.slide[k];
  } else {
    sincos(q, s, c);
  }
  if constexpr (A == GENERAL) {
    for (int k = 0; k < 9; ++k) link.R[k] = joint.along[k] + s * joint.cross[k] + c * joint.across[k];
  } else {
    link.sine = s * joint.sense;
    link.cosine = c;
  }
}

// What a joint adds to the acceleration along and about its axis, and by turning (rate) under velocity w.
template <int A>
ARMID_INLINE void add_joint(const JointConstants& joint, const V* w, V rate, V ddq, V* acceleration) {
  if constexpr (A == GENERAL) {
    const V axis[3] = {splat(joint.axis[0]), splat(joint.axis[1]), splat(joint.axis[2])};
    V turned[3];
    cross(w, axis, turned);
    for (int k = 0; k < 3; ++k) acceleration[k] += rate * turned[k] + ddq * axis[k];
  } else {
    constexpr int B = (A + 1) % 3, C = (A + 2) % 3;
    rate *= joint.sense;
    acceleration[A] += ddq * joint.sense;
    acceleration[B] += rate * w[C];
    acceleration[C] -= rate * w[B];
  }
}

template <int A>
ARMID_INLINE void move(const Arm& arm, const JointConstants& joint, const Link* parent, V dq, V ddq, Link& link) {
  V w[3] = {}, dw[3] = {}, a[3], rest[3];
  if (parent == nullptr) {
    const V base[3] = {splat(-arm.gravity[0]), splat(-arm.gravity[1]), splat(-arm.gravity[2])};
    to_rest(joint, base, rest);
    turn<A>(link, rest, a);
  } else {
    V w_rest[3], dw_rest[3], tip[3] = {};
    to_rest(joint, parent->w, w_rest);
    to_rest(joint, parent->dw, dw_rest);
    to_rest(joint, parent->a, rest);
    add_cross(w_rest, link.lever, joint.single, tip);
    add_cross(dw_rest, link.lever, joint.single, rest);
    add_cross(w_rest, tip, GENERAL, rest);
    turn<A>(link, w_rest, w);
    turn<A>(link, dw_rest, dw);
    turn<A>(link, rest, a);
  }
  if (joint.prismatic) {
    add_joint<A>(joint, w, 2.0 * dq, ddq, a);
  } else {
    add_joint<A>(joint, w, dq, ddq, dw);
    if constexpr (A == GENERAL) {
      for (int k = 0; k < 3; ++k) w[k] += dq * joint.axis[k];
    } else {
      w[A] += dq * joint.sense;
    }
  }
  for (int k = 0; k < 3; ++k) {
    link.w[k] = w[k];
    link.dw[k] = dw[k];
    link.a[k] = a[k];
  }
}

// Columns of the body Jacobian of link i but its own, which is the axis.
template <int A>
ARMID_INLINE void jacobian(const Arm& arm, int i, State& state) {
  const JointConstants& joint = arm.joints[i];
  if (joint.parent < 0) return;
  const Link& link = state.links[i];
  const Twist* from = &state.S[arm.first[joint.parent]];
  Twist* to = &state.S[arm.first[i]];
  const int count = arm.first[joint.parent + 1] - arm.first[joint.parent];
  for (int pair = 0; pair < count; ++pair) {
    V w[3], v[3], own_w[3], own_v[3];
    to_rest(joint, from[pair].w, w);
    to_rest(joint, from[pair].v, v);
    add_cross(w, link.lever, joint.single, v);
    turn<A>(link, w, own_w);
    turn<A>(link, v, own_v);
    for (int k = 0; k < 3; ++k) {  // last, for no store must come between loads that are the same to the next
      to[pair].w[k] = own_w[k];
      to[pair].v[k] = own_v[k];
    }
  }
}

// A moment m and force f at the link's origin, added to those at the parent's, in the parent's frame.
template <int A>
ARMID_INLINE void add_to_parent(const JointConstants& joint, const Link& link, const V* m, const V* f, V* moment,
                                V* force) {
  V m_rest[3], f_rest[3], lever[3];
  turn_back<A>(link, m, m_rest);
  turn_back<A>(link, f, f_rest);
  cross(link.lever, f_rest, lever);
  for (int k = 0; k < 3; ++k) {
    moment[joint.from[k]] += flipped(m_rest[k] + lever[k], joint.flip[k]);
    force[joint.from[k]] += flipped(f_rest[k], joint.flip[k]);
  }
}

}  // namespace armid::ARMID_ISA
