// Forward recursion: velocity and acceleration of every link, W samples at a time.
//
// Frames: E maps from the parent's frame to the link's. `a` is the acceleration of the link's origin less gravity, so
// that the base "accelerates" with -g. S[pair] is the velocity of link i for unit velocity of its ancestor j, seen
// and taken at the origin of link i: the columns of the body Jacobian, from which rows of the regressor are dot
// products [Featherstone2008].
#pragma once

#include "arm.hpp"
#include "lanes.hpp"

namespace armid::ARMID_ISA {

struct Link {
  V R[9], p[3];          // placement in the parent's frame
  V w[3], dw[3], a[3];   // angular velocity and acceleration, acceleration of the origin less gravity
};

struct Twist {
  V w[3], v[3];
};

struct State {
  Buffer<Link> links;
  Buffer<Twist> S;

  explicit State(const Arm& arm) : links(arm.n), S(arm.first[arm.n]) {}
};

inline void cross(const V* a, const V* b, V* out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

inline V dot(const V* a, const V* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// out = Rᵀ x
inline void to_link(const V* R, const V* x, V* out) {
  for (int k = 0; k < 3; ++k) out[k] = R[k] * x[0] + R[3 + k] * x[1] + R[6 + k] * x[2];
}

// out = R x
inline void to_parent(const V* R, const V* x, V* out) {
  for (int k = 0; k < 3; ++k) out[k] = R[3 * k] * x[0] + R[3 * k + 1] * x[1] + R[3 * k + 2] * x[2];
}

inline void place(const JointConstants& joint, V q, Link& link) {
  if (joint.prismatic) {
    for (int k = 0; k < 9; ++k) link.R[k] = splat(joint.along[k] + joint.across[k]);
    for (int k = 0; k < 3; ++k) link.p[k] = joint.position[k] + q * joint.slide[k];
  } else {
    V s, c;
    sincos(q, s, c);
    for (int k = 0; k < 9; ++k) link.R[k] = joint.along[k] + s * joint.cross[k] + c * joint.across[k];
    for (int k = 0; k < 3; ++k) link.p[k] = splat(joint.position[k]);
  }
}

inline void move(const Arm& arm, const JointConstants& joint, const Link* parent, V dq, V ddq, Link& link) {
  const V axis[3] = {splat(joint.axis[0]), splat(joint.axis[1]), splat(joint.axis[2])};
  V w[3] = {}, dw[3] = {}, a[3];
  if (parent == nullptr) {
    const V base[3] = {splat(-arm.gravity[0]), splat(-arm.gravity[1]), splat(-arm.gravity[2])};
    to_link(link.R, base, a);
  } else {
    V inner[3], outer[3], sum[3];
    cross(parent->w, link.p, inner);
    cross(parent->w, inner, outer);
    cross(parent->dw, link.p, inner);
    for (int k = 0; k < 3; ++k) sum[k] = parent->a[k] + inner[k] + outer[k];
    to_link(link.R, sum, a);
    to_link(link.R, parent->w, w);
    to_link(link.R, parent->dw, dw);
  }
  V turn[3];
  cross(w, axis, turn);
  for (int k = 0; k < 3; ++k) {
    if (joint.prismatic) {
      link.w[k] = w[k];
      link.dw[k] = dw[k];
      link.a[k] = a[k] + 2.0 * dq * turn[k] + ddq * axis[k];
    } else {
      link.w[k] = w[k] + dq * axis[k];
      link.dw[k] = dw[k] + dq * turn[k] + ddq * axis[k];
      link.a[k] = a[k];
    }
  }
}

// Columns of the body Jacobian of link i.
inline void jacobian(const Arm& arm, int i, State& state) {
  const JointConstants& joint = arm.joints[i];
  const Link& link = state.links[i];
  Twist* own = &state.S[arm.first[i]];
  if (joint.parent >= 0) {
    const Twist* carried = &state.S[arm.first[joint.parent]];
    const int count = arm.first[joint.parent + 1] - arm.first[joint.parent];
    for (int k = 0; k < count; ++k) {
      V v[3];
      cross(carried[k].w, link.p, v);
      for (int d = 0; d < 3; ++d) v[d] += carried[k].v[d];
      to_link(link.R, carried[k].w, own[k].w);
      to_link(link.R, v, own[k].v);
    }
    own += count;
  }
  for (int d = 0; d < 3; ++d) {
    own->w[d] = splat(joint.prismatic ? 0.0 : joint.axis[d]);
    own->v[d] = splat(joint.prismatic ? joint.axis[d] : 0.0);
  }
}

}  // namespace armid::ARMID_ISA
