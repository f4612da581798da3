"""Effect of each fault on an estimate."""

from __future__ import annotations

from collections.abc import Mapping

EFFECTS: Mapping[str, str] = {
    "torque-sign": "All parameters have the wrong sign: negative friction and negative masses.",
    "position-sign": "Gravity and coupling torques of the joint and of what it carries are fitted at mirrored poses.",
    "joint-order": "Parameters of one joint are fitted to the torque of another; the estimate is useless.",
    "degrees": "The motion is wrong by a factor of 57, and inertias and friction with it.",
    "position-offset": "Gravity torques are fitted at wrong poses; first moments and inertias are biased.",
    "position-wrapped": "Differences across the jumps would be velocities of hundreds of rad/s; they are unwrapped.",
    "gravity-direction": "First moments and inertias take wrong signs or directions to compensate for it.",
    "motor-side": "All parameters are too small by the gear ratio.",
    "rotor-inertia-missing": "Rotor inertia is attributed to the links, which are then physically inconsistent.",
    "current-without-gain": "All parameters are in units of the drive's current.",
    "clock-missing": "Velocities and accelerations, and all parameters that depend on them, have no scale.",
    "clock-jitter": "Differentiated positions turn the clock's jitter into noise of velocity and acceleration.",
    "columns-guessed": "With wrong columns the estimate is useless: check the names.",
    "units-of-header": "None if the names are right; the lines state the units in a study.",
    "clock-received": "Jitter of network and recorder becomes noise of velocity and acceleration.",
    "joints-extra": "None: channels of joints that the model does not have are not used.",
    "joints-merged": "Interpolated values are smoother than measured ones, and shifted by a fraction of a step.",
    "locked-joint": "Gravity torques and inertias of all links that it carries are computed at a wrong pose.",
    "clock-unit": "Velocities and accelerations are too small by powers of a thousand.",
    "clock-rate": "Velocities and accelerations are too large or too small by the ratio of the two rates.",
    "clock-gap": "Nothing is filtered or differentiated across it, and rows next to it are lost.",
    "rows-repeated": "Velocity would be zero at every repeated row; these rows are excluded.",
    "rows-not-consecutive": "Nothing can be filtered or differentiated, and terms with hysteresis cannot be used.",
    "channel-delay": "Torque and motion belong to different times, so inertia and viscous friction are mixed up.",
    "velocity-mismatch": "Friction and, where accelerations are derived from it, inertias are biased or meaningless.",
    "saturation": "The largest torques are too small, and inertias and friction with them.",
    "channel-dead": "The joint's parameters are fitted to values that were not measured.",
    "effort-missing": "Without torque or current there is nothing to identify.",
    "value-missing": "Nothing can be computed from it.",
    "filtered-before-logging": "Friction at reversals is smoothed in the torque, but not in the model.",
    "period-misaligned": "The mean over repetitions smooths the motion and makes its torque smaller.",
    "excitation-weak": "Some parameters cannot be separated: the estimate fits this motion and may fail on others.",
    "temperature-drift": "The estimated friction is a mean over the log; intervals are too narrow for another day.",
    "contact": "External forces are attributed to parameters of the arm.",
    "description-rounded": "Without the rounding to multiples of 15° there would be spurious base parameters.",
    "topic-chosen": "None: the others have no joints of the arm, or are commands.",
    "rests-left-out": "None: friction at rest is any torque up to its bound, and the rows beside the rest remain.",
    "sticking": "No law of the velocity describes dry friction at rest, which is any torque up to its bound.",
    "standstill": "At standstill, static friction and gravity cannot be separated, yet such rows have full weight.",
}
"""By code, for all codes of the doctor."""
