// Closed-loop roll-out of an arm with servos, and its sensitivities to parameters. The scheme is described in step.hpp.
#pragma once

#include "one_window.hpp"
#include "sensitivities.hpp"
#include "windows.hpp"

namespace armid::ARMID_ISA {

constexpr int ALONE = W > 2 ? 2 : 1;  // windows up to which one after another takes less time than side by side

// States of `windows` windows, q and dq (windows, N + 1, n) with the first of each given; the number of steps that did
// not settle.
inline std::ptrdiff_t roll_out(const Arm& arm, const double* inertial, const Servos& servos, const Commands& commands,
                               std::ptrdiff_t windows, std::ptrdiff_t N, double* q, double* dq) {
  Windows side_by_side(arm, inertial, servos);
  OneWindow alone(arm, inertial, servos);
  const std::ptrdiff_t inputs = N * arm.n, states = (N + 1) * arm.n;
  std::ptrdiff_t open = 0;
  for (std::ptrdiff_t w = 0; w < windows; w += W) {
    Commands of[W];
    double *to_q[W], *to_dq[W];
    const int count = static_cast<int>(smaller(W, windows - w));
    if (count <= ALONE) {
      for (int l = 0; l < count; ++l) {
        const Commands one{commands.position + (w + l) * inputs,
                           commands.torque == nullptr ? nullptr : commands.torque + (w + l) * inputs};
        open += alone.run(one, N, q + (w + l) * states, dq + (w + l) * states);
      }
      continue;
    }
    for (int l = 0; l < count; ++l) {
      of[l] = {commands.position + (w + l) * inputs,
               commands.torque == nullptr ? nullptr : commands.torque + (w + l) * inputs};
      to_q[l] = q + (w + l) * states;
      to_dq[l] = dq + (w + l) * states;
    }
    open += side_by_side.run(of, count, N, to_q, to_dq);
  }
  return open;
}

inline void roll_out_sensitivities(const Arm& arm, const double* inertial, const Servos& servos,
                                   const RolloutParameters& parameters, const Commands& commands, std::ptrdiff_t N,
                                   const double* q, const double* dq, const double* S_q, const double* S_dq,
                                   std::ptrdiff_t every, double* out) {
  Sensitivities(arm, inertial, servos, parameters).run(commands, N, q, dq, S_q, S_dq, every, out);
}

}  // namespace armid::ARMID_ISA
