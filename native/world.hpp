// Rigid-body dynamics in the base frame, W states at a time: mass matrix, bias torque, and the derivatives of inverse
// dynamics. Spatial quantities are taken at the origin of the base, angular part first, so that none has to be moved
// from link to link. The derivatives are those of [Singh2022]: O(n²), and exact for any tree.
#pragma once

#include "regressor.hpp"

namespace armid::ARMID_ISA {

// A link, then all links that it carries: its body quantities become composite ones on the way from tips to base.
struct Body {
  V R[9], p[3];            // pose
  V axis_w[3], axis_v[3];  // twist for unit velocity of its joint
  V w[3], v[3];            // velocity
  V aw[3], av[3];          // acceleration less gravity
  V rate_w[3], rate_v[3];  // velocity of the parent x axis
  V bend_w[3], bend_v[3];  // acceleration of the parent x axis + velocity of the parent x rate
  V m, h[3], J[6];         // mass, first moment, inertia
  V n[3], f[3];            // moment and force
  V B[9], P[3];            // Coriolis term: moment B a + a x 0, force a x P, for a motion with angular part a
};

ARMID_INLINE void add_crossed(const V* a, const V* b, V* out) { add_cross(a, b, GENERAL, out); }

ARMID_INLINE void rotate(const V* R, const V* x, V* out) {
  for (int r = 0; r < 3; ++r) out[r] = R[3 * r] * x[0] + R[3 * r + 1] * x[1] + R[3 * r + 2] * x[2];
}

ARMID_INLINE void times_symmetric(const V* J, const V* x, V* out) {
  out[0] = J[0] * x[0] + J[1] * x[1] + J[3] * x[2];
  out[1] = J[1] * x[0] + J[2] * x[1] + J[4] * x[2];
  out[2] = J[3] * x[0] + J[4] * x[1] + J[5] * x[2];
}

// Moment and force of a body for a motion (w, v): its momentum where that is a velocity.
ARMID_INLINE void times_inertia(const Body& body, const V* w, const V* v, V* moment, V* force) {
  V turned[3];
  times_symmetric(body.J, w, moment);
  add_crossed(body.h, v, moment);
  cross(w, body.h, turned);
  for (int k = 0; k < 3; ++k) force[k] = body.m * v[k] + turned[k];
}

inline void place_in_base(const JointConstants& joint, const Body* parent, V q, Body& body) {
  V s = {}, c = splat(1.0), turn[9], from_parent[3];
  if (!joint.prismatic) sincos(q, s, c);
  for (int k = 0; k < 9; ++k) turn[k] = joint.along[k] + s * joint.cross[k] + c * joint.across[k];
  for (int k = 0; k < 3; ++k) {
    V lever = splat(joint.lever[k]);
    if (joint.prismatic) lever += q * joint.slide[k];
    from_parent[joint.from[k]] = flipped(lever, joint.flip[k]);
  }
  if (parent == nullptr) {
    for (int k = 0; k < 9; ++k) body.R[k] = turn[k];
    for (int k = 0; k < 3; ++k) body.p[k] = from_parent[k];
  } else {
    for (int r = 0; r < 3; ++r) {
      const V* row = parent->R + 3 * r;
      for (int k = 0; k < 3; ++k) body.R[3 * r + k] = row[0] * turn[k] + row[1] * turn[3 + k] + row[2] * turn[6 + k];
    }
    rotate(parent->R, from_parent, body.p);
    for (int k = 0; k < 3; ++k) body.p[k] += parent->p[k];
  }
  const V axis[3] = {splat(joint.axis[0]), splat(joint.axis[1]), splat(joint.axis[2])};
  V along[3];
  rotate(body.R, axis, along);
  cross(body.p, along, body.axis_v);
  for (int k = 0; k < 3; ++k) {
    body.axis_w[k] = joint.prismatic ? V{} : along[k];
    if (joint.prismatic) body.axis_v[k] = along[k];
  }
}

// Velocity and acceleration of a link, and the rates of its axis.
inline void move_in_base(const Arm& arm, const Body* parent, V dq, V ddq, Body& body) {
  V w[3] = {}, v[3] = {}, aw[3] = {}, av[3];
  for (int k = 0; k < 3; ++k) {
    if (parent != nullptr) {
      w[k] = parent->w[k];
      v[k] = parent->v[k];
      aw[k] = parent->aw[k];
    }
    av[k] = parent == nullptr ? splat(-arm.gravity[k]) : parent->av[k];
  }
  cross(w, body.axis_w, body.rate_w);
  cross(w, body.axis_v, body.rate_v);
  add_crossed(v, body.axis_w, body.rate_v);
  cross(aw, body.axis_w, body.bend_w);
  cross(aw, body.axis_v, body.bend_v);
  add_crossed(av, body.axis_w, body.bend_v);
  add_crossed(w, body.rate_w, body.bend_w);
  add_crossed(w, body.rate_v, body.bend_v);
  add_crossed(v, body.rate_w, body.bend_v);
  for (int k = 0; k < 3; ++k) {
    body.w[k] = w[k] + dq * body.axis_w[k];
    body.v[k] = v[k] + dq * body.axis_v[k];
    body.aw[k] = aw[k] + ddq * body.axis_w[k] + dq * body.rate_w[k];
    body.av[k] = av[k] + ddq * body.axis_v[k] + dq * body.rate_v[k];
  }
}

// Inertia of a link with ten parameters about its own origin, now about the base's; and its moment and force. The
// parameters are the same in all lanes, or a V each where lanes hold different links.
template <class Number>
inline void load_body(const Number* inertial, Body& body) {
  const V* R = body.R;
  const V* p = body.p;
  const Number I[9] = {inertial[4], inertial[5], inertial[7], inertial[5], inertial[6],
                       inertial[8], inertial[7], inertial[8], inertial[9]};
  V turned[9], own[3];
  for (int r = 0; r < 3; ++r) {
    for (int k = 0; k < 3; ++k) turned[3 * r + k] = R[3 * r] * I[k] + R[3 * r + 1] * I[3 + k] + R[3 * r + 2] * I[6 + k];
    own[r] = R[3 * r] * inertial[1] + R[3 * r + 1] * inertial[2] + R[3 * r + 2] * inertial[3];
  }
  body.m = V{} + inertial[0];
  const V diagonal = inertial[0] * dot(p, p) + 2.0 * dot(p, own);
  int e = 0;
  for (int r = 0; r < 3; ++r) {
    for (int k = 0; k <= r; ++k) {
      body.J[e] = dot(turned + 3 * r, R + 3 * k) - inertial[0] * p[r] * p[k] - p[r] * own[k] - own[r] * p[k];
      if (k == r) body.J[e] += diagonal;
      ++e;
    }
  }
  for (int k = 0; k < 3; ++k) body.h[k] = own[k] + inertial[0] * p[k];
  V L[3];
  times_inertia(body, body.w, body.v, L, body.P);
  times_inertia(body, body.aw, body.av, body.n, body.f);
  add_crossed(body.w, L, body.n);
  add_crossed(body.v, body.P, body.n);
  add_crossed(body.w, body.P, body.f);
}

// Coriolis term of a body [Singh2022], which acts on the angular part of a motion only.
inline void load_coriolis(Body& body) {
  const V* w = body.w;
  const V half = 0.5 * (body.J[0] + body.J[2] + body.J[5]), along = dot(body.v, body.h);
  V columns[9];
  for (int k = 0; k < 3; ++k) {
    const V unit[3] = {splat(k == 0 ? 1.0 : 0.0), splat(k == 1 ? 1.0 : 0.0), splat(k == 2 ? 1.0 : 0.0)};
    V turned[3];
    times_symmetric(body.J, unit, turned);
    turned[k] -= half;
    cross(w, turned, columns + 3 * k);
  }
  for (int r = 0; r < 3; ++r) {
    for (int k = 0; k < 3; ++k) body.B[3 * r + k] = columns[3 * k + r] - body.v[r] * body.h[k];
    body.B[4 * r] += along;
  }
}

// Moment and force of the carried links, added to those of the link that carries them.
inline void add_body(const Body& from, bool coriolis, Body& to) {
  to.m += from.m;
  for (int k = 0; k < 3; ++k) {
    to.h[k] += from.h[k];
    to.n[k] += from.n[k];
    to.f[k] += from.f[k];
  }
  for (int k = 0; k < 6; ++k) to.J[k] += from.J[k];
  if (!coriolis) return;
  for (int k = 0; k < 9; ++k) to.B[k] += from.B[k];
  for (int k = 0; k < 3; ++k) to.P[k] += from.P[k];
}

ARMID_INLINE V power(const V* w, const V* v, const V* moment, const V* force) { return dot(w, moment) + dot(v, force); }

// Places all links, moves them, and gives each its own inertia and force.
inline void load_all(const Arm& arm, const double* inertial, const V* q, const V* dq, const V* ddq, bool coriolis,
                     Body* bodies) {
  for (int i = 0; i < arm.n; ++i) {
    const int from = arm.joints[i].parent;
    const Body* parent = from < 0 ? nullptr : bodies + from;
    place_in_base(arm.joints[i], parent, q[i], bodies[i]);
    move_in_base(arm, parent, dq[i], ddq == nullptr ? V{} : ddq[i], bodies[i]);
    load_body(inertial + 10 * i, bodies[i]);
    if (coriolis) load_coriolis(bodies[i]);
  }
}

// Torque (n,) and mass matrix (n, n), zero at first, of links that `load_all` has loaded without Coriolis terms.
inline void torque_and_mass(const Arm& arm, Body* bodies, V* torque, V* M) {
  for (int i = arm.n - 1; i >= 0; --i) {
    Body& body = bodies[i];
    V moment[3], force[3];
    times_inertia(body, body.axis_w, body.axis_v, moment, force);
    for (int pair = arm.first[i]; pair < arm.first[i + 1]; ++pair) {
      const int j = arm.ancestor[pair];
      M[i * arm.n + j] = M[j * arm.n + i] = power(bodies[j].axis_w, bodies[j].axis_v, moment, force);
    }
    torque[i] = power(body.axis_w, body.axis_v, body.n, body.f);
    if (arm.joints[i].parent >= 0) add_body(body, false, bodies[arm.joints[i].parent]);
  }
}

// Mass matrix and the derivatives of the torque by positions and velocities, (n, n) each and zero at first, of links
// that `load_all` has loaded with Coriolis terms.
inline void torque_derivatives(const Arm& arm, Body* bodies, V* M, V* by_q, V* by_dq) {
  const int n = arm.n;
  for (int i = n - 1; i >= 0; --i) {
    Body& body = bodies[i];
    V moment[3], force[3], turned[3], row[3], q_n[3], q_f[3], dq_n[3], dq_f[3], tipped[3];
    times_inertia(body, body.axis_w, body.axis_v, moment, force);
    // 2 Bᵀ axis: what an angular motion of an ancestor gives this joint.
    for (int k = 0; k < 3; ++k) {
      row[k] = body.B[k] * body.axis_w[0] + body.B[3 + k] * body.axis_w[1] + body.B[6 + k] * body.axis_w[2];
    }
    add_crossed(body.P, body.axis_v, row);
    for (int k = 0; k < 3; ++k) row[k] *= 2.0;
    // What this joint gives its ancestors.
    times_inertia(body, body.bend_w, body.bend_v, q_n, q_f);
    times_inertia(body, body.rate_w, body.rate_v, dq_n, dq_f);
    rotate(body.B, body.rate_w, turned);
    rotate(body.B, body.axis_w, tipped);
    for (int k = 0; k < 3; ++k) {
      q_n[k] += 2.0 * turned[k];
      dq_n[k] = 2.0 * (dq_n[k] + tipped[k]);
      dq_f[k] *= 2.0;
    }
    V pushed[3];
    cross(body.rate_w, body.P, pushed);
    for (int k = 0; k < 3; ++k) q_f[k] += 2.0 * pushed[k];
    cross(body.axis_w, body.P, pushed);
    for (int k = 0; k < 3; ++k) dq_f[k] += 2.0 * pushed[k];
    add_crossed(body.axis_w, body.n, q_n);
    add_crossed(body.axis_v, body.f, q_n);
    add_crossed(body.axis_w, body.f, q_f);
    for (int pair = arm.first[i]; pair < arm.first[i + 1]; ++pair) {
      const int j = arm.ancestor[pair];
      const Body& from = bodies[j];
      M[i * n + j] = M[j * n + i] = power(from.axis_w, from.axis_v, moment, force);
      by_q[i * n + j] = dot(row, from.rate_w) + power(from.bend_w, from.bend_v, moment, force);
      by_dq[i * n + j] = dot(row, from.axis_w) + 2.0 * power(from.rate_w, from.rate_v, moment, force);
      by_q[j * n + i] = power(from.axis_w, from.axis_v, q_n, q_f);
      by_dq[j * n + i] = power(from.axis_w, from.axis_v, dq_n, dq_f);
    }
    if (arm.joints[i].parent >= 0) add_body(body, true, bodies[arm.joints[i].parent]);
  }
}

}  // namespace armid::ARMID_ISA
