"""Generation of a monitor of external torque in C99, which calls the generated functions of a model.

The caller stores the state in a structure; nothing is allocated, and the time of a call is bounded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array


@dataclass(frozen=True, eq=False, slots=True)
class MonitorNumbers:
    """Constants of the generated code of a monitor.

    The filters compute y_k = decay · y_(k-1) + old · u_(k-1) + new · u_k from inputs u. The scale of the threshold of
    a joint is the root of c₀ + c₁ Δ² + c₂ q̇², where Δ is the predicted torque after a high-pass.

    Attributes:
        momentum: True for the momentum observer, false for the direct residual.
        velocity: True if measured velocities are an input.
        stage: Corner [1/s], decay, old and new of the two stages of the filter of motion and torque.
        decays: Decay in one sample of the observer's filter, of the high-pass and of the allowance after a rest.
        rest: Speed below which a joint rests [rad/s or m/s], and number of samples below this speed after which it
            counts as resting.
        rate: Samples per second [Hz].
        settled: Number of samples in which the observer settles.
        scale: Coefficients c₀, c₁ and c₂ of the scale of each joint, shape (n, 3).
        factor: Ratio of the threshold to the scale, for a joint that moves, shape (n,).
        friction: Torque that is added to the threshold of a joint at rest, shape (n,) [N·m or N].
    """

    momentum: bool
    velocity: bool
    stage: tuple[float, float, float, float]
    decays: tuple[float, float, float]
    rest: tuple[float, int]
    rate: float
    settled: int
    scale: Array
    factor: Array
    friction: Array


def write_monitor(name: str, numbers: MonitorNumbers, *, memory: bool, heading: Sequence[str]) -> dict[str, str]:
    """Generates the texts of `NAME_monitor.h` and `NAME_monitor.c`; the keys of the result are the paths.

    Args:
        name: Prefix of the functions of the model, whose header is `NAME.h`.
        numbers: Numbers of the monitor.
        memory: True if the model has hysteresis states.
        heading: Lines for the head of the files.
    """
    values = {
        "NAME": name,
        "GUARD": f"ARMID_{name.upper()}_MONITOR_H",
        "HEADING": "\n".join(f" * {line}".rstrip() for line in heading),
        "CHANNELS": str(3 if numbers.velocity else 2),
        "VELOCITY": f", const double dq[{name}_joints]" if numbers.velocity else "",
        "INPUTS": "{q, tau, dq}" if numbers.velocity else "{q, tau}",
        "MEMORY": f"\n  {name}_state memory;" if memory else "",
        "DYNAMICS": _DYNAMICS_WITH_MEMORY if memory else _DYNAMICS,
        "MOTION": _WITH_VELOCITY if numbers.velocity else _FROM_POSITIONS,
        "OBSERVER": _MOMENTUM if numbers.momentum else _RESIDUAL,
        "CONSTANTS": "\n".join(_constants(numbers)),
        "FIRST_MEMORY": "m->count < 2" if numbers.momentum else "m->count == 0",
    }
    return {f"{name}_monitor.h": _filled(_HEADER, values), f"{name}_monitor.c": _filled(_CODE, values)}


def _filled(text: str, values: dict[str, str]) -> str:
    """Text in which each `@KEY@` is replaced by its value, in two passes, because values contain keys, too."""
    for _ in range(2):
        for key, value in values.items():
            text = text.replace(f"@{key}@", value)
    return text


def _constants(numbers: MonitorNumbers) -> list[str]:
    """Lines of C code that define the numbers of a monitor as constants."""
    scalars = {
        "CORNER": numbers.stage[0],
        "DECAY": numbers.stage[1],
        "OLD": numbers.stage[2],
        "NEW": numbers.stage[3],
        "FORGETS": numbers.decays[1],
        "AFTER_REST": numbers.decays[2],
        "REST_SPEED": numbers.rest[0],
    }
    if numbers.momentum:
        scalars |= {"LAST": numbers.decays[0], "RATE": numbers.rate}
    lines = [f"static const double {key} = {float(value)!r};" for key, value in scalars.items()]
    lines.append(f"enum {{ REST = {numbers.rest[1]}, SETTLED = {numbers.settled} }};")
    arrays = {"FACTOR": numbers.factor, "FRICTION": numbers.friction}
    arrays |= {f"SCALE_{k}": numbers.scale[:, k] for k in range(3)}
    for key, array in arrays.items():
        listed = ", ".join(repr(float(x)) for x in np.asarray(array).tolist())
        lines.append(f"static const double {key}[@NAME@_joints] = {{{listed}}};")
    return lines


_HEADER = """/* Monitor of external torque.
@HEADING@
 *
 * This is no safety function: it is neither certified nor redundant and stops nothing.
 */
#ifndef @GUARD@
#define @GUARD@

#include "@NAME@.h"

#ifdef __cplusplus
extern "C" {
#endif

/* State of a monitor, which the caller keeps; only @NAME@_monitor_start and _update change it. */
typedef struct {
  unsigned count;
  int slow_samples[@NAME@_joints];
  double before[@CHANNELS@][@NAME@_joints], first[@CHANNELS@][@NAME@_joints], second[@CHANNELS@][@NAME@_joints];
  double q[@NAME@_joints], dq[@NAME@_joints], measured[@NAME@_joints];
  double predicted[@NAME@_joints], torque[@NAME@_joints];
  double slow[@NAME@_joints], rest[@NAME@_joints];@MEMORY@
} @NAME@_monitor;

/* Starts a monitor; call it again after a gap in the samples. */
void @NAME@_monitor_start(@NAME@_monitor *m);

/* Takes the next sample: measured positions and torque, evenly spaced in time.
 * Returns the number of joints whose external torque exceeds its threshold; 0 while the observer settles.
 * Returns -1 and changes nothing if an input is not finite. */
int @NAME@_monitor_update(@NAME@_monitor *m, const double q[@NAME@_joints], const double tau[@NAME@_joints]@VELOCITY@,
                          double external[@NAME@_joints], double threshold[@NAME@_joints]);

#ifdef __cplusplus
}
#endif

#endif
"""

_CODE = """/* See @NAME@_monitor.h. No allocation, no global state. */
#include "@NAME@_monitor.h"

#include <math.h>

@CONSTANTS@

void @NAME@_monitor_start(@NAME@_monitor *m) { m->count = 0; }

static void dynamics(@NAME@_monitor *m, const double q[@NAME@_joints], const double dq[@NAME@_joints],
                     const double ddq[@NAME@_joints], double tau[@NAME@_joints]) {
@DYNAMICS@
}

int @NAME@_monitor_update(@NAME@_monitor *m, const double q[@NAME@_joints], const double tau[@NAME@_joints]@VELOCITY@,
                          double external[@NAME@_joints], double threshold[@NAME@_joints]) {
  enum { N = @NAME@_joints };
  const double *inputs[@CHANNELS@] = @INPUTS@;
  double x[N], v[N], a[N], measured[N];
  int exceeded = 0;
  for (int c = 0; c < @CHANNELS@; ++c)
    for (int j = 0; j < N; ++j)
      if (!isfinite(inputs[c][j])) return -1;
  for (int c = 0; c < @CHANNELS@; ++c) {
    for (int j = 0; j < N; ++j) {
      const double u = inputs[c][j];
      if (m->count == 0) m->before[c][j] = m->first[c][j] = m->second[c][j] = u;
      const double old = m->first[c][j];
      m->first[c][j] = DECAY * old + OLD * m->before[c][j] + NEW * u;
      m->second[c][j] = DECAY * m->second[c][j] + OLD * old + NEW * m->first[c][j];
      m->before[c][j] = u;
    }
  }
  for (int j = 0; j < N; ++j) {
    x[j] = m->second[0][j];
@MOTION@
    measured[j] = m->second[1][j];
  }
@OBSERVER@
  for (int j = 0; j < N; ++j) {
    if (m->count == 0) {
      m->slow_samples[j] = REST;
      m->rest[j] = 0.0;
    }
    m->slow[j] = FORGETS * m->slow[j] + (1.0 - FORGETS) * m->predicted[j];
    const int still = fabs(v[j]) < REST_SPEED;
    m->slow_samples[j] = !still ? 0 : m->slow_samples[j] < REST ? m->slow_samples[j] + 1 : REST;
    m->rest[j] = m->slow_samples[j] >= REST ? 1.0 : AFTER_REST * m->rest[j];
    const double change = m->predicted[j] - m->slow[j];
    const double scale = sqrt(SCALE_0[j] + SCALE_1[j] * change * change + SCALE_2[j] * v[j] * v[j]);
    threshold[j] = FACTOR[j] * scale + FRICTION[j] * m->rest[j];
    external[j] = m->predicted[j] - m->torque[j];
    exceeded += m->count >= SETTLED && fabs(external[j]) > threshold[j];
  }
  if (m->count < SETTLED) ++m->count;
  return exceeded;
}
"""

_FROM_POSITIONS = """    v[j] = CORNER * (m->first[0][j] - x[j]);
    a[j] = CORNER * CORNER * (q[j] - 2.0 * m->first[0][j] + x[j]);"""

_WITH_VELOCITY = """    v[j] = m->second[2][j];
    a[j] = CORNER * (m->first[2][j] - v[j]);"""

_DYNAMICS = """  (void)m;
  @NAME@_inverse_dynamics(@NAME@_parameters, q, dq, ddq, tau);"""

_DYNAMICS_WITH_MEMORY = """  if (@FIRST_MEMORY@)
    @NAME@_state_start(q, &m->memory);
  else
    @NAME@_state_update(q, &m->memory);
  @NAME@_inverse_dynamics(@NAME@_parameters, q, dq, ddq, &m->memory, tau);"""

_RESIDUAL = """  dynamics(m, x, v, a, m->predicted);
  for (int j = 0; j < N; ++j) {
    m->torque[j] = measured[j];
    if (m->count == 0) m->slow[j] = m->predicted[j];
  }"""

_MOMENTUM = """  if (m->count == 0) {
    dynamics(m, x, v, a, m->predicted);
    for (int j = 0; j < N; ++j) {
      m->torque[j] = measured[j];
      m->slow[j] = m->predicted[j];
    }
  } else {
    double middle[N], speed[N], predicted[N];
    for (int j = 0; j < N; ++j) {
      middle[j] = 0.5 * (x[j] + m->q[j]);
      speed[j] = 0.5 * (v[j] + m->dq[j]);
      a[j] = (v[j] - m->dq[j]) * RATE;
    }
    dynamics(m, middle, speed, a, predicted);
    for (int j = 0; j < N; ++j) {
      if (m->count == 1) m->predicted[j] = m->slow[j] = predicted[j];
      m->predicted[j] = LAST * m->predicted[j] + (1.0 - LAST) * predicted[j];
      m->torque[j] = LAST * m->torque[j] + (1.0 - LAST) * 0.5 * (measured[j] + m->measured[j]);
    }
  }
  for (int j = 0; j < N; ++j) {
    m->q[j] = x[j];
    m->dq[j] = v[j];
    m->measured[j] = measured[j];
  }"""
