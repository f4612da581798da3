// Passes over the channels of a recording, one row of n values a sample: zero-phase filters with derivatives, speeds
// over a span, and third differences.
//
// Lanes are channels, because a recursion has only one time. A register group of G W channels is read from each row;
// what it reads beyond its channels is never stored.
#pragma once

#include "lanes.hpp"
#include "signals.hpp"

namespace armid::ARMID_ISA {

template <int G>
struct Group {
  V v[G];
};

// Rows of the channels from..from + width of x (N, n).
template <int G>
class Rows {
 public:
  Rows(const Channels& x, int from, int width) : x_(x.values + from), n_(x.n), samples_(x.samples), width_(width) {
    const std::ptrdiff_t beyond = from + G * W - x.n;  // values that the last row would read beyond the array
    whole_ = beyond <= 0 ? samples_ : samples_ - (beyond + n_ - 1) / n_;
  }

  Group<G> row(std::ptrdiff_t s) const {
    Group<G> r;
    if (s < whole_) {
      for (int g = 0; g < G; ++g) r.v[g] = load(x_ + s * n_ + g * W);
      return r;
    }
    double part[G * W] = {};
    std::memcpy(part, x_ + s * n_, sizeof(double) * width_);
    for (int g = 0; g < G; ++g) r.v[g] = load(part + g * W);
    return r;
  }

  // The same, continued at both ends by odd reflection.
  Group<G> reflected(std::ptrdiff_t s) const {
    if (s >= 0 && s < samples_) return row(s);
    const std::ptrdiff_t end = s < 0 ? 0 : samples_ - 1;
    Group<G> r = row(2 * end - s);
    const Group<G> pivot = row(end);
    for (int g = 0; g < G; ++g) r.v[g] = 2.0 * pivot.v[g] - r.v[g];
    return r;
  }

 private:
  const double* x_;
  std::ptrdiff_t n_, samples_, whole_;
  int width_;
};

template <int G>
inline void put(double* to, const Group<G>& r, int width) {
  double part[G * W];
  for (int g = 0; g < G; ++g) store(part + g * W, r.v[g]);
  for (int k = 0; k < width; ++k) to[k] = part[k];
}

// Zero-phase filter of rows [begin, end) with its states: second-order sections as state-variable filters with
// trapezoidal integrators, whose rounding does not grow where the cut-off is a small share of the sample rate.
template <int G>
class Sections {
 public:
  explicit Sections(const Filter& filter) : filter_(filter), states_(2 * static_cast<std::size_t>(filter.count) * G) {}

  // As if the input had always been x.
  void settle(const Group<G>& x) {
    for (int k = 0; k < filter_.count; ++k) {
      for (int g = 0; g < G; ++g) {
        states_[(2 * k) * G + g] = V{};
        states_[(2 * k + 1) * G + g] = x.v[g];
      }
    }
  }

  // Replaces `count` successive values by filtered ones. Two sections at a time, so that they hide each other's
  // latency.
  void run(Group<G>* x, int count) {
    int k = 0;
    for (; k + 1 < filter_.count; k += 2) steps<2>(x, count, k);
    if (k < filter_.count) steps<1>(x, count, k);
  }

 private:
  template <int S>
  void steps(Group<G>* x, int count, int k) {
    V s1[S][G], s2[S][G], c1[S], c2[S], c3[S];
    for (int s = 0; s < S; ++s) {
      const double* c = filter_.sections + 3 * (k + s);
      c1[s] = splat(c[0]);
      c2[s] = splat(c[1]);
      c3[s] = splat(c[2]);
      for (int g = 0; g < G; ++g) {
        s1[s][g] = states_[2 * (k + s) * G + g];
        s2[s][g] = states_[(2 * (k + s) + 1) * G + g];
      }
    }
    for (int t = 0; t < count; ++t) {
      for (int s = 0; s < S; ++s) {
        for (int g = 0; g < G; ++g) {
          const V off = x[t].v[g] - s2[s][g];
          const V low = s2[s][g] + c2[s] * s1[s][g];
          s1[s][g] = c1[s] * s1[s][g] + c2[s] * off;
          const V next = low + c3[s] * off;
          x[t].v[g] = 0.5 * (s2[s][g] + next);
          s2[s][g] = next;
        }
      }
    }
    for (int s = 0; s < S; ++s) {
      for (int g = 0; g < G; ++g) {
        states_[2 * (k + s) * G + g] = s1[s][g];
        states_[(2 * (k + s) + 1) * G + g] = s2[s][g];
      }
    }
  }

  const Filter& filter_;
  Buffer<V> states_;
};

inline V not_below(double least, V x) { return choose((x < least) & (x > -least), V{}, x); }

constexpr int BLOCK = 64;  // samples that are filtered at a time

// Filtered samples [begin, end) of a group of channels, less the line through the first and last sample of the run,
// which passes unchanged. The recursion begins `reach` samples before and ends `reach` samples behind them.
template <int G>
class ZeroPhase {
 public:
  ZeroPhase(const Channels& x, const Filter& filter, int from, int width, std::ptrdiff_t most)
      : x_(x), rows_(x, from, width), filter_(filter), from_(from), width_(width),
        forward_(static_cast<std::size_t>(most + 2 + filter.reach) * G) {
    first_ = rows_.row(0);
    const Group<G> last = rows_.row(x.samples - 1);
    for (int g = 0; g < G; ++g) slope_.v[g] = (last.v[g] - first_.v[g]) / static_cast<double>(x.samples - 1);
  }

  void filter(std::ptrdiff_t begin, std::ptrdiff_t end, const Filtered& out) {
    // One sample more on each side, for the differences.
    const std::ptrdiff_t a = larger(begin - 1, 0), b = smaller(end + 1, x_.samples);
    const std::ptrdiff_t behind = b + filter_.reach;
    forwards(a, behind);
    backwards(a, b, behind, begin, end, out);
  }

 private:
  Group<G> centred(std::ptrdiff_t s) const {
    Group<G> r = rows_.reflected(s);
    for (int g = 0; g < G; ++g) r.v[g] -= first_.v[g] + slope_.v[g] * static_cast<double>(s);
    return r;
  }

  void forwards(std::ptrdiff_t a, std::ptrdiff_t behind) {
    Sections<G> sections(filter_);
    Group<G> block[BLOCK];
    std::ptrdiff_t s = larger(a - filter_.reach, -filter_.reach);
    sections.settle(centred(s));
    while (s < behind) {
      const int count = static_cast<int>(smaller(BLOCK, behind - s));
      for (int t = 0; t < count; ++t) block[t] = centred(s + t);
      sections.run(block, count);
      for (int t = 0; t < count; ++t) {
        if (s + t < a) continue;
        for (int g = 0; g < G; ++g) forward_[(s + t - a) * G + g] = block[t].v[g];
      }
      s += count;
    }
  }

  void backwards(std::ptrdiff_t a, std::ptrdiff_t b, std::ptrdiff_t behind, std::ptrdiff_t begin, std::ptrdiff_t end,
                 const Filtered& out) {
    Sections<G> sections(filter_);
    Group<G> block[2 + BLOCK];  // the last two filtered samples, and those that follow backwards in time
    sections.settle(stored(behind - 1 - a));
    for (std::ptrdiff_t s = behind; s > a;) {
      const int count = static_cast<int>(smaller(BLOCK, s - a));
      for (int t = 0; t < count; ++t) block[2 + t] = stored(s - 1 - t - a);
      sections.run(block + 2, count);
      for (int t = 0; t < count; ++t) {
        const std::ptrdiff_t at = s - 1 - t;
        if (at >= begin && at < end) value(at, block[2 + t], out);
        if (at + 1 >= begin && at + 1 < end && at + 2 < b) {
          slopes(at + 1, block[2 + t], block[1 + t], block[t], out);
        }
      }
      block[0] = block[count];
      block[1] = block[count + 1];
      s -= count;
    }
  }

  Group<G> stored(std::ptrdiff_t s) {
    Group<G> r;
    for (int g = 0; g < G; ++g) r.v[g] = forward_[s * G + g];
    return r;
  }

  void value(std::ptrdiff_t s, Group<G> r, const Filtered& out) const {
    for (int g = 0; g < G; ++g) {
      r.v[g] = not_below(filter_.least[0], r.v[g] + (first_.v[g] + slope_.v[g] * static_cast<double>(s)));
    }
    put(out.value + s * x_.n + from_, r, width_);
  }

  // Three-point differences at sample s.
  void slopes(std::ptrdiff_t s, const Group<G>& before, const Group<G>& at, const Group<G>& after,
              const Filtered& out) const {
    Group<G> r;
    if (out.first != nullptr) {
      for (int g = 0; g < G; ++g) {
        r.v[g] = not_below(filter_.least[1], ((after.v[g] - before.v[g]) * 0.5 + slope_.v[g]) * filter_.rate);
      }
      put(out.first + s * x_.n + from_, r, width_);
    }
    if (out.second == nullptr) return;
    for (int g = 0; g < G; ++g) {
      r.v[g] = ((after.v[g] - at.v[g]) - (at.v[g] - before.v[g])) * (filter_.rate * filter_.rate);
    }
    put(out.second + s * x_.n + from_, r, width_);
  }

  const Channels& x_;
  Rows<G> rows_;
  const Filter& filter_;
  int from_, width_;
  Group<G> first_, slope_;
  Buffer<V> forward_;
};

// Calls work.template operator()<G>(from, width) for groups of channels that fill one or two registers.
template <class Work>
inline void in_groups(int n, const Work& work) {
  for (int from = 0; from < n; from += 2 * W) {
    const int width = static_cast<int>(smaller(2 * W, n - from));
    if (width > W) {
      work.template operator()<2>(from, width);
    } else {
      work.template operator()<1>(from, width);
    }
  }
}

// Samples [begin, end) in pieces of `piece` samples, counted from sample 0 of the run.
inline void zero_phase(const Channels& x, const Filter& filter, std::ptrdiff_t piece, std::ptrdiff_t begin,
                       std::ptrdiff_t end, const Filtered& out) {
  in_groups(x.n, [&]<int G>(int from, int width) {
    ZeroPhase<G> group(x, filter, from, width, smaller(piece, end - begin));
    for (std::ptrdiff_t a = begin; a < end; a += piece) group.filter(a, smaller(a + piece, end), out);
  });
}

// Stores rows of a group that come one after another as rows of channels: out (n, stride), sample s in column s -
// begin.
template <int G>
class Turned {
 public:
  Turned(double* out, std::ptrdiff_t stride, int from, int width)
      : out_(out + from * stride), stride_(stride), width_(width) {}

  void add(const Group<G>& r) {
    for (int g = 0; g < G; ++g) held_[g][count_] = r.v[g];
    if (++count_ == W) flush();
  }

  void flush() {
    for (int g = 0; g < G; ++g) {
      transpose(held_[g]);
      for (int l = 0; l < W && g * W + l < width_; ++l) {
        double* to = out_ + (g * W + l) * stride_ + at_;
        if (count_ == W) {
          store(to, held_[g][l]);
        } else {
          for (int k = 0; k < count_; ++k) to[k] = held_[g][l][k];
        }
      }
    }
    at_ += count_;
    count_ = 0;
  }

 private:
  double* out_;
  std::ptrdiff_t stride_, at_ = 0;
  int width_, count_ = 0;
  V held_[G][W] = {};
};

// out (n, end - begin): absolute difference of the means of `half` samples after and before each sample, times `scale`.
inline void speeds(const Channels& x, std::ptrdiff_t half, double scale, std::ptrdiff_t begin, std::ptrdiff_t end,
                   double* out) {
  in_groups(x.n, [&]<int G>(int from, int width) {
    const Rows<G> rows(x, from, width);
    Turned<G> turned(out, end - begin, from, width);
    V difference[G] = {};
    for (std::ptrdiff_t k = 1; k <= half; ++k) {
      const Group<G> after = rows.reflected(begin + k), before = rows.reflected(begin - k);
      for (int g = 0; g < G; ++g) difference[g] += after.v[g] - before.v[g];
    }
    const double factor = scale / static_cast<double>(half);
    for (std::ptrdiff_t s = begin; s < end; ++s) {
      Group<G> r;
      for (int g = 0; g < G; ++g) r.v[g] = choose(difference[g] < 0.0, -difference[g], difference[g]) * factor;
      turned.add(r);
      if (s + 1 == end) break;
      const Group<G> far = rows.reflected(s + 1 + half), next = rows.reflected(s + 1);
      const Group<G> here = rows.reflected(s), last = rows.reflected(s - half);
      for (int g = 0; g < G; ++g) difference[g] += (far.v[g] - next.v[g]) - (here.v[g] - last.v[g]);
    }
    turned.flush();
  });
}

// out (n, end - begin): absolute third divided differences of samples s to s + 3, in units of one sample's noise;
// smallest (n,): smallest step from sample to sample above zero, if it is below what stands there.
inline void third_differences(const Channels& x, const double* time, std::ptrdiff_t begin, std::ptrdiff_t end,
                              double* out, double* smallest) {
  constexpr int MANY = 64;
  in_groups(x.n, [&]<int G>(int from, int width) {
    const Rows<G> rows(x, from, width);
    Turned<G> turned(out, end - begin, from, width);
    V least[G];
    for (V& v : least) v = splat(std::numeric_limits<double>::infinity());
    Group<G> r[4] = {rows.row(begin), rows.row(begin + 1), rows.row(begin + 2), {}};
    const auto step = [&](const Group<G>& a, const Group<G>& b) {
      for (int g = 0; g < G; ++g) {
        const V d = b.v[g] - a.v[g], size = choose(d < 0.0, -d, d);
        least[g] = choose((size > 0.0) & (size < least[g]), size, least[g]);
      }
    };
    step(r[0], r[1]);
    step(r[1], r[2]);
    for (std::ptrdiff_t s = begin; s < end; s += MANY) {
      const int count = static_cast<int>(smaller(MANY, end - s));
      double w[4][MANY];
      for (int k = 0; k < count; ++k) {
        const double* t = time + s + k;
        const double d01 = t[1] - t[0], d02 = t[2] - t[0], d03 = t[3] - t[0], d12 = t[2] - t[1], d13 = t[3] - t[1],
                     d23 = t[3] - t[2];
        const double w0 = -1.0 / (d01 * d02 * d03), w1 = 1.0 / (d01 * d12 * d13), w2 = -1.0 / (d02 * d12 * d23),
                     w3 = 1.0 / (d03 * d13 * d23);
        const double norm = 1.0 / std::sqrt(w0 * w0 + w1 * w1 + w2 * w2 + w3 * w3);
        w[0][k] = w0 * norm;
        w[1][k] = w1 * norm;
        w[2][k] = w2 * norm;
        w[3][k] = w3 * norm;
      }
      for (int k = 0; k < count; ++k) {
        r[3] = rows.row(s + k + 3);
        step(r[2], r[3]);
        Group<G> third;
        for (int g = 0; g < G; ++g) {
          const V d = w[0][k] * r[0].v[g] + w[1][k] * r[1].v[g] + w[2][k] * r[2].v[g] + w[3][k] * r[3].v[g];
          third.v[g] = choose(d < 0.0, -d, d);
        }
        turned.add(third);
        r[0] = r[1];
        r[1] = r[2];
        r[2] = r[3];
      }
    }
    turned.flush();
    for (int k = 0; k < width; ++k) {
      if (least[k / W][k % W] < smallest[from + k]) smallest[from + k] = least[k / W][k % W];
    }
  });
}

}  // namespace armid::ARMID_ISA
