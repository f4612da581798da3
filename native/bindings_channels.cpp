// Python bindings of the passes over the channels of a recording: checks of arrays, and threads over pieces.
#include "bindings.hpp"
#include "workers.hpp"

namespace armid {

namespace {

Channels channels_of(const In<double>& x) {
  require(x.ndim() == 2 && x.shape(0) > 0 && x.shape(1) > 0, "x must be (N, n), not empty");
  return {x.data(), static_cast<std::ptrdiff_t>(x.shape(0)), static_cast<int>(x.shape(1))};
}

void zero_phase(const std::string& isa, In<double> x, In<double> sections, std::int64_t reach, double rate,
                double least_value, double least_first, std::int64_t piece, int threads, Out<double> value,
                Out<double> first, Out<double> second) {
  const Channels channels = channels_of(x);
  require(sections.size() > 0 && sections.size() % 3 == 0, "sections must be (k, 3)");
  require(0 < reach && reach < channels.samples, "the filter must settle within the samples");
  require(piece > 0, "pieces must have samples");
  require(value.size() == x.size(), "value must be (N, n)");
  require(first.size() == 0 || first.size() == x.size(), "first must be (N, n) or empty");
  require(second.size() == 0 || second.size() == x.size(), "second must be (N, n) or empty");
  const Filter filter{sections.data(),
                      static_cast<int>(sections.size() / 3),
                      static_cast<std::ptrdiff_t>(reach),
                      rate,
                      {least_value, least_first}};
  const Filtered out{value.data(), first.size() ? first.data() : nullptr, second.size() ? second.data() : nullptr};
  const Kernel& k = kernel(isa);
  nb::gil_scoped_release release;
  const std::ptrdiff_t pieces = (channels.samples + piece - 1) / piece;
  const int workers = static_cast<int>(std::clamp<std::ptrdiff_t>(threads, 1, pieces));
  run_workers(workers, [&](int w) {
    const std::ptrdiff_t begin = pieces * w / workers * piece;
    const std::ptrdiff_t end =
        std::min(pieces * (w + 1) / workers * static_cast<std::ptrdiff_t>(piece), channels.samples);
    k.zero_phase(channels, filter, piece, begin, end, out);
  });
}

void filter_columns(const std::string& isa, In<double> x, In<double> sections, std::int64_t reach, std::int64_t first,
                    std::int64_t step, Out<double> out) {
  const Channels columns = channels_of(x);  // (columns, samples)
  require(sections.size() > 0 && sections.size() % 3 == 0, "sections must be (k, 3)");
  const std::ptrdiff_t samples = columns.n, count = columns.samples;
  require(0 < reach && reach < samples, "the filter must settle within the samples");
  require(out.ndim() == 2 && out.shape(0) == x.shape(0), "out must be (columns, rows)");
  const std::ptrdiff_t rows = static_cast<std::ptrdiff_t>(out.shape(1));
  require(first >= 0 && step > 0 && (rows == 0 || first + (rows - 1) * step < samples), "rows must lie inside of x");
  const Filter filter{
      sections.data(), static_cast<int>(sections.size() / 3), static_cast<std::ptrdiff_t>(reach), 1.0, {0.0, 0.0}};
  const Kernel& k = kernel(isa);
  double* to = out.data();
  nb::gil_scoped_release release;
  k.filter_columns(columns.values, samples, static_cast<int>(count), filter, first, step, rows, to);
}

void speeds(const std::string& isa, In<double> x, std::int64_t half, double scale, std::int64_t begin,
            Out<double> out) {
  const Channels channels = channels_of(x);
  require(out.ndim() == 2 && out.shape(0) == x.shape(1), "out must be (n, samples)");
  const std::int64_t end = begin + static_cast<std::int64_t>(out.shape(1));
  require(0 <= begin && end <= channels.samples, "the samples must lie inside of x");
  require(0 < half && half < channels.samples, "the span must be shorter than x");
  const Kernel& k = kernel(isa);
  double* to = out.data();
  nb::gil_scoped_release release;
  k.speeds(channels, half, scale, begin, end, to);
}

void third_differences(const std::string& isa, In<double> x, In<double> time, std::int64_t begin, Out<double> out,
                       Out<double> smallest) {
  const Channels channels = channels_of(x);
  require(time.size() == x.shape(0), "time must be (N,)");
  require(out.ndim() == 2 && out.shape(0) == x.shape(1), "out must be (n, samples)");
  require(smallest.size() == x.shape(1), "smallest must be (n,)");
  const std::int64_t end = begin + static_cast<std::int64_t>(out.shape(1));
  require(0 <= begin && begin < end && end + 3 <= channels.samples, "the samples must lie three before the end of x");
  const Kernel& k = kernel(isa);
  const double* at = time.data();
  double *to = out.data(), *least = smallest.data();
  nb::gil_scoped_release release;
  k.third_differences(channels, at, begin, end, to, least);
}

void decimate_channels(const std::string& isa, In<double> x, In<double> taps, std::int64_t step, Out<double> out) {
  const Channels channels = channels_of(x);
  require(out.ndim() == 2 && out.shape(1) == x.shape(1), "out must be (rows, n)");
  require(taps.size() > 0 && step > 0, "there must be taps and a step");
  const std::int64_t rows = static_cast<std::int64_t>(out.shape(0)), length = static_cast<std::int64_t>(taps.size());
  require(rows == 0 || rows <= (channels.samples - length) / step + 1, "the filter must lie inside of x");
  require(rows == 0 || length <= channels.samples, "the filter must lie inside of x");
  const Kernel& k = kernel(isa);
  const double* weights = taps.data();
  double* to = out.data();
  nb::gil_scoped_release release;
  k.decimate_channels(channels, weights, static_cast<int>(length), step, rows, to);
}

void heights(const std::string& isa, In<double> padded, std::int64_t length, Out<double> height,
             Out<double> difference) {
  const std::int64_t runs = static_cast<std::int64_t>(height.size());
  require(length > 0 && difference.size() == height.size(), "height and difference must be (runs,)");
  require(static_cast<std::int64_t>(padded.size()) == runs + length + 5, "padded must be (runs + length + 5,)");
  const Kernel& k = kernel(isa);
  const double* from = padded.data();
  double *of = height.data(), *between = difference.data();
  nb::gil_scoped_release release;
  k.heights(from, runs, static_cast<int>(length), of, between);
}

}  // namespace

void bind_channels(nb::module_& m) {
  bind(m, "zero_phase", &zero_phase);
  bind(m, "filter_columns", &filter_columns);
  bind(m, "speeds", &speeds);
  bind(m, "third_differences", &third_differences);
  bind(m, "decimate_channels", &decimate_channels);
  bind(m, "heights", &heights);
}

}  // namespace armid
