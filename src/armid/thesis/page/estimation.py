"""Chapters of the page on section 3.2, Tables 4.1 and 4.2, and Figures 4.2 and 4.3 of the thesis."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.report.data.number_format import fixed, short
from armid.report.plots.plot_specification import Axes, Plot, line
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell
from armid.thesis.algorithm import NOISE
from armid.thesis.algorithm_corrections import Step
from armid.thesis.chapter_4_results import Pictures, Table41
from armid.thesis.page.chapter_elements import Figures, Text, chapter, named, number
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
    """Text about the noise at a sample rate [Hz]; empty for 8 kHz."""
    if rate == NOISE.rate:
        return ""
    return f" at 8&nbsp;kHz, times {short(np.sqrt(rate / NOISE.rate), 2)} at this rate, for the same noise density"


def show_steps(thesis: Thesis) -> Section:
    """Chapter on Algorithm 3 of the thesis, as it is printed and with corrections."""
    spread, setting = thesis.steps.spread, thesis.setting
    printed, corrected = np.median(spread.printed, axis=0), np.median(spread.corrected, axis=0)
    return chapter(
        "Algorithm 3, step by step",
        Text(
            "The virtual arm has the inertials of its public description and the friction of Table 4.1. It follows "
            f"Table A.1 in 27&nbsp;s exactly, five times, and is logged at {setting.extent.rate:g}&nbsp;Hz with "
            f"noise of 10⁻⁵&nbsp;rad and 0.3&nbsp;N·m{_noise_of(setting.extent.rate)}. Each row estimates the base "
            "parameters by another method; the result is compared with the true parameters and, for validation, with "
            "the true torque along Table A.2."
        ),
        _steps(thesis.steps.rows),
        Text(
            f"<b>For {spread.seeds} seeds of the noise</b> and periodic edges, Algorithm 3 as printed gives a "
            f"relative error of the base parameters of {fixed(printed[0], 4)} in the median (at most "
            f"{fixed(spread.printed[:, 0].max(), 4)}) and a torque error on Table A.2 of {fixed(printed[1], 3)}"
            f"&nbsp;N·m (at most {fixed(spread.printed[:, 1].max(), 3)}). With filtered columns the errors are "
            f"{short(corrected[0], 2)} (at most {short(spread.corrected[:, 0].max(), 2)}) and "
            f"{short(corrected[1], 2)}&nbsp;N·m (at most {short(spread.corrected[:, 1].max(), 2)}). The bias as "
            "printed is not due to noise: friction jumps at reversals, the low-pass smooths the jump in the torque "
            "but not in the columns, and the estimate shifts from Coulomb to viscous friction."
        ),
        Text(
            "<b>The sign of gravity</b> has little effect as printed: the residual for the wrong sign is "
            f"{fixed(float(np.median(spread.printed_ratio)), 2)} times that for the right one. With filtered columns "
            f"it is {fixed(float(np.median(spread.corrected_ratio)), 1)} times as large in the median and "
            f"{fixed(float(spread.corrected_ratio.min()), 1)} times at least, so that a wrong sign is evident."
        ),
    )


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
        "of order 20 at 3 Hz."
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
            "and with filtered columns. The virtual arm is not the thesis's arm, so the inertial parameters differ; "
            "its friction is that of Table 4.1, so the friction can be compared line by line."
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
            "table-4-2-printed", "Table 4.2 of the virtual arm, (3.52) and (3.53) as printed", found.printed_physical
        ),
        _physical_table(
            "table-4-2-corrected", "Table 4.2 of the virtual arm, columns filtered", found.corrected_physical
        ),
        _physical_table("table-4-2-true", "Table 4.2 of the virtual arm, the truth", found.true_physical),
        Text(
            "The torque does not depend on single masses: the estimates of Table 4.2 differ from the truth by "
            "kilograms but predict the same torque. Only their base parameters can be compared, as in the table of "
            "steps."
        ),
    )  # fmt: skip


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
    """Table of base parameters as in the thesis, in groups side by side, with the true values if they are known."""
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
            "As printed, the low-pass smooths the jumps of friction in the measurement but not in the prediction; "
            "these jumps are what the thesis calls overestimated oscillations."
        ),
        *_figures("printed", "as printed", found.printed_pictures),
        Text("With the same filter on the columns the prediction is smoothed alike, and the two curves coincide."),
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
