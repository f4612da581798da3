"""Chapters of the page on section 3.1 of the thesis: the arm, its dynamics, friction, and base parameters."""

from __future__ import annotations

import numpy as np

from armid.report.data.number_format import fixed, short
from armid.report.plots.plot_specification import Plot, PlotTrace
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell
from armid.thesis.derivation import Identity
from armid.thesis.page.chapter_elements import Figures, Text, chapter, named, number, subscripts
from armid.thesis.page.equations import DYNAMICS, POTENTIAL, REGRESSOR, TRANSFORM
from armid.thesis.page.illustrations import foundations, schematic
from armid.thesis.published import published
from armid.thesis.reduction import Dependence, Grouping, Reduction
from armid.thesis.reproduction import Thesis

FASTEST = 1.5
"""Largest velocity on the abscissa of Figure 3.2 of the thesis [rad/s]."""

ROUNDING = 1e-12
"""Largest relative difference that counts as a rounding error."""


def show_kinematics(thesis: Thesis) -> Section:
    """Chapter on Table 3.1 of the thesis and the forward kinematics of the arm."""
    found = thesis.kinematics
    pose = ", ".join(fixed(q, 1) for q in found.pose)
    return chapter(
        "The arm",
        Text(
            "The KUKA LBR iiwa 14 R820 hangs: gravity is the acceleration (0, 0, +9.81)&nbsp;m/s² in its base. "
            "Transformations are <i>H</i> = T<sub>y</sub>(d<sub>y</sub>) T<sub>z</sub>(d<sub>z</sub>) "
            "R<sub>z</sub>(φ) R<sub>x</sub>(θ) R<sub>z</sub>(ψ), (3.1). The thesis gives the lengths as symbols; the "
            "numbers here are those of the arm."
        ),
        TRANSFORM,
        schematic(),
        _table_31(),
        Text(
            f"At {found.poses} random poses within the joint limits (3.1) differs from the arm's own description by "
            f"{short(found.rotation_error, 1)} in an entry of a rotation and {short(found.position_error, 1)}&nbsp;m "
            "in an origin, which is rounding."
        ),
        _origins(thesis, pose),
    )


def _size(error: float) -> str:
    """Text of a relative difference; the text states if the difference is only a rounding error."""
    return short(error, 2) if error > ROUNDING else f"{short(error, 1)}, which is rounding,"


def _table_31() -> Table:
    columns = [
        Column("link n"),
        *(Column(x) for x in ("d along y", "d along z", "φₙ", "θₙ", "ψₙ")),
        Column("length", "m"),
    ]
    rows = [
        [
            TableCell(str(k + 1)),
            *(TableCell(subscripts(symbol).replace("-", "−"), symbol) for symbol in row),
            number(published().lengths[k], fixed(published().lengths[k], 4)),
        ]
        for k, row in enumerate(published().frames)
    ]
    note = "The last column is not in the thesis; it gives the value of the row's d."
    return Table("table-3-1", "Table 3.1: parameters of the KUKA LBR iiwa R820", columns, rows, note)


def _origins(thesis: Thesis, pose: str) -> Table:
    found = thesis.kinematics
    columns = [Column("frame", words=True), Column("z at q = 0", "m"), *(Column(c, "m") for c in "xyz")]
    rows = [
        [
            TableCell("flange" if k == len(found.origins) - 1 else str(k + 1)),
            number(found.heights[k], fixed(found.heights[k], 4)),
            *(number(x, fixed(x, 6)) for x in origin),
        ]
        for k, origin in enumerate(found.origins)
    ]
    return Table("origins", f"Origins of the frames at q = 0 and at q = ({pose}) rad", columns, rows)


def show_dynamics(thesis: Thesis) -> Section:
    """Chapter on the dynamics of the arm, the sign of gravity, and Figure 3.2 of the thesis."""
    found = thesis.dynamics
    return chapter(
        "Lagrange, Newton and Euler",
        foundations(),
        Text(
            "The thesis derives its regressor by differentiation of the Lagrangian, (2.37). So does this study: "
            "β of (2.33) is computed from Table 3.1 by (3.9) in hyper-dual numbers [Fike2011], which give exact "
            "second derivatives, and Y<sub>ij</sub> = d/dt ∂β/∂q̇ − ∂β/∂q. armid's kernel computes the same matrix "
            "by the "
            f"Newton-Euler recursion. At {found.states} random states the two differ by "
            f"{_size(found.regressor_error)} of the largest entry."
        ),
        REGRESSOR,
        Text(
            "From the same Lagrangian, M(q) = ∂²L/∂q̇∂q̇ differs from armid's by "
            f"{_size(found.mass_error)} of its largest entry, and "
            "M(q) q̈ + C(q, q̇) q̇ + g(q) + F<sub>v</sub> q̇ + F<sub>s</sub> sgn(q̇), (3.3), from Y π by "
            f"{_size(found.torque_error)} of the largest torque."
        ),
        DYNAMICS,
        Text(
            "<b>The sign of gravity.</b> (2.21) gives U = +Σ m g<sub>0</sub>ᵀ p with g<sub>0</sub> along gravity, "
            "(3.2); but potential energy falls along gravity, so the sign must be minus. With minus, power is "
            f"balanced along Table A.1 in 20&nbsp;s to {short(found.imbalance, 2)}&nbsp;W, the error of a difference "
            f"quotient; with the printed sign the imbalance is up to {fixed(found.literal_imbalance, 1)}&nbsp;W. The "
            "printed equations are those of a standing arm."
        ),
        POTENTIAL,
        _torques(thesis),
        _friction(thesis),
    )


def _torques(thesis: Thesis) -> Table:
    found = thesis.dynamics
    columns = [Column("joint"), Column("U = −Σ m gᵀp", "N·m"), Column("U = +Σ m gᵀp, in print", "N·m")]
    rows = [
        [TableCell(str(j + 1)), number(found.torque[j], fixed(found.torque[j], 6)),
         number(found.literal_torque[j], fixed(found.literal_torque[j], 6))]
        for j in range(len(found.torque))
    ]  # fmt: skip
    note = (
        "Bodies of the description, without friction, at q of the table above, q̇ = (0.3, −0.2, 0.1, 0.4, −0.5, 0.6, "
        "−0.7) rad/s, q̈ = (1, −1, 2, −2, 3, −3, 4) rad/s²."
    )
    return Table("state-torque", "Torque at one state under the two signs", columns, rows, note)


def _friction(thesis: Thesis) -> Figures:
    of: dict[str, float] = dict(zip(thesis.results.names, thesis.results.truth.tolist(), strict=True))
    viscous, coulomb = of["FV_1"], of["FS_1"]
    half = np.linspace(0.0, FASTEST, 50)
    dq = np.concatenate([-half[::-1], half])
    sign = np.concatenate([-np.ones(50), np.ones(50)])
    parts = (
        ("a", "viscous", f"F<sub>v</sub> q̇, {fixed(viscous, 3)} N·m·s/rad", viscous * dq),
        ("b", "Coulomb", f"F<sub>s</sub> sgn(q̇), {fixed(coulomb, 3)} N·m", coulomb * sign),
        ("c", "both", "their sum", viscous * dq + coulomb * sign),
    )
    plots = [
        Plot(
            f"figure-3-2-{letter}", f"({letter})", f"{what}: {words}".replace("<sub>", "").replace("</sub>", ""),
            "velocity [rad/s]", "friction [N·m]", (PlotTrace("measured", dq, torque, what),),
        )
        for letter, what, words, torque in parts
    ]  # fmt: skip
    return Figures("Figure 3.2: friction models, with the numbers of joint 1 in Table 4.1", plots, 3)


def show_base(thesis: Thesis) -> Section:
    """Chapter on the base parameters of the thesis: zero and dependent columns of the regressor, and Algorithm 1.

    It contains equations (A.1), (3.33), (3.38) and (3.39).
    """
    found = thesis.reduction
    names = [name for name in found.removed if name not in found.zero]
    return chapter(
        "Base parameters",
        Text(
            f"Y has {found.columns} columns and rank {found.rank}: singular value {found.rank} is "
            f"{short(found.singular[0], 2)} of the largest, the next {short(found.singular[1], 2)}. "
            f"{len(found.zero)} columns are zero: {_listed(found.zero)}. {len(names)} more depend on others: "
            f"{_listed(names)}. {_removed(found)} The other columns belong to the {len(found.names)} parameters of "
            "(3.38) [Gautier1990; Khalil2004]."
        ),
        _dependences(found.dependences),
        _identities(found.identities),
        _groupings(found.groupings),
        Text(
            "<b>Algorithm 1</b> ends with a check of Y<sub>b</sub> π<sub>b</sub>(π(μ)) against τ(μ) from M, C and g. "
            "Here M is (2.19), with the Jacobians of the centres of mass and inertias about them, C has the "
            "Christoffel symbols of this M, and g is the gradient of U, all from the physical parameters μ and Table "
            "3.1 alone. The largest difference is "
            f"{_size(found.torque_error)} of the largest torque. <code>armid export RUN --to matlab</code> writes "
            "the functions of its last lines: func_Y, func_Y_b, func_pi and func_pi_b."
        ),
    )


def _removed(found: Reduction) -> str:
    """Sentence that compares the removed columns of the regressor with equation (3.33) of the thesis."""
    printed = set(published().removed)
    odd = printed ^ set(found.removed)
    equal = "which equals (3.33)" if not odd else f"which differs from (3.33) in {_listed(sorted(odd))}"
    return f"These {len(found.removed)} columns belong to π<sub>r</sub>, {equal}."


def _listed(names: tuple[str, ...] | list[str]) -> str:
    return ", ".join(subscripts(name) for name in names)


def _verdict(error: float) -> TableCell:
    """Table cell with a relative error; the cell is marked if the error is larger than rounding errors."""
    if not np.isfinite(error):
        return TableCell("unreadable", kind="poor")
    good = error < ROUNDING
    return number(error, "0" if error == 0.0 else short(error, 1 if good else 2), "" if good else "poor")


def _dependences(lines: tuple[Dependence, ...]) -> Table:
    columns = [
        Column("column", words=True), Column("label in print", words=True), Column("sum in print", words=True),
        Column("error"), Column("sum as it should be", words=True), Column("error "),
    ]  # fmt: skip
    rows = [
        [
            named(line.column),
            TableCell(subscripts(line.label) + ("" if line.label == line.column else " ▼"), line.label),
            TableCell(subscripts(line.printed) or "–", line.printed, kind="formula"),
            _verdict(line.printed_error),
            TableCell(subscripts(line.right), line.right, kind="formula"),
            _verdict(line.right_error),
        ]
        for line in lines
    ]
    note = (
        "From the copy of the text in use. A name denotes its column of Y. ▼ marks labels of another column than the "
        "removed one, many of them perhaps errors of typesetting; where the label is a column, the sum is compared "
        "with that column. Errors are divided by the largest entry of the two sides."
    )
    return Table("a-1", "(A.1): columns that are removed", columns, rows, note)


def _identities(found: tuple[Identity, ...]) -> Table:
    columns = [Column("number", words=True), Column("identity between the β of links", words=True), Column("error")]
    rows: list[list[TableCell]] = []
    for each in found:
        wrong = ", in print" if each.right else ""
        rows.append([TableCell(each.number + wrong), TableCell(each.printed, kind="formula"), _verdict(each.error)])
        if each.right:
            rows.append(
                [
                    TableCell(f"{each.number}, right"),
                    TableCell(each.right, kind="formula"),
                    _verdict(each.right_error),
                ]
            )
    note = (
        "A name stands for the β of this parameter, with the sign of gravity in print; d is the vector to frame n in "
        "frame n − 1. Error: largest difference of the sides, divided by the largest left side, all links. The "
        "velocities are those of the joint axes in the base frame."
    )
    return Table("identities", "Equations (3.9) to (3.30) of the derivation", columns, rows, note)


def _groupings(found: tuple[Grouping, ...]) -> Table:
    columns = [Column("parameter", words=True), Column("sum in print", words=True), Column("error")]
    rows = [
        [named(each.name), TableCell(subscripts(each.printed), each.printed, kind="formula"), _verdict(each.error)]
        for each in found
    ]
    right = sum(each.error < ROUNDING for each in found)
    note = (
        "Error: largest difference of a coefficient from that of the geometry. "
        f"{right} of {len(found)} lines are right."
    )
    return Table("groupings", "(3.39): base parameters by standard parameters", columns, rows, note)
