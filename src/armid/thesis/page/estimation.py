"""Chapters of the page on section 3.2, Tables 4.1 and 4.2, and Figures 4.2 and 4.3 of the thesis."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.measurement.processing.options import THESIS
from armid.report.data.number_format import fixed, short
from armid.report.plots.plot_specification import Axes, Plot, line
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell
from armid.thesis.algorithm import NOISE
from armid.thesis.algorithm_corrections import HOLDING, Step
from armid.thesis.chapter_4_results import Pictures, Results, Table41
from armid.thesis.page.chapter_elements import Figures, Text, chapter, counted, named, number
from armid.thesis.page.equations import LEAST_SQUARES
from armid.thesis.page.residual import ringing_text
from armid.thesis.published import published
from armid.thesis.reproduction import Thesis

GROUPS = 3
"""Number of groups of columns that are side by side in Table 4.1 of the thesis."""

LARGEST = 9999.0
"""Relative standard deviation [%] above which only this bound is shown, because the parameter cannot be
determined."""

SMALLEST = 0.01
"""Relative standard deviation [%] below which one significant digit is shown, because two decimals would show
0.00."""

PHYSICAL = (
    ("m", "m"), ("r_x", "r_{x}"), ("r_y", "r_{y}"), ("r_z", "r_{z}"), ("I_xx", "I_{xx}"), ("I_xy", "I_{xy}"),
    ("I_xz", "I_{xz}"), ("I_yy", "I_{yy}"), ("I_yz", "I_{yz}"), ("I_zz", "I_{zz}"), ("F_v", "F_{v}"),
    ("F_s", "F_{s}"),
)  # fmt: skip


def _noise_of(rate: float) -> str:
    """Text that converts the noise at 8 kHz to another sample rate [Hz]; empty for 8 kHz."""
    if rate == NOISE.rate:
        return ""
    return f" at 8&nbsp;kHz, times {short(np.sqrt(rate / NOISE.rate), 2)} at this rate, for the same noise density"


def show_steps(thesis: Thesis) -> Section:
    """Chapter on Algorithm 3 of the thesis, as it is printed and with corrections."""
    spread, setting = thesis.steps.spread, thesis.setting
    one_sided, corrected = np.median(spread.one_sided, axis=0), np.median(spread.corrected, axis=0)
    printed = thesis.steps.rows[0].errors
    return chapter(
        "Algorithm 3, step by step",
        Text(
            "The virtual arm has the inertials of its public description and the friction of Table 4.1. It follows "
            f"Table A.1 in 27&nbsp;s exactly, five times, and is logged at {setting.extent.rate:g}&nbsp;Hz with "
            f"noise of {short(NOISE.position, 1)}&nbsp;rad and {short(NOISE.torque, 1)}&nbsp;N·m"
            f"{_noise_of(setting.extent.rate)}. Each row estimates the base parameters by another method; the result "
            "is compared with the true parameters and, for validation, with the true torque along Table A.2. "
            "<b>As printed</b> means what the thesis prints, errors included: the potential energy of (2.21), the "
            "filter of section 3.2.2 on the torque but not on the columns, every sample as a row, and zero-phase "
            "filters that continue the recording at its ends by reflection."
        ),
        LEAST_SQUARES,
        _steps(thesis.steps.rows),
        Text(
            f"<b>As printed</b>, the base parameters are {fixed(100.0 * printed.relative, 1)}&nbsp;% off, and the "
            f"torque along Table A.2 {fixed(printed.unseen, 3)}&nbsp;N·m. With the right sign of gravity, periodic "
            f"edges and {counted(spread.seeds, 'seed')} of the noise, the error of the base parameters is "
            f"{short(100.0 * one_sided[0], 3)}&nbsp;% in the median (at most "
            f"{short(100.0 * spread.one_sided[:, 0].max(), 3)}&nbsp;%) and that of the torque "
            f"{fixed(one_sided[1], 3)}&nbsp;N·m (at most {fixed(spread.one_sided[:, 1].max(), 3)}). With filtered "
            f"columns, too, the errors are {short(100.0 * corrected[0], 2)}&nbsp;% (at most "
            f"{short(100.0 * spread.corrected[:, 0].max(), 2)}&nbsp;%) and {short(corrected[1], 2)}&nbsp;N·m (at "
            f"most {short(spread.corrected[:, 1].max(), 2)}). {_bias(thesis)}"
        ),
        Text(
            "<b>The sign of gravity</b> has little effect on the residual if the filter is on one side: the residual "
            "for the wrong sign is "
            f"{fixed(float(np.median(spread.one_sided_ratio)), 2)} times that for the right one. With filtered "
            f"columns it is {fixed(float(np.median(spread.corrected_ratio)), 1)} times as large in the median and "
            f"{fixed(float(spread.corrected_ratio.min()), 1)} times at least, so that a wrong sign is evident."
        ),
        Text(_slower_text(thesis)),
        _slower(thesis),
    )


def _bias(thesis: Thesis) -> str:
    """Text that noise is not the cause of the error with a one-sided filter; empty if noise causes half or more."""
    errors = {step.key: step.errors for step in thesis.steps.rows}
    quiet, noisy = errors["one-sided-quiet"], errors["one-sided-padded"]
    if quiet.relative < 0.5 * noisy.relative:
        return ""
    return (
        f"The bias of the one-sided filter is not noise: without any noise the error is "
        f"{short(100.0 * quiet.relative, 3)}&nbsp;%, with noise and the same edges {short(100.0 * noisy.relative, 3)}"
        "&nbsp;%. Friction jumps at reversals, the low-pass smooths the jump in the torque but not in the columns, "
        "and the estimate shifts from Coulomb to viscous friction."
    )


def _slower_text(thesis: Thesis) -> str:
    """Text that tests a hypothesis of the thesis: that its parameters predict slower motion better.

    The test compares the torque errors for the shortest and the longest period of the motion.
    """
    found = thesis.steps.slower
    shares = 100.0 * found.printed / found.torque
    first, last = found.one_sided[0], found.one_sided[-1]
    verdict = "It is true" if last < first and shares[-1] < shares[0] else "It is false"
    return (
        "<b>Slower motion.</b> The thesis closes with the hypothesis that its parameters might do better in slower "
        f"motion. {verdict} on the virtual arm: with a one-sided filter and the right sign of gravity, the torque "
        f"error along Table A.2 changes from {fixed(first, 3)}&nbsp;N·m in {found.period[0]:g}&nbsp;s to "
        f"{fixed(last, 3)} in {found.period[-1]:g}&nbsp;s. As printed, it changes from {fixed(found.printed[0], 3)} "
        f"to {fixed(found.printed[-1], 3)}&nbsp;N·m, which is {fixed(shares[0], 1)} and "
        f"{fixed(shares[-1], 1)}&nbsp;% "
        "of the torque. The bias is one of friction, which remains when inertia no longer matters."
    )


def _slower(thesis: Thesis) -> Table:
    found = thesis.steps.slower
    columns = [
        Column("period", "s"), Column("true torque", "N·m"), Column("as printed", "N·m"),
        Column("one-sided filter", "N·m"), Column("columns filtered", "N·m"),
    ]  # fmt: skip
    rows = [
        [TableCell(f"{period:g}", float(period)), number(torque, fixed(torque, 1)),
         *(number(x, short(x)) for x in errors)]
        for period, torque, *errors in zip(
            found.period, found.torque, found.printed, found.one_sided, found.corrected, strict=True
        )
    ]  # fmt: skip
    note = "RMS over all joints: of the true torque, and of predicted minus true torque."
    return Table("slower", "Table A.2 executed more slowly", columns, rows, note)


def _steps(rows: tuple[Step, ...]) -> Table:
    columns = [
        Column("what", words=True), Column("how", words=True), Column("all", "%"), Column("inertial", "%"),
        Column("friction", "%"), Column("Table A.2", "N·m"), Column("residual", "N·m"),
    ]  # fmt: skip
    cells = [
        [
            TableCell(step.group),
            TableCell(step.title),
            *(number(100.0 * x, short(100.0 * x)) for x in (e.relative, e.inertial, e.friction)),
            number(e.unseen, short(e.unseen)),
            number(e.residual, short(e.residual)),
        ]
        for step in rows
        for e in (step.errors,)
    ]
    note = (
        "All, inertial, friction: norm of the base parameters' error, divided by the norm of the truth. Table A.2: "
        "RMS over all joints of predicted minus true torque. Residual: RMS in the method's own band. The thesis does "
        "not state how it treats the ends of the recording; with padding the data contain the transient of a filter "
        f"of order {THESIS.order} at {THESIS.motion_cutoff:g} Hz. The bounds (3.52b) are not published; those of the "
        f"rows with (3.52) hold Table 4.2 itself: centres of mass up to {HOLDING['com']:g} m."
    )
    return Table("steps", "Algorithm 3 as printed, and corrections", columns, cells, note)


def show_parameters(thesis: Thesis) -> Section:
    """Chapter with Tables 4.1 and 4.2 of the thesis, as printed and as computed for the virtual arm."""
    found, thesis_table = thesis.results, published()
    values = np.array([value for value, _ in thesis_table.base.values()])
    relative = np.array([deviation for _, deviation in thesis_table.base.values()])
    return chapter(
        "Tables 4.1 and 4.2",
        Text(
            "The tables of the thesis, and the same tables from the virtual arm: by Algorithm 3 as it is printed, "
            "with its sign of gravity, and with the right sign and filtered columns. The virtual arm is not the "
            "thesis's arm, so the inertial parameters differ; its friction is that of Table 4.1, so the friction can "
            "be compared line by line."
        ),
        _base_table("table-4-1", "Table 4.1 in print: π̂_b", found.names, values, relative),
        _base_table(
            "table-4-1-printed", "Table 4.1 of the virtual arm, Algorithm 3 as printed", found.names,
            found.printed.values, found.printed.relative, found.truth,
        ),
        Text(_about(found.printed, found.corrected)),
        _base_table(
            "table-4-1-corrected", "Table 4.1 of the virtual arm, columns filtered", found.names,
            found.corrected.values, found.corrected.relative, found.truth,
        ),
        _physical_table("table-4-2", "Table 4.2 in print: μ̂", thesis_table.physical),
        _physical_table(
            "table-4-2-printed", "Table 4.2 of the virtual arm, Algorithm 3 as printed", found.printed_physical
        ),
        _physical_table(
            "table-4-2-corrected", "Table 4.2 of the virtual arm, columns filtered", found.corrected_physical
        ),
        _physical_table("table-4-2-true", "Table 4.2 of the virtual arm, the truth", found.true_physical),
        Text(
            "The torque does not depend on single masses: the corrected estimate of Table 4.2 differs from the truth "
            f"by up to {fixed(_masses(found), 1)}&nbsp;kg in a mass but predicts the same torque. Only base "
            "parameters can be compared, as in the table of steps."
        ),
    )  # fmt: skip


def _masses(found: Results) -> float:
    """Largest difference between estimated and true mass of a link, for the estimate with filtered columns [kg]."""
    return float(np.abs(found.corrected_physical[:, 0] - found.true_physical[:, 0]).max())


def _about(printed: Table41, corrected: Table41) -> str:
    positive = "positive definite" if printed.mass_matrix > 0.0 else "not positive definite"
    return (
        f"As printed, {printed.below_ten} of {len(printed.values)} deviations are below 10&nbsp;%, with filtered "
        f"columns {corrected.below_ten}. The smallest eigenvalue of M(q) along Table A.2 is "
        f"{short(printed.mass_matrix)}&nbsp;kg·m² as printed ({positive}) and "
        f"{short(corrected.mass_matrix)}&nbsp;kg·m² with filtered columns."
    )


def _base_table(
    key: str, caption: str, names: tuple[str, ...], values: Array, relative: Array, truth: Array | None = None
) -> Table:
    """Table of base parameters as in the thesis, in groups of columns side by side.

    Args:
        key: Key of the table.
        caption: Caption of the table.
        names: Names of the parameters.
        values: Values, shape (57,).
        relative: Relative standard deviations, shape (57,) [%].
        truth: True values, shape (57,), if they are known.
    """
    group = [Column("name", words=True), Column("value"), Column("σ", "%")]
    group += [Column("truth")] if truth is not None else []
    columns = [Column(column.title + " " * k, column.unit, column.words) for k in range(GROUPS) for column in group]
    length = len(names) // GROUPS
    rows: list[list[TableCell]] = []
    for row in range(length):
        cells: list[TableCell] = []
        for k in range(row, GROUPS * length, length):
            percent = float(relative[k])
            cells += [named(names[k]), number(values[k], fixed(values[k], 3))]
            cells.append(number(percent, _percent(percent)))
            cells += [] if truth is None else [number(truth[k], fixed(truth[k], 3))]
        rows.append(cells)
    note = "σ: relative standard deviation for white residuals, equation (2.47)."
    return Table(key, caption, columns, rows, note)


def _percent(value: float) -> str:
    """Text of a relative deviation [%]: two decimals as in the thesis, or one digit if the decimals would be zero."""
    if value > LARGEST:
        return f"> {LARGEST:g}"
    return fixed(value, 2) if value >= SMALLEST else short(value, 1)


def _physical_table(key: str, caption: str, rows: Array) -> Table:
    columns = [Column("par.", words=True), *(Column(f"link {k + 1}") for k in range(len(rows)))]
    cells = [
        [TableCell(text, latex=f"${latex}$"), *(number(x, fixed(x, 3)) for x in rows[:, k])]
        for k, (text, latex) in enumerate(PHYSICAL)
    ]
    note = "kg, m, kg·m² about the centre of mass, N·m·s/rad, N·m."
    return Table(key, caption, columns, cells, note)


def show_torque(thesis: Thesis) -> Section:
    """Chapter with Figures 4.2 and 4.3 of the thesis."""
    found = thesis.results
    return chapter(
        "Figures 4.2 and 4.3",
        Text(
            "Measured and processed torque along Table A.1 in 27&nbsp;s, and its predictions by the two estimates. "
            "As printed, the low-pass smooths the jumps of friction in the measurement but not in the prediction."
        ),
        Text(ringing_text(thesis)),
        *_figures("printed", "as printed", found.printed_pictures),
        Text(
            "With the same filter on the columns, the jumps of the prediction are smoothed alike: the largest RMS of "
            f"the difference falls from {short(float(found.printed_pictures.rms[0].max()))} to "
            f"{short(float(found.corrected_pictures.rms[0].max()))}&nbsp;N·m."
        ),
        *_figures("corrected", "columns filtered", found.corrected_pictures),
    )


def _figures(key: str, how: str, pictures: Pictures) -> tuple[Figures, Figures]:
    lines = (("measured", "measured"), ("predicted", "predicted by π̂"), ("physical", "predicted by μ̂"))
    joints = range(pictures.measured.shape[1])
    series = (pictures.measured, pictures.base, pictures.physical)
    torque = [
        Plot(
            f"figure-4-2-{key}-{j}", f"Joint {j + 1}.", _range(pictures.measured[:, j]), "time [s]", "torque [N·m]",
            [line(role, pictures.time, x[:, j], words) for (role, words), x in zip(lines, series, strict=True)],
            group=f"time-{key}",
        )
        for j in joints
    ]  # fmt: skip
    off = [
        Plot(
            f"figure-4-3-{key}-{j}", f"Joint {j + 1}.",
            f"RMS {short(pictures.rms[0, j])} and {short(pictures.rms[1, j])} N·m; {_beyond(pictures, j)}",
            "time [s]", "difference [N·m]",
            [
                line(role, pictures.time, pictures.measured[:, j] - x[:, j], words)
                for (role, words), x in zip(lines[1:], series[1:], strict=True)
            ],
            group=f"time-{key}",
            axes=Axes(levels=(-pictures.band[j], pictures.band[j]) if key == "printed" else ()),
        )
        for j in joints
    ]  # fmt: skip
    differences = (
        ("predicted", "measured less predicted by π̂"), ("physical", "measured less predicted by μ̂"),
        *((("level", "a tenth of the range of the measured torque"),) if key == "printed" else ()),
    )  # fmt: skip
    return (
        Figures(f"Figure 4.2: measured and predicted torque, {how}", torque, 2, lines),
        Figures(f"Figure 4.3: differences, {how}", off, 2, differences),
    )


def _range(torque: Array) -> str:
    return f"measured from {short(float(torque.min()))} to {short(float(torque.max()))} N·m"


def _beyond(pictures: Pictures, j: int) -> str:
    return (
        f"{fixed(100.0 * pictures.beyond[j], 1)} % of samples beyond ± {short(pictures.band[j])} N·m"
        if pictures.beyond[j] > 0.0
        else f"no sample beyond ± {short(pictures.band[j])} N·m"
    )
