"""MATLAB files that use the generated functions: a closed-loop simulation, and texts of Simulink blocks."""

from __future__ import annotations

import re

from armid.codegen.language_input import FunctionSource

BLOCKS = {"inverse_dynamics": "inverse_dynamics_block", "forward_dynamics": "forward_dynamics_block"}
"""Functions for which the text of a Simulink block is generated, each with the name of the file without suffix."""


def matlab_examples(source: FunctionSource) -> dict[str, str]:
    """Texts of `closed_loop.m` and of the files of Simulink blocks; the keys of the result are the paths.

    Files that need a function that `source` does not contain are left out.
    """
    files = {f"{BLOCKS[name]}.m": _block(source, name) for name in BLOCKS if name in source.programs}
    if {"inverse_dynamics", "forward_dynamics", "mass_matrix"} <= set(source.programs):
        files["closed_loop.m"] = _closed_loop(source)
    return files


def _block(source: FunctionSource, name: str) -> str:
    """Text of a MATLAB Function block of Simulink for one of the functions."""
    program = source.programs[name]
    inputs = [a.name for a in program.arguments if a.name not in ("parameters", "state")]
    given = ", ".join("p" if a.name == "parameters" else a.name for a in program.arguments)
    lines = [f"function {program.output} = {BLOCKS[name]}({', '.join(inputs)}) %#codegen"]
    lines += [f"% {program.summary}, as the text of a MATLAB Function block of Simulink.", "%"]
    lines += [
        f"% Insert a MATLAB Function block, paste this text, and add the folder that contains +{source.name} to the"
    ]
    lines += ["% path. Inputs and output are column vectors; set the size of the output to " + f"{source.n}."]
    if source.widths:
        lines += ["% The block has a state (hysteresis): give it a discrete sample time."]
    lines += [f"%   {a.name}: {a.meaning}" for a in program.arguments if a.name in inputs]
    lines += [f"p = {source.name}.parameters();"]
    if source.widths:
        lines += [
            "persistent z",
            "if isempty(z)",
            f"  z = {source.name}.state_start(q);",
            "else",
            f"  z = {source.name}.state_update(q, z);",
            "end",
            "state = z;",
        ]
    return "\n".join([*lines, f"{program.output} = {source.name}.{name}({given});", "end", ""])


def _closed_loop(source: FunctionSource) -> str:
    """Text of `closed_loop.m`, an example that simulates the arm under computed torque."""
    state = "state" if source.widths else ""
    load = "ddq" if any(a.name == "ddq" for a in source.programs["forward_dynamics"].arguments) else ""
    values = {
        "name": source.name,
        "n": str(source.n),
        "start": f"state = {source.name}.state_start(q);" if state else "% The model has no state.",
        "update": f"state = {source.name}.state_update(q, state);" if state else "",
        "state": f", {state}" if state else "",
        "load": f", {load}" if load else "",
    }
    text = re.sub(r"@(\w+)@", lambda match: values[match[1]], CLOSED_LOOP)
    return "".join(f"{line.rstrip()}\n" for line in text.splitlines() if line.strip() or line == "")


CLOSED_LOOP = """function [t, deviation, torque] = closed_loop(seconds, controller)
% Simulation of the arm under computed torque: an example of the generated functions, for MATLAB and GNU Octave.
%
%   closed_loop()                 prints the largest position error of 1 s of motion
%   closed_loop(seconds)          another duration
%   closed_loop(seconds, values)  a controller with other base parameters than those of the simulated arm
%
% The simulated arm has the base parameters of the estimate. It starts beside the reference motion. The controller
% computes a torque every millisecond, for the acceleration ddq_d + KD (dq_d - dq) + KP (q_d - q), and the torque is
% constant until the next. Results, one column a sample: time [s], q_d - q [rad or m], torque [N m or N].
if nargin < 1, seconds = 1.0; end
estimate = @name@.parameters();
if nargin < 2, controller = estimate; end
step = 1e-3;          % sample time [s]
KP = 400.0;           % the error follows a critically damped system of 20 rad/s
KD = 40.0;
OFFSET = 0.05;        % initial position error [rad or m]
n = @n@;
samples = round(seconds / step) + 1;
t = (0:samples - 1) * step;
deviation = zeros(n, samples);
torque = zeros(n, samples);
[q, dq, ddq] = reference(0.0, n);
q = q - OFFSET;
@start@
for k = 1:samples
  [q_d, dq_d, ddq_d] = reference(t(k), n);
  @update@
  wanted = ddq_d + KD * (dq_d - dq) + KP * (q_d - q);
  tau = @name@.inverse_dynamics(controller, q, dq, wanted@state@);
  deviation(:, k) = q_d - q;
  torque(:, k) = tau;
  if any(eig(@name@.mass_matrix(estimate, q)) <= 0.0)
    error('The mass matrix is not positive definite: identify with method = "physical".');
  end
  % One step of the classical Runge-Kutta method.
  a1 = @name@.forward_dynamics(estimate, q, dq, tau@load@@state@);
  a2 = @name@.forward_dynamics(estimate, q + step / 2 * dq, dq + step / 2 * a1, tau@load@@state@);
  a3 = @name@.forward_dynamics(estimate, q + step / 2 * dq + step ^ 2 / 4 * a1, dq + step / 2 * a2, tau@load@@state@);
  a4 = @name@.forward_dynamics(estimate, q + step * dq + step ^ 2 / 2 * a2, dq + step * a3, tau@load@@state@);
  q = q + step * dq + step ^ 2 / 6 * (a1 + a2 + a3);
  dq = dq + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
  ddq = a4;
end
fprintf('largest position error in the last half: %.3g rad or m\\n', max(max(abs(deviation(:, ceil(end / 2):end)))));
end

function [q, dq, ddq] = reference(t, n)
% Reference motion: sines of 0.3 rad or m whose frequencies rise from joint to joint.
w = 2.0 + 0.3 * (1:n)';
q = 0.3 * sin(w * t);
dq = 0.3 * w .* cos(w * t);
ddq = -0.3 * w .^ 2 .* sin(w * t);
end
"""
