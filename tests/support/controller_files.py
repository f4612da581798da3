"""Readers of load data, written from the vendors' pages (named in docs/payload.md) and not from armid's writers.

Each reader returns the ten parameters m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the flange, or, for
controllers without products or without inertia, what they have.
"""

from __future__ import annotations

import json
import math
import re
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[np.float64]]
NUMBER = r"[-+]?\d+(?:\.\d*)?"  # without exponent: not every language of a controller is known to take one


def ten(mass: float, com: Array, about_com: Array) -> Array:
    """The parallel axis theorem, element by element."""
    x, y, z = com
    shift = mass * np.array(
        [[y * y + z * z, -x * y, -x * z], [-x * y, x * x + z * z, -y * z], [-x * z, -y * z, x * x + y * y]]
    )
    about = about_com + shift
    return np.array([mass, mass * x, mass * y, mass * z, *about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])


def numbers(text: str) -> list[float]:
    return [float(word) for word in re.findall(NUMBER, text)]


def without_comments(text: str, sign: str) -> str:
    return "\n".join(line for line in text.splitlines() if not line.lstrip().startswith(sign))


def symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def read_ur(files: dict[str, str]) -> Array:
    """set_target_payload(m, cog, inertia): kg, m, [Ixx, Iyy, Izz, Ixy, Ixz, Iyz] at the centre of gravity."""
    (call,) = re.findall(r"set_target_payload\((.*)\)", without_comments(files["load_ur.script"], "#"))
    m, x, y, z, *six = numbers(call)
    assert len(six) == 6
    return ten(m, np.array([x, y, z]), symmetric(*six))


def read_franka_json(files: dict[str, str]) -> Array:
    """mass, centerOfMass, inertia: nine entries of a symmetric tensor, by columns."""
    record = json.loads(files["franka/endeffector-config.json"])
    assert set(record) == {"id", "name", "color", "mass", "centerOfMass", "transformation", "inertia"}
    assert not record["id"].startswith("ee-") and re.fullmatch(r"[\w.~-]+", record["id"])
    assert len(record["transformation"]) == 16 and len(record["inertia"]) == 9
    tensor = np.array(record["inertia"]).reshape(3, 3, order="F")
    assert (tensor == tensor.T).all()
    return ten(record["mass"], np.array(record["centerOfMass"]), tensor)


def read_franka_cpp(files: dict[str, str]) -> Array:
    """setLoad(load_mass, F_x_Cload, load_inertia): kg, m, kg m^2 by columns."""
    text = without_comments(files["franka/armid_set_load.hpp"], "//")
    (mass,) = re.findall(rf"double armid_load_mass = ({NUMBER});", text)
    (com,) = re.findall(r"array<double, 3> armid_F_x_Cload\{(.*)\};", text)
    (inertia,) = re.findall(r"array<double, 9> armid_load_inertia\{(.*)\};", text)
    return ten(float(mass), np.array(numbers(com)), np.array(numbers(inertia)).reshape(3, 3, order="F"))


def read_kuka(files: dict[str, str]) -> Array:
    """Turn about Z by A, about the new Y by B, about the new X by C: the result are the principal axes."""
    text = without_comments(files["load_kuka.dat"], ";")
    n = f"({NUMBER})"
    pattern = rf"LOAD_DATA\[1\]=\{{M {n},CM \{{X {n},Y {n},Z {n},A {n},B {n},C {n}\}},J \{{X {n},Y {n},Z {n}\}}\}}"
    match = re.fullmatch(pattern, text.strip())
    assert match is not None
    m, x, y, z, *rest = map(float, match.groups())
    a, b, c = map(math.radians, rest[:3])
    about_z = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
    about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    about_x = np.array([[1, 0, 0], [0, math.cos(c), -math.sin(c)], [0, math.sin(c), math.cos(c)]])
    axes = about_z @ about_y @ about_x
    return ten(m, np.array([x, y, z]) / 1000.0, axes @ np.diag(rest[3:]) @ axes.T)


def read_abb(files: dict[str, str]) -> Array:
    """[mass, [x, y, z], [q1, q2, q3, q4], ix, iy, iz]: kg, mm, scalar first, kg m^2 about the axes of moment."""
    (data,) = re.findall(r"PERS loaddata \w+:=\[(.*)\];", without_comments(files["load_abb.mod"], "!"))
    assert re.fullmatch(rf"{NUMBER},\[{NUMBER}(,{NUMBER}){{2}}\],\[{NUMBER}(,{NUMBER}){{3}}\](,{NUMBER}){{3}}", data)
    m, x, y, z, w, i, j, k, *moments = numbers(data)
    assert abs(w * w + i * i + j * j + k * k - 1.0) < 1e-8
    # columns: the axes x, y, z turned by v' = v + 2 w (u × v) + 2 u × (u × v)
    u = np.array([i, j, k])
    axes = np.array([e + 2 * w * np.cross(u, e) + 2 * np.cross(u, np.cross(u, e)) for e in np.eye(3)]).T
    return ten(m, np.array([x, y, z]) / 1000.0, axes @ np.diag(moments) @ axes.T)


def read_fanuc(files: dict[str, str]) -> Array:
    """Mass [kg], centre [cm], moments about the centre [kgf cm s^2]: mass, centre [m], three moments [kg m^2]."""
    lines = without_comments(files["load_fanuc.txt"], "!").splitlines()
    screen = dict(re.fullmatch(rf"(.*): ({NUMBER})", line).groups() for line in lines)  # pyright: ignore
    assert list(screen) == [
        "PAYLOAD [kg]",
        *(f"PAYLOAD CENTER {axis} [cm]" for axis in "XYZ"),
        *(f"PAYLOAD INERTIA {axis} [kgfcms^2]" for axis in "XYZ"),
    ]
    m, x, y, z, *moments = map(float, screen.values())
    return np.array([m, x / 100, y / 100, z / 100, *(0.0980665 * each for each in moments)])


def read_xarm(files: dict[str, str]) -> Array:
    """Arguments of set_tcp_load(weight, center_of_gravity), in kg and mm; the centre is returned in m."""
    calls: list[tuple[float, list[float]]] = []

    class Arm:
        def set_tcp_load(self, weight: float, center_of_gravity: list[float]) -> int:
            calls.append((weight, center_of_gravity))
            return 0

    scope: dict[str, Any] = {}
    exec(files["load_xarm.py"], scope)
    assert scope["set_load"](Arm()) == 0
    ((weight, centre),) = calls
    return np.array([weight, *(x / 1000 for x in centre)])


def read_doosan(files: dict[str, str]) -> Array:
    """Weight [kg] and centre of gravity [m]; the inertia is zero."""
    import yaml

    record = yaml.safe_load(files["load_doosan.yaml"])
    assert set(record) == {"name", "weight", "cog", "inertia"} and record["inertia"] == [0.0] * 6
    return np.array([record["weight"], *record["cog"]])
