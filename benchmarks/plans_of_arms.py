"""Plans of `armid excite` with its defaults, counted for self-collision by other programs.

    python benchmarks/plans_of_arms.py [--budget 10] [--options '…'] [--to FILE] 'DESCRIPTION [OPTION …]' …

Each argument is a description with the options of `armid excite` that it needs, in quotes. The command is run as it
is from a shell. Its plan is sampled and counted: a URDF by Pinocchio and Coal, an MJCF, and a URDF that Pinocchio
refuses, by MuJoCo and Coal; meshes by their triangles where their convex hulls are not apart. Packages of meshes are
found as armid finds them. A sample counts where two bodies overlap that are not next to each other and not two that
do so in 95 % of 1000 random poses or more; URDFs without collision geometry are counted by their visual geometry.
Limits of velocity that a description lacks are 1 rad/s, of position 3 rad either way. With `--to` each row is added
to a file as soon as it is there, and arms that the file has already are passed over, so that a run that was stopped
goes on where it was.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import math
import re
import shlex
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import coal
import mujoco
import numpy as np
import pinocchio as pin

from armid.robot.packages import file_of

ALWAYS, LOOKED = 0.95, 1000
"""Share of so many random poses in which two bodies overlap by construction."""

MESH = re.compile(r"package://([^/\"']+)/([^\"']+)")
"""A file of a package in a description."""

COLUMNS = "arm | joints | exit | verdict | wall [s] | samples | overlaps | of | pairs | left out | by | said"

ASKED = re.compile(r"limit of position or velocity is missing for .*?: (.*?)\.\s", re.DOTALL)
"""Message of the command about limits that it lacks."""


@dataclass
class Row:
    """Result for one arm."""

    arm: str
    joints: int
    code: int
    verdict: str
    wall: float
    samples: int
    overlaps: int
    worst: str
    pairs: int
    left_out: int
    by: str
    said: str

    def line(self) -> str:
        """A row of the table."""
        wall, said = f"{self.wall:.1f}", self.said[:160].replace("|", "/")
        cells = (self.arm, self.joints, self.code, self.verdict, wall, self.samples, self.overlaps, self.worst)
        return "| " + " | ".join(map(str, (*cells, self.pairs, self.left_out, self.by, said))) + " |"


def name_of(text: str) -> str:
    """An arm in the table."""
    return "/".join(Path(shlex.split(text)[0]).parts[-3:])


def with_paths(path: Path, folder: str) -> Path:
    """A URDF whose meshes are named by whole paths, in another folder; relative ones are left to their reader."""

    def placed(found: re.Match[str]) -> str:
        return file_of(found[1], Path(found[2]), str(path)) or found[0]

    text = MESH.sub(placed, path.read_text(encoding="utf-8"))
    for kind in ("effort", "velocity"):  # what Pinocchio insists on, and nobody asks here
        text = re.sub(rf"<limit\b(?![^>]*\b{kind}\s*=)", f'<limit {kind}="1"', text)
    made = Path(folder) / path.name
    made.write_text(text, encoding="utf-8")
    return made


def planned(path: Path, options: list[str], budget: float, out: Path, more: list[str]) -> tuple[int, str, float]:
    """Run the command; its exit code, what it says on standard error, and how long it takes [s]."""
    line = [str(Path(sys.executable).with_name("armid")), "excite", str(path), "--budget", str(budget)]
    line += ["--no-report", "--format", "csv", "--out", str(out), *options, *more]
    for _ in range(2):
        began = time.time()
        done = subprocess.run(
            line, capture_output=True, text=True, check=False, env={**os.environ, "COLUMNS": "9999"}
        )
        missing = ASKED.search(done.stderr)
        if not missing:
            break
        for each in missing[1].replace("\n", " ").split(", "):
            line += ["--limit", each + ("=-3:3" if each.endswith("position") else "=1.0")]
    return done.returncode, " ".join(done.stderr.split()), time.time() - began


def motion(plan: Path, rate: float) -> tuple[list[str], np.ndarray]:
    """Joints and positions (N, n) of a plan by (3.55b)."""
    series = json.loads(plan.read_text(encoding="utf-8"))
    w, a, b = series["base_frequency"], np.array(series["a"]), np.array(series["b"])
    f = w * np.arange(1, a.shape[1] + 1)
    t = np.arange(round(2.0 * math.pi / w * rate) + 1) / rate
    s, c = np.sin(np.outer(t, f)), np.cos(np.outer(t, f))
    return series["joints"], np.array(series["offset"]) + s @ (a / f).T - c @ (b / f).T


class ByPinocchio:
    """A URDF; joints that do not move stay where they are held."""

    by = "Pinocchio"

    def __init__(self, path: Path, held: dict[str, float]) -> None:
        folders = [str(folder) for folder in path.resolve().parents]
        kinds = (pin.GeometryType.COLLISION, pin.GeometryType.VISUAL)
        with tempfile.TemporaryDirectory() as folder:
            read = str(with_paths(path, folder))
            self.model, self.held = pin.buildModelFromUrdf(read), held
            made = [pin.buildGeomFromUrdf(self.model, read, kind, package_dirs=folders) for kind in kinds]
        self.geometry = made[0] if made[0].ngeoms else made[1]
        self.data = self.model.createData()

    def choose(self, joints: list[str]) -> None:
        """Weld everything but some joints, and form pairs."""
        pose = pin.neutral(self.model)
        others = [name for name in self.model.names[1:] if name not in joints]
        for name in others:
            joint = self.model.joints[self.model.getJointId(name)]
            if joint.nq == 1:
                low, high = (x[joint.idx_q] for x in (self.model.lowerPositionLimit, self.model.upperPositionLimit))
                pose[joint.idx_q] = min(max(self.held.get(name, 0.0), low), high)
        ids = [self.model.getJointId(name) for name in others]
        if ids:  # frames of one name, as a joint and a link may have, are refused here
            self.model, self.geometry = pin.buildReducedModel(self.model, self.geometry, ids, pose)
        self.data, geometry = self.model.createData(), self.geometry
        geometry.removeAllCollisionPairs()
        above = [set(self.model.supports[k]) - {0} for k in range(self.model.njoints)]
        bodies = list(geometry.geometryObjects)
        for i in range(len(bodies)):
            for j in range(i):
                if len(above[bodies[i].parentJoint] ^ above[bodies[j].parentJoint]) > 1:
                    geometry.addCollisionPair(pin.CollisionPair(j, i))
        self.labels = [f"{bodies[p.first].name} - {bodies[p.second].name}" for p in geometry.collisionPairs]
        self.around = geometry.copy()
        for body in self.around.geometryObjects:
            if isinstance(body.geometry, coal.BVHModelOBBRSS):
                body.geometry.buildConvexHull(True, "Qt")
                body.geometry = body.geometry.convex
        self.gaps, self.hulls = geometry.createData(), self.around.createData()
        low, high = np.maximum(self.model.lowerPositionLimit, -math.pi), np.minimum(
            self.model.upperPositionLimit, math.pi
        )  # fmt: skip
        self.low = np.array([-math.pi if j.nq == 2 else low[j.idx_q] for j in self.model.joints[1:]])
        self.high = np.array([math.pi if j.nq == 2 else high[j.idx_q] for j in self.model.joints[1:]])
        self.names = list(self.model.names[1:])

    def overlapping(self, q: np.ndarray, ask: np.ndarray) -> np.ndarray:
        """Tell which of the pairs asked for overlap in a pose."""
        pose = np.empty(self.model.nq)
        for joint, angle in zip(self.model.joints[1:], q, strict=True):
            pose[joint.idx_q : joint.idx_q + joint.nq] = (
                [math.cos(angle), math.sin(angle)] if joint.nq == 2 else angle
            )
        near = self._found(self.around, self.hulls, pose, ask)
        return self._found(self.geometry, self.gaps, pose, near) if near.any() else near

    def _found(self, geometry, data, pose, ask) -> np.ndarray:
        pin.updateGeometryPlacements(self.model, self.data, geometry, data, pose)
        found = np.zeros(len(ask), dtype=bool)
        for k in np.flatnonzero(ask):
            found[k] = pin.computeCollision(geometry, data, int(k))
        return found


def whole(path: Path, folder: str) -> Path:
    """A URDF as MuJoCo reads it: with the whole paths of its meshes."""
    made = with_paths(path, folder)
    text, kept = made.read_text(encoding="utf-8"), '<mujoco><compiler strippath="false"/></mujoco>'
    made.write_text(text.replace("</robot>", f"{kept}</robot>"), encoding="utf-8")
    return made


class ByMujoco:
    """An MJCF, or a URDF; what MuJoCo calls a contact of bodies that overlap."""

    by = "MuJoCo"

    def __init__(self, path: Path, held: dict[str, float]) -> None:
        with tempfile.TemporaryDirectory() as folder:
            self.held = held
            self.model = mujoco.MjModel.from_xml_path(str(path if path.suffix == ".xml" else whole(path, folder)))
        self.data, self.seen = mujoco.MjData(self.model), {}

    def choose(self, joints: list[str]) -> None:
        """The order of the joints."""
        named = [mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_JOINT, k) for k in range(self.model.njnt)]
        self.names, self.labels = list(joints), []
        self.at = [self.model.jnt_qposadr[named.index(name)] for name in joints]
        span = np.array([self.model.jnt_range[named.index(name)] for name in joints])
        free = np.array([not self.model.jnt_limited[named.index(name)] for name in joints])
        self.low, self.high = np.where(free, -math.pi, span[:, 0]), np.where(free, math.pi, span[:, 1])
        for name, value in self.held.items():
            self.data.qpos[self.model.jnt_qposadr[named.index(name)]] = value
        weld = self.model.body_weldid
        self.pairs = [
            (a, b) for b in range(self.model.ngeom) for a in range(b)
            if self.touchable(a) and self.touchable(b) and self.between(weld, a, b) > 1
        ]  # fmt: skip
        self.labels = [f"{self.body(a)} - {self.body(b)}" for a, b in self.pairs]

    def touchable(self, geom: int) -> bool:
        """Tell whether a geom is there for contacts."""
        return bool(self.model.geom_contype[geom] or self.model.geom_conaffinity[geom])

    def body(self, geom: int) -> str:
        """Name of a geom's body."""
        return self.model.body(self.model.geom_bodyid[geom]).name

    def between(self, weld, a: int, b: int) -> int:
        """Moving bodies on the way from one to another."""

        def above(geom: int) -> set[int]:
            chain, body = set(), int(weld[self.model.geom_bodyid[geom]])
            while body:
                chain.add(body)
                body = int(weld[self.model.body_parentid[body]])
            return chain

        return len(above(a) ^ above(b))

    def overlapping(self, q: np.ndarray, ask: np.ndarray) -> np.ndarray:
        """Tell which of the pairs asked for overlap in a pose."""
        self.data.qpos[self.at] = q
        mujoco.mj_kinematics(self.model, self.data)
        found = np.zeros(len(ask), dtype=bool)
        for k in np.flatnonzero(ask):
            a, b = self.pairs[k]
            apart = np.linalg.norm(self.data.geom_xpos[a] - self.data.geom_xpos[b])
            if (
                apart < self.model.geom_rbound[a] + self.model.geom_rbound[b]
                or not self.model.geom_rbound[[a, b]].all()
            ):
                found[k] = mujoco.mj_geomDistance(self.model, self.data, a, b, 0.01, None) < 0.0
                found[k] = found[k] and self.by_triangles(a, b)
        return found

    def by_triangles(self, a: int, b: int) -> bool:
        """Tell whether two geoms overlap by the triangles of their meshes; MuJoCo goes by the hulls of these."""
        bodies = [self.body_of(geom) for geom in (a, b)]
        if None in bodies or int(mujoco.mjtGeom.mjGEOM_MESH) not in self.model.geom_type[[a, b]].tolist():
            return True
        places = [
            coal.Transform3s(self.data.geom_xmat[g].reshape(3, 3).copy(), self.data.geom_xpos[g].copy())
            for g in (a, b)
        ]
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        return coal.collide(bodies[0], places[0], bodies[1], places[1], request, result) > 0

    def body_of(self, geom: int):
        """A geom for Coal; None where it has none."""
        if geom not in self.seen:
            kind, size, kinds = int(self.model.geom_type[geom]), self.model.geom_size[geom], mujoco.mjtGeom
            made = {
                int(kinds.mjGEOM_MESH): lambda: self.triangles(self.model.mesh(self.model.geom_dataid[geom])),
                int(kinds.mjGEOM_BOX): lambda: coal.Box(*(2.0 * size)),
                int(kinds.mjGEOM_SPHERE): lambda: coal.Sphere(size[0]),
                int(kinds.mjGEOM_CAPSULE): lambda: coal.Capsule(size[0], 2.0 * size[1]),
                int(kinds.mjGEOM_CYLINDER): lambda: coal.Cylinder(size[0], 2.0 * size[1]),
            }.get(kind)
            self.seen[geom] = made() if made else None
        return self.seen[geom]

    def triangles(self, mesh):
        """A mesh for Coal."""
        vertices = self.model.mesh_vert[mesh.vertadr[0] : mesh.vertadr[0] + mesh.vertnum[0]]
        faces = self.model.mesh_face[mesh.faceadr[0] : mesh.faceadr[0] + mesh.facenum[0]]
        made = coal.BVHModelOBBRSS()
        made.beginModel(len(faces), len(vertices))
        for a, b, c in vertices[faces].astype(float):
            made.addTriangle(a, b, c)
        made.endModel()
        return made


def counted_by(path: Path, held: dict[str, float], joints: list[str]) -> ByPinocchio | ByMujoco:
    """The program that counts: of a URDF Pinocchio, and MuJoCo where that refuses it."""
    refused: list[str] = []
    for program in (ByMujoco,) if path.suffix == ".xml" else (ByPinocchio, ByMujoco):
        try:
            other = program(path, held)
            other.choose(joints)
        except Exception as error:  # whatever the other program throws
            refused.append(f"{program.by}: {type(error).__name__}: {error}")
        else:
            return other
    raise ValueError("; ".join(refused))


def measure(text: str, budget: float, rate: float, more: list[str]) -> Row:
    """One arm."""
    path, *options = shlex.split(text)
    held = dict(pairwise(options))
    locked = {word.split("=")[0]: float([*word.split("="), "0"][1]) for key, word in held.items() if key == "--lock"}
    name = name_of(text)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "plan"
        code, said, wall = planned(Path(path), options, budget, out, more)
        if not (out / "plan.json").is_file():
            return Row(name, 0, code, "refused", wall, 0, 0, "", 0, 0, "", said)
        verdict = json.loads((out / "preflight.json").read_text(encoding="utf-8"))["verdict"]
        joints, q = motion(out / "plan.json", rate)
    try:
        other = counted_by(Path(path), locked, joints)
    except ValueError as error:
        said = " ".join(str(error).split())
        return Row(name, len(joints), code, f"{verdict}, not counted", wall, len(q), 0, "", 0, 0, "", said)
    q = q[:, [joints.index(each) for each in other.names]]
    rng, every = np.random.default_rng(0), np.ones(len(other.labels), dtype=bool)
    poses = rng.uniform(other.low, other.high, (LOOKED, len(other.names)))
    usual = np.mean([other.overlapping(pose, every) for pose in poses], axis=0)
    ask, count = usual < ALWAYS, Counter()
    for pose in q:
        count.update(other.labels[k] for k in np.flatnonzero(other.overlapping(pose, ask)))
    worst = "; ".join(f"{pair} {times}" for pair, times in count.most_common(2))
    overlaps, kept = sum(count.values()), int(ask.sum())
    return Row(name, len(joints), code, verdict, wall, len(q), overlaps, worst, kept, len(ask) - kept, other.by, "")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("arm", nargs="+", help="a description with the options that it needs")
    parser.add_argument("--budget", type=float, default=10.0, help="wall time of each search [s]")
    parser.add_argument("--rate", type=float, default=250.0, help="samples a second that are looked at")
    parser.add_argument("--options", default="", help="what every command is given besides, in quotes")
    parser.add_argument("--to", type=Path, help="file that rows are added to; arms that it has are passed over")
    options = parser.parse_args()
    there = options.to.read_text(encoding="utf-8") if options.to and options.to.is_file() else ""

    def tell(line: str) -> None:
        print(line, flush=True)
        if options.to:
            with options.to.open("a", encoding="utf-8") as file:
                file.write(line + "\n")

    if not there:
        tell(f"| {COLUMNS} |")
        tell("|---" * len(COLUMNS.split("|")) + "|")
    for text in options.arm:
        if f"| {name_of(text)} |" not in there:
            tell(measure(text, options.budget, options.rate, shlex.split(options.options)).line())


if __name__ == "__main__":
    main()
