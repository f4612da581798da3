"""Chapters of the page: summary, audit of the published results, errata, and extent of the study."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.estimation.estimators import ThesisNLP
from armid.report.data.number_format import fixed, short
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell
from armid.thesis.algorithm_corrections import HOLDING
from armid.thesis.errata import Erratum
from armid.thesis.page.chapter_elements import List, Numbers, Text, chapter, counted, named, number, subscripts
from armid.thesis.published import published
from armid.thesis.reduction import ALIKE
from armid.thesis.reproduction import Thesis
from armid.thesis.setting import Extent
from armid.validation.smallest_mass_matrix import POSES, STARTS

TELLING = ("MYR_2", "MYR_4", "MYR_5", "MYR_6", "XXR_2", "ZZR_2", "ZZR_1")
"""Base parameters whose estimates show which sign of gravity was used."""


def _extent(thesis: Thesis) -> str:
    """Text that the study is shortened, with its extent; empty for the whole study."""
    had, whole = thesis.setting.extent, Extent()
    if had == whole:
        return ""
    return (
        f" <b>This is a shortened study</b>: {had.seeds} seeds of the noise (the whole one has {whole.seeds}), "
        f"{had.starts} random starts ({whole.starts}), logs at {had.rate:g}&nbsp;Hz ({whole.rate:g}); "
        "<code>armid thesis</code> runs the whole one."
    )


def show_summary(thesis: Thesis) -> Section:
    """Chapter with the abstract: the main results of the study of the thesis."""
    steps = {step.key: step.errors for step in thesis.steps.rows}
    spread, audit, designs = thesis.steps.spread, thesis.audit, thesis.designs
    printed, one_sided, columns = steps["printed"], steps["one-sided"], steps["columns"]
    items = (
        (fixed(printed.unseen, 3), "N·m", "error on validation motion, Algorithm 3 as printed"),
        (fixed(one_sided.unseen, 3), "N·m", "the same with the right sign of gravity and periodic edges"),
        (short(columns.unseen, 2), "N·m", "and with the filter on both sides"),
        (fixed(float(np.median(spread.corrected_ratio)), 0), "×", "residual of the wrong sign of gravity"),
        (fixed(audit.base.certificate.distance, 3), "", "distance of Table 4.1 from the nearest real body"),
        (fixed(designs.best.condition, 1), "", "condition number of the trajectory that is kept"),
    )
    return chapter(
        "Abstract",
        Text(
            "This page repeats the study of [Halper2024], the identification of the dynamic parameters of a hanging "
            "KUKA LBR iiwa 14 R820, with all its tables and figures, on a simulated arm, so that every estimate can "
            "be compared with the truth: first as the thesis is printed, then with each correction in turn. It "
            "checks every equation of the derivation and the published tables, and looks for the cause of the "
            "residual that "
            "the thesis reports. All numbers are computed, except those that are marked as printed."
            f"{_extent(thesis)}"
        ),
        Numbers(items),
        List(_findings(thesis)),
    )


def _findings(thesis: Thesis) -> tuple[str, ...]:
    """Main results of the study, one sentence or two for each."""
    steps = {step.key: step.errors for step in thesis.steps.rows}
    audit, dynamics, found = thesis.audit, thesis.dynamics, thesis.reduction
    printed, one_sided, columns = steps["printed"], steps["one-sided"], steps["columns"]
    doubtful = sum(each.typesetting for each in thesis.errata)
    median, largest = audit.deviations.printed_error
    implied, distance = audit.deviations.implied, audit.base.certificate.distance
    wrong = [line for line in found.groupings if line.error > ALIKE]
    return (
        f"The Lagrangian regressor and that of Newton and Euler differ by {short(dynamics.regressor_error, 1)} of "
        f"the largest entry; the rank is {found.rank}, and {len(found.groupings) - len(wrong)} of the "
        f"{len(found.groupings)} lines of (3.39) are exact. Of {len(thesis.errata)} errata, {doubtful} may come from "
        "typesetting or from the copy of the text in use, among them all in (A.1).",
        "The sign of the potential energy is wrong: with (2.21), power along Table A.1 is out of balance by "
        f"{fixed(dynamics.literal_imbalance, 1)}&nbsp;W, with the other sign by {short(dynamics.imbalance, 1)}"
        f"&nbsp;W. {_suspicion(audit.gravity)}",
        "The torque is filtered but the model is not. With the right sign of gravity this alone causes an error of "
        f"{fixed(one_sided.unseen, 3)}&nbsp;N·m on validation motion; with the same filter on both sides it is "
        f"{short(columns.unseen, 2)}.",
        f"The printed deviations imply that the thesis had a residual of {fixed(implied[1], 1)} to "
        f"{fixed(implied[2], 1)}&nbsp;N·m; the two errors above give {fixed(printed.residual, 1)}. "
        "<b>Most of the thesis's residual has another cause.</b> Of the candidates that were simulated, "
        "positions that lag the torque by about a tenth of a second come closest.",
        f"No real body has the values of Table 4.1: the nearest are {fixed(distance, 3)} away, of which rounding "
        f"explains {fixed(audit.rounding, 3)}. The search for a pose in which its mass matrix is not positive "
        "definite "
        f"{_no_pose(thesis)}. Table 4.2 violates {len(audit.broken)} of its own constraints.",
        "The printed standard deviations assume white residuals and no bias; on the virtual arm, with Algorithm 3 as "
        f"printed, the true error is {fixed(median, 0)} times as large in the median and {fixed(largest, 0)} times "
        "at most.",
    )


def _no_pose(thesis: Thesis) -> str:
    """Clause with the result of the search for a pose in which the mass matrix is not positive definite.

    The mass matrix is that of Table 4.1 of the thesis.
    """
    smallest = thesis.audit.base.pose.min_eigenvalue
    if smallest <= 0.0:
        return f"found one, with the eigenvalue {short(smallest)}&nbsp;kg·m²"
    return f"found none (smallest eigenvalue {short(smallest)}&nbsp;kg·m²)"


def _evidence(gravity: str) -> str:
    """Sentence with the result of armid's test of the sign of gravity on Table 4.1 of the thesis."""
    return subscripts(gravity).replace("-", "−") if gravity else "armid's test finds nothing."


def _suspicion(gravity: str) -> str:
    return "" if gravity else "armid's own test finds no evidence against it."


def show_audit(thesis: Thesis) -> Section:
    """Chapter on the audit of the published results of the thesis."""
    found = thesis.audit
    deviations = found.deviations
    return chapter(
        "The published results",
        Text(
            "<b>Sign of gravity.</b> Table 4.1 alone was tested for the error: "
            f"{_evidence(found.gravity)} Data of the hanging virtual arm, identified with the printed sign, show the "
            "same pattern: first moments of the opposite sign, and inertias that compensate for it."
        ),
        _signs(thesis),
        Text(_bodies(thesis)),
        Text(
            f"<b>Constraints.</b> Table 4.2 violates {len(found.broken)} of its own constraints by more than "
            f"rounding. Links with a positive definite pseudo-inertia [Wensing2018]: {_sound(found.eigenvalues)}."
        ),
        _broken(thesis),
        Text(
            "Converted to base parameters, Table 4.2 differs from Table 4.1 by "
            f"{fixed(100.0 * found.carried.mismatch, 1)}&nbsp;% in the inertial part."
        ),
        Text(
            f"<b>Standard deviations.</b> {deviations.below_ten} of {len(published().base)} are below 10&nbsp;%; the "
            "thesis says most. The ratio of printed to computed deviations scatters least for Table A.1 in "
            f"{_least_period(thesis)}&nbsp;s. So Table 4.1 itself confirms the trajectory, its period, the order of "
            "the columns and ordinary least squares. But these deviations are too small: filtered residuals are not "
            "white, and deviations do not contain the bias. On the virtual arm, with Algorithm 3 as printed, the "
            f"true error is {fixed(deviations.printed_error[0], 0)} times the deviation in the median and "
            f"{fixed(deviations.printed_error[1], 0)} times at most; with the right sign of gravity, "
            f"{fixed(deviations.one_sided_error[0], 0)} and {fixed(deviations.one_sided_error[1], 0)} times. These "
            f"are the deviations of all {thesis.setting.extent.rate:g}&nbsp;rows a second."
        ),
        _scatter(thesis),
        Text(
            f"<b>Condition number.</b> {published().condition:g} in print; {_condition(thesis)} in "
            f"{found.conditions.period[1]:g}&nbsp;s, {fixed(found.conditions.hanging[0], 2)} in the "
            f"{found.conditions.period[0]:g}&nbsp;s of the design. The printed number is "
            f"{fixed(100.0 * (found.conditions.hanging[1] / published().condition - 1.0), 1)}&nbsp;% below the "
            "first. Without b₁₀, which is missing in the table that we have, it is "
            f"{fixed(found.conditions.without_last, 2)}: "
            "closer, but the condition number depends so little on this row that it proves nothing."
        ),
        _tables(thesis),
    )


def _bodies(thesis: Thesis) -> str:
    """Text on the distance of Table 4.1 from real bodies, and on its mass matrix."""
    found = thesis.audit
    base, physical = found.base, found.physical
    along, physical_along = base.along, physical.along
    assert along is not None and physical_along is not None  # they are asked for along Table A.2
    worst = ", ".join(f"{subscripts(each.name)} by {fixed(each.change, 3)}" for each in base.certificate.blame[:4])
    return (
        "<b>Bodies.</b> No real body has the values of Table 4.1. The nearest lie "
        f"{fixed(base.certificate.distance, 3)} away, "
        f"{fixed(100.0 * base.certificate.relative_distance, 2)}&nbsp;% of the table's length, mostly in "
        f"{worst}; with no link above {base.heaviest:g}&nbsp;kg, {fixed(base.limited.distance, 3)}. Rounding to "
        f"three decimals explains {fixed(found.rounding, 3)}. A search for a pose within the joint limits in "
        f"which M(q) is not positive definite, from the worst {STARTS} of {POSES} random poses, "
        f"{_no_pose(thesis)}; "
        f"this is no proof. Along Table A.2 the smallest eigenvalue is {short(along.min_eigenvalue)} (for Table "
        "4.2 "
        f"{short(physical.pose.min_eigenvalue)} in the search and {short(physical_along.min_eigenvalue)} along "
        "Table A.2). So the thesis's test is necessary, not sufficient."
    )


def _sound(eigenvalues: np.ndarray) -> str:
    sound = [str(k + 1) for k, value in enumerate(eigenvalues.tolist()) if value >= 0.0]
    return f"link {', '.join(sound)}" if sound else "none"


def _condition(thesis: Thesis) -> str:
    found = thesis.audit.conditions
    return f"{fixed(found.hanging[1], 2)} for the hanging arm and {fixed(found.literal[1], 2)} for the printed sign"


def _least_period(thesis: Thesis) -> str:
    found = thesis.audit.deviations
    return f"{found.period[int(np.argmin(found.literal))]:g}"


def _signs(thesis: Thesis) -> Table:
    found = thesis.results
    place: dict[str, int] = {name: k for k, name in enumerate(found.names)}
    columns = [
        Column("parameter", words=True), Column("truth of the virtual arm"), Column("identified, right sign"),
        Column("identified, sign in print"), Column("Table 4.1"),
    ]  # fmt: skip
    rows = [
        [
            named(name),
            *(
                number(x, fixed(x, 3))
                for x in (
                    found.truth[place[name]], found.corrected.values[place[name]], found.wrong[place[name]],
                    published().base[name][0],
                )
            ),
        ]
        for name in TELLING
    ]  # fmt: skip
    return Table("signs", "Effect of the sign of gravity on an estimate (columns filtered)", columns, rows)


def _broken(thesis: Thesis) -> Table:
    columns = [Column("constraint", words=True), Column("link"), Column("value"), Column("at least")]
    rows = [
        [TableCell(each.constraint), TableCell(str(each.link), float(each.link)),
         number(each.value, fixed(each.value, 4), "poor"), number(each.bound, fixed(each.bound, 4))]
        for each in thesis.audit.broken
    ]  # fmt: skip
    return Table("broken", "Constraints that Table 4.2 violates by more than rounding", columns, rows)


def _scatter(thesis: Thesis) -> Table:
    found = thesis.audit.deviations
    columns = [Column("period", "s"), Column("hanging", "%"), Column("sign in print", "%")]
    rows = [
        [TableCell(f"{period:g}", float(period)), *(number(100.0 * x, fixed(100.0 * x, 1)) for x in values)]
        for period, *values in zip(found.period, found.hanging, found.literal, strict=True)
    ]
    note = f"Standard deviation of ln(printed / computed deviation), {subscripts(found.outlier)} left out."
    return Table("scatter", "Deviations in print, compared with those from Table A.1", columns, rows, note)


def _tables(thesis: Thesis) -> Table:
    columns = [
        Column("table", words=True), Column("|Σ bₗ / l|"), Column("|Σ aₗ|"), Column("|Σ l bₗ|"),
        Column("share of (3.55d)", "%"), Column("share of (3.55e)", "%"), Column("above (3.55f)"),
        Column("above it without 1/L"),
    ]  # fmt: skip
    rows = [
        [
            TableCell(name),
            *(number(x, short(x, 1)) for x in each.sums[:2]),
            TableCell("used for b₁₀", "") if name == "A.1" else number(each.sums[2], short(each.sums[2], 1)),
            *(number(100.0 * x, fixed(100.0 * x, 1)) for x in (each.position_share, each.velocity_share)),
            *(TableCell(str(x), float(x)) for x in (each.above_literal, each.above)),
        ]
        for name, each in zip(("A.1", "A.2"), thesis.audit.tables, strict=True)
    ]
    note = (
        "Sums: largest over the joints, from five printed digits. In Table A.1, Σ l bₗ = 0 gives the missing row b₁₀ "
        "and is no check; |Σ bₗ / l| is. Shares: largest over the joints. Above: number of "
        "pairs (a, b)."
    )
    return Table("coefficients", "Tables A.1 and A.2, checked against the conditions (3.55)", columns, rows, note)


def show_errata(thesis: Thesis) -> Section:
    """Chapter with the table of the errata of the thesis."""
    columns = [
        Column("where", words=True), Column("in print", words=True), Column("right", words=True),
        Column("what shows it", words=True), Column("in print "), Column("right "),
    ]  # fmt: skip
    rows = [
        [
            TableCell(subscripts(each.item) + (" ○" if each.typesetting else ""), each.item),
            TableCell(subscripts(each.printed), each.printed, kind="formula"),
            TableCell(subscripts(each.right), each.right, kind="formula"),
            TableCell(subscripts(each.shown), each.shown),
            *_values(each),
        ]
        for each in thesis.errata
    ]
    note = "○ perhaps an error of typesetting, or of the copy of the text in use."
    return chapter("Errata", Table("errata", "Errata, each with the number that shows it", columns, rows, note))


def _values(each: Erratum) -> tuple[TableCell, TableCell]:
    if np.isnan(each.right_value):
        return TableCell("", ""), TableCell("", "")
    cells: list[TableCell] = []
    for value in (each.printed_value, each.right_value):
        if not np.isfinite(value):
            cells.append(TableCell("∞", "inf"))
        elif float(value).is_integer() and abs(value) >= 1.0:
            cells.append(number(value, f"{int(value):,}".replace(",", "\u00a0").replace("-", "−")))
        else:
            cells.append(number(value, short(value)))
    return cells[0], cells[1]


def _bounds() -> str:
    """Text with the bounds of this study for equation (3.52b): masses, centres of mass and moments of inertia."""
    used = replace(ThesisNLP(), **HOLDING)
    (light, heavy), (small, large) = used.mass, used.moment
    return f"{light:g} to {heavy:g}&nbsp;kg, ±&nbsp;{used.com:g}&nbsp;m, {small:g} to {large:g}&nbsp;kg·m²"


REFERENCES = (
    "[Halper2024] S. Halper: Identification of the dynamic parameters of the KUKA LBR iiwa R820. Bachelor thesis, TU "
    "Wien, Automation and Control Institute, 2024.",
    "[Fike2011] J. A. Fike, J. J. Alonso: The Development of Hyper-Dual Numbers for Exact Second-Derivative "
    "Calculations. 49th AIAA Aerospace Sciences Meeting, 2011.",
    "[Gautier1990] M. Gautier, W. Khalil: Direct Calculation of Minimum Set of Inertial Parameters of Serial Robots. "
    "IEEE Transactions on Robotics and Automation 6(3), 1990.",
    "[Khalil2004] W. Khalil, E. Dombre: Modeling, Identification and Control of Robots. Butterworth-Heinemann, 2004.",
    "[Spong1987] M. W. Spong: Modeling and control of elastic joint robots. Journal of Dynamic Systems, Measurement, "
    "and Control 109(4), 1987.",
    "[Swevers1997] J. Swevers, C. Ganseman, D. B. Tükel, J. De Schutter, H. Van Brussel: Optimal Robot Excitation "
    "and Identification. IEEE Transactions on Robotics and Automation 13(5), 1997.",
    "[Wensing2018] P. M. Wensing, S. Kim, J.-J. E. Slotine: Linear Matrix Inequalities for Physically Consistent "
    "Inertial Parameter Identification. IEEE Robotics and Automation Letters 3(1), 2018.",
)
"""Works that the page cites."""


def show_references(thesis: Thesis) -> Section:
    """Chapter with the works that the page cites."""
    del thesis  # the same for every run
    return chapter("References", List(REFERENCES))


def show_provenance(thesis: Thesis) -> Section:
    """Chapter on the extent and method of the study, and on open questions."""
    extent = thesis.setting.extent
    return chapter(
        "How this was made",
        Text(
            "<code>armid thesis</code>: "
            f"{counted(extent.seeds, 'seed')}, {counted(extent.starts, 'start')} of Algorithm 2 with "
            f"{extent.stages} stages each, recordings at {extent.rate:g}&nbsp;Hz along the exact motion and at "
            f"{extent.lab_rate:g}&nbsp;Hz in closed loop, with {counted(extent.repetitions, 'repetition')}, "
            f"(3.52) solved from {counted(extent.searches, 'starting point')}, {extent.poses} random states. The "
            f"bounds of (3.52b) are not published; the bounds of this study, {_bounds()}, hold Table 4.2. "
            "<code>thesis.json</code> beside this page has every number in full precision, "
            "<code>tables</code> has every table as CSV and LaTeX."
        ),
        Text(
            "Open questions: the thesis's recordings are not published, so the statement on their sign of gravity "
            "relies on its tables. A standing arm with the equations of a hanging one would give the same signs. In "
            "the table of steps the virtual arm has rigid joints and its tracking is perfect; elastic joints and a "
            "closed loop are among the candidates for the residual. Rotor inertia and stiffness of the virtual arm "
            "are typical values, not measured ones."
        ),
    )
