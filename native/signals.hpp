// Channels of a recording and the filters over them: plain data that every instruction set's translation unit reads.
#pragma once

#include <cstddef>

namespace armid {

struct Channels {
  const double* values;  // (samples, n)
  std::ptrdiff_t samples;
  int n;
};

// Sections in the order in which they are applied, three numbers each (see channels.hpp); a filter has settled after
// `reach` samples. The sample rate [Hz] turns differences into derivatives.
struct Filter {
  const double* sections;
  int count;
  std::ptrdiff_t reach;
  double rate;
  double least[2];  // smallest absolute filtered value and first derivative; what is smaller becomes zero
};

// Where filtered samples and their derivatives go, (samples, n) each; the derivatives may be null. The derivatives of
// the first and last sample are not made.
struct Filtered {
  double *value, *first, *second;
};

}  // namespace armid
