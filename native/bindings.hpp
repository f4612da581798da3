// What the bindings share: arrays, the choice of the instruction set, and arms.
//
// Only the bindings include this file, which are compiled for any machine; so inline functions are safe here.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#include "kernel.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace armid {

template <class T>
using In = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;
template <class T>
using Out = nb::ndarray<T, nb::c_contig, nb::device::cpu>;

// Kernels this machine can run, widest first.
inline const std::vector<const Kernel*>& kernels() {
  static const std::vector<const Kernel*> usable = [] {
    std::vector<const Kernel*> found;
#ifdef ARMID_X86
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
        __builtin_cpu_supports("avx512bw"))
      found.push_back(&kernel_avx512);
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) found.push_back(&kernel_avx2);
#endif
    found.push_back(&kernel_baseline);
    return found;
  }();
  return usable;
}

inline const Kernel& kernel(const std::string& isa) {
  for (const Kernel* k : kernels()) {
    if (isa == k->name) return *k;
  }
  throw std::invalid_argument("this machine cannot run the kernel '" + isa + "'");
}

// An argument of a bound function. Arrays are never converted: a copy of an output would take the result, and a copy of
// indices could change them.
template <class T>
struct Argument {
  static auto make() { return nb::arg(); }
};
template <class T, class... More>
struct Argument<nb::ndarray<T, More...>> {
  static auto make() { return nb::arg().noconvert(); }
};

// Adds a function to the module; arrays of another type or with strides are a TypeError.
template <class Result, class... Arguments>
void bind(nb::module_& m, const char* name, Result (*function)(Arguments...)) {
  m.def(name, function, Argument<std::remove_cv_t<std::remove_reference_t<Arguments>>>::make()...);
}

inline void require(bool ok, const char* what) {
  if (!ok) throw std::invalid_argument(what);
}

// Owns what an Arm points to.
struct ArmData {
  std::vector<JointConstants> joints;
  std::vector<std::int32_t> first{0}, ancestor;
  Arm arm{};

  ArmData(In<std::int32_t> parent, In<std::uint8_t> prismatic, In<double> axis, In<double> rotation,
          In<double> translation, In<double> gravity) {
    const int n = static_cast<int>(parent.size());
    require(n > 0 && prismatic.size() == parent.size() && axis.size() == 3 * parent.size() &&
                rotation.size() == 9 * parent.size() && translation.size() == 3 * parent.size() && gravity.size() == 3,
            "the arrays of a tree must have one entry a joint");
    for (int i = 0; i < n; ++i) {
      const int p = parent.data()[i];
      require(-1 <= p && p < i, "parents must stand before their children");
      joints.push_back(constants(p, prismatic.data()[i] != 0, axis.data() + 3 * i, rotation.data() + 9 * i,
                                 translation.data() + 3 * i));
      for (int k = p < 0 ? 0 : first[p]; k < (p < 0 ? 0 : first[p + 1]); ++k) ancestor.push_back(int{ancestor[k]});
      ancestor.push_back(i);
      first.push_back(static_cast<std::int32_t>(ancestor.size()));
    }
    arm.n = n;
    arm.joints = joints.data();
    std::copy_n(gravity.data(), 3, arm.gravity);
    arm.first = first.data();
    arm.ancestor = ancestor.data();
  }
  ArmData(const ArmData&) = delete;

  // The rotation at q, R (a aᵀ + sin(q) S(a) + cos(q) (1 - a aᵀ)) for a unit axis a, split into its three parts.
  static JointConstants constants(int parent, bool prismatic, const double* a, const double* R, const double* p) {
    JointConstants c{};
    c.parent = parent;
    c.prismatic = prismatic;
    c.about = GENERAL;
    const double S[9] = {0, -a[2], a[1], a[2], 0, -a[0], -a[1], a[0], 0};
    for (int r = 0; r < 3; ++r) {
      c.axis[r] = a[r];
      c.from[r] = r;
      c.lever[r] = p[r];
      c.slide[r] = R[3 * r] * a[0] + R[3 * r + 1] * a[1] + R[3 * r + 2] * a[2];
    }
    for (int r = 0; r < 3; ++r) {
      for (int k = 0; k < 3; ++k) {
        c.along[3 * r + k] = c.slide[r] * a[k];
        c.cross[3 * r + k] = R[3 * r] * S[k] + R[3 * r + 1] * S[3 + k] + R[3 * r + 2] * S[6 + k];
        c.across[3 * r + k] = R[3 * r + k] - c.along[3 * r + k];
      }
    }
    if (is_square(a, 1) && is_square(R, 3)) make_square(c, a, R, p);
    int reaching = 0;
    for (int k = 0; k < 3; ++k) {
      if (c.lever[k] == 0.0 && !(prismatic && c.slide[k] != 0.0)) continue;
      c.single = k;
      ++reaching;
    }
    if (reaching > 1) c.single = GENERAL;
    return c;
  }

  // Whether `rows` orthonormal rows hold nothing but 0 and ±1, to the rounding of quarter turns' sines.
  static bool is_square(const double* x, int rows) {
    return std::all_of(x, x + 3 * rows, [](double e) { return std::abs(std::remainder(e, 1.0)) <= 1e-15; });
  }

  static void make_square(JointConstants& c, const double* a, const double* R, const double* p) {
    for (int k = 0; k < 3; ++k) {
      if (std::abs(a[k]) > 0.5) c.about = k;
      for (int r = 0; r < 3; ++r) {
        if (std::abs(R[3 * r + k]) < 0.5) continue;
        c.from[k] = r;
        c.flip[k] = R[3 * r + k] < 0.0 ? std::numeric_limits<std::int64_t>::min() : 0;
        c.lever[k] = R[3 * r + k] < 0.0 ? -p[r] : p[r];
      }
    }
    c.sense = a[c.about] < 0.0 ? -1.0 : 1.0;
    for (int k = 0; k < 3; ++k) c.slide[k] = k == c.about ? c.sense : 0.0;
  }
};

// Columns wanted of each joint; owns nothing.
inline Layout layout_of(const ArmData& data, const In<std::int32_t>& offset, const In<std::int32_t>& target,
                        const In<std::int32_t>& term) {
  const int n = data.arm.n;
  require(offset.size() == static_cast<std::size_t>(n) + 1, "offset must have n + 1 entries");
  require(offset.data()[0] == 0, "offset must begin with 0");
  for (int j = 0; j < n; ++j) {
    require(offset.data()[j] < offset.data()[j + 1], "each joint needs a column, that of its torque");
  }
  require(target.size() == 0 || target.size() == 10 * data.ancestor.size(), "target must have ten entries a pair");
  for (std::size_t k = 0; k < target.size(); ++k) {
    const int j = data.ancestor[k / 10];
    require(target.data()[k] < offset.data()[j + 1] - offset.data()[j] - 1,
            "a target lies outside its joint's columns");
  }
  for (std::size_t k = 0; k < term.size(); ++k) {
    require(0 <= term.data()[k] && term.data()[k] < offset.data()[n], "a term's column lies outside the layout");
  }
  return {offset.data(), target.size() ? target.data() : nullptr, term.data(), static_cast<int>(term.size())};
}

// Adds the functions of the roll-out to the module.
void bind_rollout(nb::module_& m);

// Adds the passes over the channels of recordings to the module.
void bind_channels(nb::module_& m);

}  // namespace armid
