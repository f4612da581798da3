"""Effects of each finding on an estimate."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["EFFECTS"]

EFFECTS: Mapping[str, str] = {
    "torque-sign": "All parameters come out with the other sign: friction that drives, masses below zero.",
    "position-sign": "Weights and couplings of the joint, and of all that it carries, are fitted at mirrored poses.",
    "joint-order": "Parameters of one joint are fitted to another's torque; nothing of the estimate holds.",
    "degrees": "Motion is 57 times too large; inertias and friction come out far too small.",
    "position-offset": "Weights are fitted at wrong poses; first moments and inertias of the links are biased.",
    "position-wrapped": "Differences across the jumps would be velocities of hundreds of rad/s; they are unwrapped.",
    "gravity-direction": "First moments take another sign or direction to make good for it, inertias with them.",
    "motor-side": "All parameters come out smaller by the gear ratio.",
    "rotor-inertia-missing": "Inertias of the links grow by what the rotors have, and no real body has them.",
    "current-without-gain": "All parameters come out in units of the drive's current.",
    "clock-missing": "Velocities and accelerations, and all that hangs on them, have no scale.",
    "clock-jitter": "Differences of positions carry the clock's unevenness as noise in velocity and acceleration.",
    "columns-guessed": "Wrong columns would be another arm: look at the names.",
    "units-of-header": "None: the recording is read in these units.",
    "clock-received": "The unevenness of network and recorder goes into velocity and acceleration.",
    "joints-extra": "None: what the model does not have takes no part.",
    "joints-merged": "What was interpolated is smoother than it was measured, and late or early by a part of a step.",
    "locked-joint": "Weights and inertias of all that it carries are taken at another pose than they had.",
    "clock-unit": "Velocities and accelerations come out by powers of a thousand too small.",
    "clock-rate": "Velocities and accelerations are too large or too small by the ratio of the two rates.",
    "clock-gap": "Nothing is filtered or differentiated across it; rows beside it are lost.",
    "rows-repeated": "Velocity would be zero at every repeated row; these rows do not count.",
    "rows-not-consecutive": "Nothing can be filtered or differentiated, and terms with memory cannot be used.",
    "channel-delay": "Inertia and viscous friction trade with each other: torque at one time, motion at another.",
    "velocity-mismatch": "Friction and, where accelerations are derived from it, inertias are biased or meaningless.",
    "saturation": "The largest torques are too small, and inertias and friction with them.",
    "channel-dead": "The joint's parameters are those of a wire.",
    "value-missing": "Nothing can be computed from it.",
    "filtered-before-logging": "Reversals of friction are smeared in the torque, but not in the model.",
    "period-misaligned": "A mean over repetitions blurs the motion and shrinks its torque.",
    "excitation-weak": "Parameters trade with each other: the estimate holds for this motion and fails on others.",
    "temperature-drift": "Friction is a mean of what it was; intervals are too narrow for another day.",
    "contact": "Forces from outside are taken for parameters of the arm.",
    "description-rounded": "Spurious base parameters would appear; angles are taken as what they stand for.",
    "topic-chosen": "None: the others have no joints of the arm, or are commands.",
    "sticking": "Dry friction at rest has any value up to its bound, which no law of the velocity says.",
    "standstill": "Such rows tell friction at rest and weight apart from nothing, and weigh as much as moving ones.",
}
"""By code: the whole list of codes that the doctor has."""
