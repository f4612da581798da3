// Torque laws of joints as programs on a stack, W states at a time, with derivatives by position and velocity.
#pragma once

#include "arm.hpp"
#include "lanes.hpp"

namespace armid::ARMID_ISA {

// Exponential of W numbers: reduction by multiples of ln 2 in two exact parts [Cody1980], then a rational function
// (Cephes). Within 2 ulp; below -708 it is 0, above 709 it stays there.
inline V exponential(V x) {
  const V low = splat(-708.0), high = splat(709.0);
  const V clamped = choose(x < low, low, choose(x > high, high, x));
  const V magic = splat(6755399441055744.0);
  const V shifted = clamped * 1.4426950408889634073599 + magic;
  const V k = shifted - magic;
  V r = clamped - k * 6.93145751953125e-1;
  r = r - k * 1.42860682030941723212e-6;
  const V z = r * r;
  const V p = r * ((1.26177193074810590878e-4 * z + 3.02994407707441961300e-2) * z + 9.99999999999999999910e-1);
  const V q = ((3.00198505138664455042e-6 * z + 2.52448340349684104192e-3) * z + 2.27265548208155028766e-1) * z +
              2.00000000000000000005e0;
  const V e = 1.0 + 2.0 * p / (q - p);
  const I exponent = (bits(shifted) << 52) + (I{} + (std::int64_t{1023} << 52));
  V power;
  std::memcpy(&power, &exponent, sizeof power);
  return choose(x < low, V{}, e * power);
}

inline V hyperbolic_tangent(V x) {
  const V size = choose(x < 0.0, -x, x);
  const V e = exponential(-2.0 * size);
  // Near zero the quotient would lose digits: a series takes its place.
  const V z = x * x;
  const V series = x * (1.0 - z * (1.0 / 3.0 - z * (2.0 / 15.0 - z * (17.0 / 315.0))));
  const V quotient = (1.0 - e) / (1.0 + e);
  return choose(size < 0.01, series, choose(x < 0.0, -quotient, quotient));
}

// A value and its derivatives by position and velocity of the law's coordinate.
struct Dual {
  V x, by_q, by_dq;
};

ARMID_INLINE Dual chained(V value, V slope, const Dual& inner) {
  return {value, slope * inner.by_q, slope * inner.by_dq};
}

inline V sign_of(V x) { return choose(x > 0.0, splat(1.0), choose(x < 0.0, splat(-1.0), V{})); }

// Which of two is chosen; where they are equal, half of each is.
ARMID_INLINE Dual chosen(V share, const Dual& a, const Dual& b) {
  const V other = 1.0 - share;
  return {share * a.x + other * b.x, share * a.by_q + other * b.by_q, share * a.by_dq + other * b.by_dq};
}

inline Dual raised(const Dual& a, double exponent) {
  if (exponent == 2.0) return chained(a.x * a.x, 2.0 * a.x, a);
  if (exponent == -1.0) return chained(1.0 / a.x, -1.0 / (a.x * a.x), a);
  V value, slope;
  for (int l = 0; l < W; ++l) {
    value[l] = std::pow(a.x[l], exponent);
    slope[l] = exponent * std::pow(a.x[l], exponent - 1.0);
    if (!std::isfinite(slope[l])) slope[l] = 0.0;  // |v|^1.5 and the like at rest
  }
  return chained(value, slope, a);
}

// Value of law `which` at position q and velocity dq of its coordinate. A sign is a line between -steep and steep, so
// that a joint which sticks has a velocity that can be solved for.
inline Dual law_value(const Laws& laws, int which, V q, V dq, double steep) {
  Dual stack[LAW_DEPTH];
  int top = -1;
  for (int k = laws.first[which]; k < laws.first[which + 1]; ++k) {
    const double constant = laws.constant[k];
    switch (laws.operation[k]) {
      case LAW_NUMBER: stack[++top] = {splat(constant), V{}, V{}}; break;
      case LAW_POSITION: stack[++top] = {q, splat(1.0), V{}}; break;
      case LAW_VELOCITY: stack[++top] = {dq, V{}, splat(1.0)}; break;
      case LAW_ADD: {
        const Dual &a = stack[top - 1], &b = stack[top];
        stack[top - 1] = {a.x + b.x, a.by_q + b.by_q, a.by_dq + b.by_dq};
        --top;
        break;
      }
      case LAW_MULTIPLY: {
        const Dual &a = stack[top - 1], &b = stack[top];
        stack[top - 1] = {a.x * b.x, a.by_q * b.x + a.x * b.by_q, a.by_dq * b.x + a.x * b.by_dq};
        --top;
        break;
      }
      case LAW_POWER: stack[top] = raised(stack[top], constant); break;
      case LAW_SIGN: {
        const V x = stack[top].x / steep;
        const I inside = (x < 1.0) & (x > -1.0);
        stack[top] = chained(choose(inside, x, sign_of(x)), choose(inside, splat(1.0 / steep), V{}), stack[top]);
        break;
      }
      case LAW_TANH: {
        const V x = hyperbolic_tangent(stack[top].x);
        stack[top] = chained(x, 1.0 - x * x, stack[top]);
        break;
      }
      case LAW_ABSOLUTE: {
        const V s = sign_of(stack[top].x);
        stack[top] = chained(s * stack[top].x, s, stack[top]);
        break;
      }
      case LAW_EXPONENTIAL: {
        const V x = exponential(stack[top].x);
        stack[top] = chained(x, x, stack[top]);
        break;
      }
      case LAW_SINE:
      case LAW_COSINE: {
        V s, c;
        sincos(stack[top].x, s, c);
        stack[top] = laws.operation[k] == LAW_SINE ? chained(s, c, stack[top]) : chained(c, -s, stack[top]);
        break;
      }
      case LAW_LARGER:
      case LAW_SMALLER: {
        const Dual &a = stack[top - 1], &b = stack[top];
        const V share = 0.5 * (1.0 + sign_of(laws.operation[k] == LAW_LARGER ? a.x - b.x : b.x - a.x));
        stack[top - 1] = chosen(share, a, b);
        --top;
        break;
      }
    }
  }
  return stack[0];
}

}  // namespace armid::ARMID_ISA
