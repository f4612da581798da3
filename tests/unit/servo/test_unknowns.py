"""Unknowns: values stay possible, and derivatives are those of the simulated motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.maths.inertia import pseudo_inertia
from armid.servo.closed_loop import position_derivatives, simulate
from armid.servo.unknowns import PriorDeviations, Unknowns
from servo_labs import any_parameters, recorded, servo_model, small_arm

SLOPE = 2e-3
"""Of a derivative by differences, relative to the largest; it jumps where a joint starts to slide a step earlier."""


def unknowns_of(model, mean) -> Unknowns:
    n, laws = model.n, len(model.laws)
    ones = np.ones(n)
    return Unknowns(model, mean, PriorDeviations(np.ones(laws), ones, ones, 0.0 * ones, ones, ones, ones, 0.2))


def test_zero_is_the_mean_and_any_value_is_possible():
    model = servo_model(small_arm())
    mean = any_parameters(model, np.random.default_rng(0))
    unknowns = unknowns_of(model, mean)
    found = unknowns.parameters(np.zeros(unknowns.count))
    assert np.allclose(found.inertial, mean.inertial, rtol=1e-9)
    assert np.allclose(found.stiffness, mean.stiffness)
    for seed in range(20):
        found = unknowns.parameters(np.random.default_rng(seed).normal(0.0, 2.0, unknowns.count))
        assert (np.linalg.eigvalsh(pseudo_inertia(found.inertial)) > -1e-9).all()
        assert (found.stiffness > 0.0).all()
        assert (found.friction > 0.0).all()


def test_known_and_zero_values_are_not_unknown():
    model = servo_model(small_arm())
    mean = replace(any_parameters(model, np.random.default_rng(0)), rotor_inertia=np.array([0.0, 0.01, 0.02]))
    names = unknowns_of(model, mean).names()
    assert ("rotor_inertia", 0) not in names
    assert ("rotor_inertia", 1) in names
    assert not any(name == "damping" for name, _ in names)


def test_derivatives():
    model, rng = servo_model(small_arm()), np.random.default_rng(2)
    mean = any_parameters(model, rng)
    run = recorded(model, mean, rng, 4.0)
    unknowns = unknowns_of(model, mean)
    x = rng.normal(0.0, 0.1, unknowns.count) * np.array([0.01 if n == "delay" else 1.0 for n, _ in unknowns.names()])
    (at,) = simulate(model, unknowns.parameters(x), [run])
    slopes = position_derivatives(model, unknowns.parameters(x), at) @ unknowns.chain(x)
    for k, (name, _) in enumerate(unknowns.names()):
        step = 1e-6 * np.eye(unknowns.count)[k]
        up, down = (simulate(model, unknowns.parameters(x + s), [run])[0].q[1:] for s in (step, -step))
        found = (up - down) / 2e-6
        scale = max(np.abs(slopes[:, :, k]).max(), 1e-3)
        assert np.median(np.abs(found - slopes[:, :, k])) < SLOPE * scale, name
