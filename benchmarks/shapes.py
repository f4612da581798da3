"""Links of published arms compared with their shapes: `python benchmarks/shapes.py FOLDER [--mistakes 300] [--json]`.

FOLDER contains unpacked packages of the package index, `example-robot-data` and `robosuite` (pip download --no-deps,
unzip). Every link of nineteen arms was judged by hand from its size, mass, centre of mass and inertia, and the wrong
ones are listed below with the reason. Told are how many of the sound links `armid certify` names, how many of the
wrong ones it leaves out, and how many of seeded mistakes of ten kinds, each in one sound link, it names with their
cause. Fails above 5 % of sound links or below 95 % of the mistakes.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from armid.robot import load_robot
from armid.robot.described_bodies.body import DescribedBody
from armid.robot.described_bodies.reading import described_bodies
from armid.validation.inertial_checks.filled_shape import FilledShape, filled_shape
from armid.validation.inertial_checks.findings import check_bodies

MOST_SOUND = 0.05
LEAST_MISTAKES = 0.95
MATERIAL = 2.0
"""Smallest parallel-axis term of a seeded mistake, over the second moment of the filled shape along the same line:
the mistake adds about twice what is there."""

NO_INERTIA = "mass without inertia"
FOREIGN_CENTRE = "centre of mass in the frame of another convention, beside the mesh"
IDENTIFIED = "identified from torque: the base parameters are right, the single link is no body of this size"
EQUAL = "moments that are equal about all axes and 15 to 90 times too large"
FRAME = "a frame with a token mass"

ARMS: dict[str, dict[str, str]] = {
    "kinova_description/robots/kinova.urdf": {
        f"j2s6s200_link_finger_{part}": "one inertia for fingers and finger tips"
        for part in ("1", "2", "tip_1", "tip_2")
    },
    "so_arm_description/urdf/so100.urdf": {},
    "so_arm_description/urdf/so101.urdf": {},
    "ur_description/urdf/ur3_robot.urdf": {f"wrist_{k}_link": FOREIGN_CENTRE for k in (1, 2, 3)},
    "ur_description/urdf/ur5_robot.urdf": {f"wrist_{k}_link": FOREIGN_CENTRE for k in (1, 2, 3)},
    "ur_description/urdf/ur10_robot.urdf": {f"wrist_{k}_link": FOREIGN_CENTRE for k in (1, 2, 3)},
    "panda_description/urdf/panda.urdf": {f"panda_link{k}": IDENTIFIED for k in (1, 2, 7)},
    "talos_data/robots/talos_left_arm.urdf": {
        "wrist_left_ft_link": NO_INERTIA,
        "wrist_left_ft_tool_link": NO_INERTIA,
        "gripper_left_motor_double_link": "largest moment three times that of all its mass at the ends",
    },
    "z1_description/urdf/z1.urdf": {},
    "tiago_description/robots/tiago_no_hand.urdf": dict.fromkeys(
        ("arm_tool_link", "wrist_ft_link", "wrist_ft_tool_link"), NO_INERTIA
    ),
    "robots/baxter/robot.xml": {},
    "robots/iiwa/robot.xml": {"link_7": "3.1 kg in a flange that would have to be of lead"},
    "robots/jaco/robot.xml": {},
    "robots/kinova3/robot.xml": {},
    "robots/panda/robot.xml": {f"link{k}": EQUAL for k in range(1, 8)},
    "robots/sawyer/robot.xml": dict.fromkeys(("screen", "right_l4_2", "right_l2_2", "right_l1_2"), FRAME),
    "robots/ur5e/robot.xml": {},
    "robots/spot_arm/robot.xml": {"arm_link_hr0": FRAME},
    "robots/xarm7/robot.xml": {},
}
"""Descriptions, with the links that really are wrong and the reason."""

Seed = Callable[[DescribedBody, DescribedBody, np.random.Generator], DescribedBody]


def _scaled(mass: float, com: float, inertia: float) -> Seed:
    def seeded(body: DescribedBody, _: DescribedBody, __: np.random.Generator) -> DescribedBody:
        return replace(body, mass=mass * body.mass, com=com * body.com, inertia=inertia * body.inertia)

    return seeded


def _mesh(body: DescribedBody, _: DescribedBody, __: np.random.Generator) -> DescribedBody:
    return replace(body, shapes=tuple(replace(s, size=1e3 * s.size) if s.path else s for s in body.shapes))


def _origin(body: DescribedBody, _: DescribedBody, __: np.random.Generator) -> DescribedBody:
    c = body.com
    return replace(body, inertia=body.inertia + body.mass * (c @ c * np.eye(3) - np.outer(c, c)))


def _copied(body: DescribedBody, other: DescribedBody, _: np.random.Generator) -> DescribedBody:
    return replace(body, mass=other.mass, com=other.com, inertia=other.inertia)


def _placeholder(body: DescribedBody, _: DescribedBody, rng: np.random.Generator) -> DescribedBody:
    return replace(body, inertia=float(rng.choice([0.0, 1e-4, 1e-3, 1e-2, 0.1, 1.0])) * np.eye(3))


SEEDS: dict[str, tuple[Seed, str, str]] = {
    "mass in grams": (_scaled(1e3, 1, 1), "inertial-unit", "mass is in grams"),
    "mass and inertia in grams": (_scaled(1e3, 1, 1e3), "inertial-unit", "mass and inertia are in grams"),
    "inertia in kg·mm²": (_scaled(1, 1, 1e6), "inertial-unit", "kg·mm²"),
    "inertia in g·m²": (_scaled(1, 1, 1e3), "inertial-unit", "g·m²"),
    "inertia in g·mm²": (_scaled(1, 1, 1e9), "inertial-unit", "g·mm²"),
    "centre of mass in mm": (_scaled(1, 1e3, 1), "inertial-unit", "centre of mass is in millimetres"),
    "meshes in mm": (_mesh, "mesh-unit", "drawn in millimetres"),
    "inertia about the origin": (_origin, "inertia-about-origin", "about the origin"),
    "copied inertial": (_copied, "inertial-copied", "copied"),
    "placeholder": (_placeholder, "inertial-placeholder", "placeholder"),
}
"""The mistake, the code of the finding that names it, and words of its evidence."""


def _fits(kind: str, body: DescribedBody, other: DescribedBody, shapes: dict[int, FilledShape]) -> bool:
    """Tell whether a mistake changes a link enough to be one."""
    shape, away = shapes[id(body)], float(np.linalg.norm(body.com))
    if kind == "inertia about the origin":
        return away > 0.0 and away**2 >= MATERIAL * float(body.com @ shape.second_moment @ body.com) / away**2
    if kind == "centre of mass in mm":
        return away >= 1e-3
    if kind == "copied inertial":
        sizes = np.cbrt([shape.volume, shapes[id(other)].volume])
        return bool(sizes.max() > 1.4 * sizes.min()) and body.mass != other.mass
    return kind != "meshes in mm" or all(each.path for each in body.shapes)


def main() -> int:
    """Check every arm and every seeded mistake, and print the rates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--mistakes", type=int, default=300)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    sound: list[tuple[str, DescribedBody]] = []
    shapes: dict[int, FilledShape] = {}
    named: list[str] = []
    left_out: list[str] = []
    wrong = 0
    for arm, mistakes in ARMS.items():
        path = next((p for p in sorted(options.folder.rglob(Path(arm).name)) if p.as_posix().endswith(arm)), None)
        if path is None:
            sys.exit(f"{options.folder} has no {arm}")
        bodies = described_bodies(load_robot(path))
        found = check_bodies(bodies)
        for body in bodies:
            if body.name not in found.measures:
                continue
            where = f"{arm} {body.name}"
            if body.name in mistakes:
                wrong += 1
                left_out += [where] * (body.name not in found.named)
            else:
                sound.append((arm, body))
                shapes[id(body)] = filled_shape(body)[0]  # pyright: ignore[reportArgumentType]
                named += [where] * (body.name in found.named)
    rng = np.random.default_rng(0)
    tried: Counter[str] = Counter()
    caught: Counter[str] = Counter()
    missed: list[str] = []
    for k in range(options.mistakes):
        kind = list(SEEDS)[k % len(SEEDS)]
        seed, code, words = SEEDS[kind]
        while True:
            arm, body = sound[int(rng.integers(len(sound)))]
            others = [each for own, each in sound if own == arm and each.name != body.name]
            other = others[int(rng.integers(len(others)))]
            if _fits(kind, body, other, shapes):
                break
        seeded = seed(body, other, rng)
        findings = check_bodies([seeded, other] if kind == "copied inertial" else [seeded]).findings
        hit = any(
            f.code == code and words in f.evidence.lower() and body.name in f.channel.split(", ") for f in findings
        )
        tried[kind] += 1
        caught[kind] += hit
        missed += [f"{kind}: {arm} {body.name} ({', '.join(f.code for f in findings) or 'nothing'})"] * (not hit)
    summary = {
        "sound links": len(sound),
        "sound links named": named,
        "wrong links": wrong,
        "wrong links not named": left_out,
        "mistakes": options.mistakes,
        "named with their cause": sum(caught.values()),
        "by kind": {kind: f"{caught[kind]} of {tried[kind]}" for kind in SEEDS},
        "missed": missed,
    }
    print(json.dumps(summary) if options.json else "\n".join(f"{name}: {value}" for name, value in summary.items()))
    bad = len(named) > MOST_SOUND * len(sound) or sum(caught.values()) < LEAST_MISTAKES * options.mistakes
    return int(bad or bool(left_out))


if __name__ == "__main__":
    sys.exit(main())
