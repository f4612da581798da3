// A lane type: W samples side by side in one register, the same source for every instruction set.
//
// ARMID_ISA names the instruction set this translation unit is compiled for, ARMID_LANES its native width. Lanes
// wider than the machine's registers spill and cost a factor of three, so the width follows the instruction set.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <new>

// For what must be inlined to keep its vectors in registers.
#define ARMID_INLINE [[gnu::always_inline]] inline

// Lanes of a and b by index, those of b counted after those of a; GCC before 12 has no name for it that Clang knows.
#ifdef __clang__
#define ARMID_SHUFFLE(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define ARMID_SHUFFLE(a, b, ...) __builtin_shuffle(a, b, I{__VA_ARGS__})
#endif

namespace armid::ARMID_ISA {

constexpr int W = ARMID_LANES;

typedef double V __attribute__((vector_size(8 * ARMID_LANES)));
typedef std::int64_t I __attribute__((vector_size(8 * ARMID_LANES)));

inline V splat(double x) { return V{} + x; }

inline V load(const double* p) {
  V v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

inline void store(double* p, V v) { std::memcpy(p, &v, sizeof v); }

inline I bits(V v) {
  I i;
  std::memcpy(&i, &v, sizeof v);
  return i;
}

// x with its sign changed where `sign` has the sign bit set.
inline V flipped(V x, I sign) {
  const I i = bits(x) ^ sign;
  std::memcpy(&x, &i, sizeof x);
  return x;
}
inline V flipped(V x, std::int64_t sign) { return flipped(x, I{} + sign); }

inline V choose(I mask, V yes, V no) { return mask ? yes : no; }

// Zeroed scratch memory aligned for V.
template <class T>
class Buffer {
 public:
  explicit Buffer(std::size_t size) : data_(nullptr) {
    const std::size_t bytes = (size * sizeof(T) + 63) / 64 * 64 + 64;
    data_ = static_cast<T*>(::operator new(bytes, std::align_val_t{64}));  // Windows has no aligned_alloc
    std::memset(static_cast<void*>(data_), 0, bytes);
  }
  ~Buffer() { ::operator delete(data_, std::align_val_t{64}); }
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;
  T& operator[](std::size_t i) { return data_[i]; }
  const T& operator[](std::size_t i) const { return data_[i]; }
  T* data() { return data_; }

 private:
  T* data_;
};

constexpr std::ptrdiff_t smaller(std::ptrdiff_t a, std::ptrdiff_t b) { return a < b ? a : b; }
constexpr std::ptrdiff_t larger(std::ptrdiff_t a, std::ptrdiff_t b) { return a > b ? a : b; }

// Smallest multiple of the lane width that holds `count` samples.
inline int padded(std::ptrdiff_t count) { return static_cast<int>((count + W - 1) / W * W); }

inline bool any(I mask) {
  std::int64_t all = 0;
  for (int l = 0; l < W; ++l) all |= mask[l];
  return all != 0;
}

inline double sum(V v) {
  double total = 0.0;
  for (int l = 0; l < W; ++l) total += v[l];
  return total;
}

// [a0+a1, b0+b1, a2+a3, b2+b3, ...]: halves the number of values still to be summed in each of a and b.
inline V pair_sums(V a, V b) {
#if ARMID_LANES == 8
  return ARMID_SHUFFLE(a, b, 0, 8, 2, 10, 4, 12, 6, 14) + ARMID_SHUFFLE(a, b, 1, 9, 3, 11, 5, 13, 7, 15);
#elif ARMID_LANES == 4
  return ARMID_SHUFFLE(a, b, 0, 4, 2, 6) + ARMID_SHUFFLE(a, b, 1, 5, 3, 7);
#else
  return ARMID_SHUFFLE(a, b, 0, 2) + ARMID_SHUFFLE(a, b, 1, 3);
#endif
}

// Blocks of D lanes change places: the odd ones of a with the even ones of b.
template <int D>
inline void exchange(V& a, V& b) {
  const V x = a, y = b;
#if ARMID_LANES == 8
  if constexpr (D == 4) {
    a = ARMID_SHUFFLE(x, y, 0, 1, 2, 3, 8, 9, 10, 11);
    b = ARMID_SHUFFLE(x, y, 4, 5, 6, 7, 12, 13, 14, 15);
  } else if constexpr (D == 2) {
    a = ARMID_SHUFFLE(x, y, 0, 1, 8, 9, 4, 5, 12, 13);
    b = ARMID_SHUFFLE(x, y, 2, 3, 10, 11, 6, 7, 14, 15);
  } else {
    a = ARMID_SHUFFLE(x, y, 0, 8, 2, 10, 4, 12, 6, 14);
    b = ARMID_SHUFFLE(x, y, 1, 9, 3, 11, 5, 13, 7, 15);
  }
#elif ARMID_LANES == 4
  if constexpr (D == 2) {
    a = ARMID_SHUFFLE(x, y, 0, 1, 4, 5);
    b = ARMID_SHUFFLE(x, y, 2, 3, 6, 7);
  } else {
    a = ARMID_SHUFFLE(x, y, 0, 4, 2, 6);
    b = ARMID_SHUFFLE(x, y, 1, 5, 3, 7);
  }
#else
  a = ARMID_SHUFFLE(x, y, 0, 2);
  b = ARMID_SHUFFLE(x, y, 1, 3);
#endif
}

// x[l][k] <- x[k][l] for W registers.
template <int D = W / 2>
inline void transpose(V* x) {
#pragma GCC unroll 8
  for (int l = 0; l < W; ++l) {
    if (!(l & D)) exchange<D>(x[l], x[l + D]);
  }
  if constexpr (D > 1) transpose<D / 2>(x);
}

// Sums of four vectors: out[k] = sum(v_k).
inline void sum4(V a, V b, V c, V d, double* out) {
#if ARMID_LANES == 2
  const V ab = pair_sums(a, b), cd = pair_sums(c, d);
  store(out, ab);
  store(out + 2, cd);
#elif ARMID_LANES == 4
  const V ab = pair_sums(a, b), cd = pair_sums(c, d);  // a01 b01 a23 b23
  store(out, ARMID_SHUFFLE(ab, cd, 0, 1, 4, 5) + ARMID_SHUFFLE(ab, cd, 2, 3, 6, 7));
#else
  const V ab = pair_sums(a, b), cd = pair_sums(c, d);
  const V s = ARMID_SHUFFLE(ab, cd, 0, 1, 8, 9, 4, 5, 12, 13) + ARMID_SHUFFLE(ab, cd, 2, 3, 10, 11, 6, 7, 14, 15);
  const V t = s + ARMID_SHUFFLE(s, s, 4, 5, 6, 7, 0, 1, 2, 3);
  std::memcpy(out, &t, 4 * sizeof(double));
#endif
}

// Sine and cosine of W angles: reduction by multiples of pi/2 in three exact parts [Cody1980], then minimax
// polynomials on [-pi/4, pi/4] (Cephes). Within 1.5 ulp for |x| < 1e5; larger angles go through the C library.
inline void sincos(V x, V& s, V& c) {
  const V magic = splat(6755399441055744.0);  // 1.5 * 2^52: adding it rounds to an integer in the low bits
  const V shifted = x * 0.63661977236758134308 + magic;
  const V k = shifted - magic;
  V r = x - k * 1.57079625129699707031e+00;
  r = r - k * 7.54978941586159635335e-08;
  r = r - k * 5.39030285815811905290e-15;
  const V z = r * r;
  // clang-format off
  const V ps = ((((1.58962301576546568060e-10 * z - 2.50507477628578072866e-8) * z + 2.75573136213857245213e-6) * z -
                 1.98412698295895385996e-4) * z + 8.33333333332211858878e-3) * z - 1.66666666666666307295e-1;
  const V pc = ((((-1.13585365213876817300e-11 * z + 2.08757008419747316778e-9) * z - 2.75573141792967388112e-7) * z +
                 2.48015872888517045348e-5) * z - 1.38888888888730564116e-3) * z + 4.16666666666665929218e-2;
  // clang-format on
  const V sr = r + r * z * ps;
  const V cr = 1.0 - 0.5 * z + z * z * pc;
  const I quadrant = bits(shifted);
  const I odd = (quadrant & 1) != 0;
  // Bit 1 of the quadrant, moved to the sign, changes it; the cosine is a quadrant ahead.
  const I top = I{} + std::numeric_limits<std::int64_t>::min();
  s = flipped(choose(odd, cr, sr), (quadrant << 62) & top);
  c = flipped(choose(odd, sr, cr), ((quadrant + 1) << 62) & top);
  if (__builtin_expect(any(x * x >= 1e10), 0)) {
    for (int l = 0; l < W; ++l) {
      s[l] = std::sin(x[l]);
      c[l] = std::cos(x[l]);
    }
  }
}

}  // namespace armid::ARMID_ISA
