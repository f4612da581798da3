"""Chapters of the page: summary, audit of the published results, errata, and extent of the study."""

from __future__ import annotations

import numpy as np

from armid.report.data.number_format import fixed, short
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell
from armid.thesis.errata import Erratum
from armid.thesis.page.chapter_elements import List, Numbers, Text, chapter, counted, named, number, subscripts
from armid.thesis.published import published
from armid.thesis.reproduction import Thesis
from armid.thesis.setting import Extent

TELLING = ("MYR_2", "MYR_4", "MYR_5", "MYR_6", "XXR_2", "ZZR_2", "ZZR_1")
"""Base parameters whose estimates show which sign of gravity was used."""


def _extent(thesis: Thesis) -> str:
    """Note on the page that the study is shortened; empty for the whole study."""
    had, whole = thesis.setting.extent, Extent()
    if had == whole:
        return ""
    return (
        f" <b>This is a shortened study</b>: {had.seeds} seeds of the noise (the whole one has {whole.seeds}), "
        f"{had.starts} random starts ({whole.starts}), logs at {had.rate:g}&nbsp;Hz ({whole.rate:g}); "
        "<code>armid thesis</code> runs the whole one."
    )


def show_summary(thesis: Thesis) -> Section:
    """Chapter with the main results of the study of the thesis."""
    steps = {step.key: step.errors for step in thesis.steps.rows}
    spread, audit, designs = thesis.steps.spread, thesis.audit, thesis.designs
    printed, columns = steps["printed"], steps["columns"]
    items = (
        (fixed(printed.unseen, 3), "N·m", "error on validation motion, Algorithm 3 as printed"),
        (short(columns.unseen, 2), "N·m", "the same with the filter on both sides"),
        (fixed(float(np.median(spread.corrected_ratio)), 0), "×", "residual of the wrong sign of gravity"),
        (fixed(audit.base.certificate.distance, 3), "", "distance of Table 4.1 from the nearest real body"),
        (fixed(designs.best.condition, 1), "", "condition number of the trajectory that is kept"),
    )
    return chapter(
        "Summary",
        Numbers(items),
        Text(
            "This page runs the study of [Halper2024], the identification of the dynamic parameters of a hanging "
            "KUKA LBR iiwa 14 R820, with all its tables and figures, on a simulated arm, so that every estimate can "
            "be compared with the truth. All numbers are computed, except those that are marked as printed."
            f"{_extent(thesis)}"
        ),
        List(
            (
                f"The model is right: the Lagrangian regressor equals the Newton-Euler one, and the "
                f"{len(thesis.reduction.names)} base parameters of (3.38) and every line of (3.39) are correct. "
                "(A.1) and the equations have printing errors.",
                "The sign of the potential energy is wrong: the printed equations are those of a standing arm, and "
                f"the first moments of Table 4.1 have the corresponding sign. {_suspicion(audit.gravity)}",
                "The torque is filtered but the model is not. This alone causes an error of "
                f"{fixed(printed.unseen, 3)}&nbsp;N·m on validation motion; with the same filter on both sides it is "
                f"{short(columns.unseen, 2)}.",
                "No real body has the values of Table 4.1, although its mass matrix is positive definite; Table 4.2 "
                f"violates {len(audit.broken)} of its own constraints.",
                "The printed standard deviations assume white residuals; on the virtual arm, with Algorithm 3 as "
                f"printed, the true error is {fixed(audit.deviations.error_median, 1)} times as large in the median "
                f"and {fixed(audit.deviations.error_largest, 0)} times at most.",
            )
        ),
    )


def _evidence(gravity: str) -> str:
    """Sentence with the result of armid's test of the sign of gravity on Table 4.1 of the thesis."""
    return subscripts(gravity).replace("-", "−") if gravity else "armid's test finds nothing."


def _suspicion(gravity: str) -> str:
    return "" if gravity else "armid's own test finds no evidence against it."


def show_audit(thesis: Thesis) -> Section:
    """Chapter on the audit of the published results of the thesis."""
    found = thesis.audit
    base, physical, deviations = found.base, found.physical, found.deviations
    along, physical_along = base.along, physical.along
    assert along is not None and physical_along is not None  # they are asked for along Table A.2
    worst = ", ".join(f"{subscripts(each.name)} by {fixed(each.change, 3)}" for each in base.certificate.blame[:4])
    return chapter(
        "The published results",
        Text(
            "<b>Sign of gravity.</b> Table 4.1 alone shows the error. "
            f"{_evidence(found.gravity)} Data of the hanging virtual arm, identified with the printed sign, show the "
            "same pattern: first moments of the opposite sign, and inertias that compensate for it."
        ),
        _signs(thesis),
        Text(
            "<b>Bodies.</b> No real body has the values of Table 4.1. The nearest lie "
            f"{fixed(base.certificate.distance, 3)} away, "
            f"{fixed(100.0 * base.certificate.relative_distance, 2)}&nbsp;% of the table's length, mostly in "
            f"{worst}; with no link above {base.heaviest:g}&nbsp;kg, {fixed(base.limited.distance, 3)}. Rounding to "
            f"three decimals explains {fixed(found.rounding, 3)}. Yet M(q) is positive definite at every pose within "
            f"the joint limits (smallest eigenvalue {short(base.pose.min_eigenvalue)}&nbsp;kg·m² at the worst that a "
            f"search finds, {short(along.min_eigenvalue)} along Table A.2; for Table 4.2 "
            f"{short(physical.pose.min_eigenvalue)} and {short(physical_along.min_eigenvalue)}): the thesis's test "
            "is necessary, not sufficient."
        ),
        Text(
            f"<b>Constraints.</b> Table 4.2 violates {len(found.broken)} of its own constraints by more than "
            f"rounding. Links with a positive definite pseudo-inertia: {_sound(found.eigenvalues)}."
        ),
        _broken(thesis),
        Text(
            "Converted to base parameters, Table 4.2 differs from Table 4.1 by "
            f"{fixed(100.0 * found.carried.mismatch, 1)}&nbsp;% in the inertial part."
        ),
        Text(
            f"<b>Standard deviations.</b> {deviations.below_ten} of 57 are below 10&nbsp;%, as the thesis states. "
            "The ratio of printed to computed deviations scatters least for Table A.1 in 27&nbsp;s. So Table 4.1 "
            "itself confirms the trajectory, its period, the order of the columns and ordinary least squares. "
            "But these deviations are too small: residuals filtered to 3.5&nbsp;Hz are not white, and deviations do "
            "not contain the bias. On the virtual arm, with Algorithm 3 as printed, the true error is "
            f"{fixed(deviations.error_median, 1)} times the deviation in the median and "
            f"{fixed(deviations.error_largest, 0)} times at most."
        ),
        _scatter(thesis),
        Text(
            f"<b>Condition number.</b> {published().condition:g} in print; {_condition(thesis)} in 27&nbsp;s. The "
            "printed number does not belong to the 20&nbsp;s for which the trajectory was designed."
        ),
        _tables(thesis),
    )


def _sound(eigenvalues: np.ndarray) -> str:
    sound = [str(k + 1) for k, value in enumerate(eigenvalues.tolist()) if value >= 0.0]
    return f"link {', '.join(sound)}" if sound else "none"


def _condition(thesis: Thesis) -> str:
    found = thesis.audit.conditions
    return f"{fixed(found.hanging[1], 2)} for the hanging arm and {fixed(found.literal[1], 2)} for the printed sign"


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
            *(number(x, short(x, 1)) for x in each.sums),
            *(number(100.0 * x, fixed(100.0 * x, 1)) for x in (each.position_share, each.velocity_share)),
            *(TableCell(str(x), float(x)) for x in (each.above_literal, each.above)),
        ]
        for name, each in zip(("A.1", "A.2"), thesis.audit.tables, strict=True)
    ]
    note = (
        "Sums: largest over the joints, from five printed digits. Shares: largest over the joints. Above: number of "
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
            "bounds of (3.52b) are not published; the bounds of this study are 0.05 to 15&nbsp;kg, ± 0.5&nbsp;m, "
            "10⁻⁴ to 2&nbsp;kg·m². <code>thesis.json</code> beside this page has every number in full precision, "
            "<code>tables</code> has every table as CSV and LaTeX."
        ),
        Text(
            "Open questions: the thesis's recordings are not published, so the statement on their sign of gravity "
            "relies on its tables. A standing arm with the equations of a hanging one would give the same signs. The "
            "virtual arm has no elasticity; in the table of steps its tracking is perfect."
        ),
    )
