"""Chapter of the page on the residual of the thesis: its size, and simulated causes that reproduce it."""

from __future__ import annotations

import numpy as np

from armid.report.data.number_format import fixed, short
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell
from armid.thesis.experiments.residual_causes import CLOSE, FRICTION, MORE, Cause, reproduced
from armid.thesis.page.chapter_elements import Text, chapter, number, subscripts
from armid.thesis.published import published
from armid.thesis.reproduction import Thesis


def show_residual(thesis: Thesis) -> Section:
    """Chapter on the size of the residual of the thesis, and on the simulated causes that reproduce it."""
    deviations, search = thesis.audit.deviations, thesis.steps.search
    rows = {row.key: row for row in search.rows}
    none = rows["none"]
    design, printed, logged = deviations.implied
    samples = [f"{int(x):,}".replace(",", "\u00a0") for x in deviations.samples]
    return chapter(
        "What remains unexplained",
        Text(
            "<b>How large the thesis's residual was</b> is not printed, but its standard deviations imply it: "
            "σ = σ̂<sub>ν</sub> √((Y<sub>b</sub>ᵀ Y<sub>b</sub>)⁻¹)<sub>jj</sub> gives "
            f"{fixed(printed, 2)}&nbsp;N·m for the {samples[1]} samples of the 392\u00a0000 rows that the thesis "
            f"prints, {fixed(logged, 2)}&nbsp;N·m for the {samples[2]} samples of 27&nbsp;s at 8&nbsp;kHz. (For the "
            f"{samples[0]} samples of the 100&nbsp;Hz with which the trajectory was designed, it would be "
            f"{fixed(design, 2)}.) Figure 4.3 is a second witness: its lines at ±&nbsp;10&nbsp;% of the range are "
            f"crossed “occasionally”. A residual of {fixed(search.typical, 2)}&nbsp;N·m would cross them in a "
            "twentieth of the samples, which agrees with the first of these numbers."
        ),
        Text(
            "<b>The two errors that are certain explain a part of it.</b> Algorithm 3 as printed, with the sign of "
            "gravity in print and the filter on one side, leaves "
            f"{fixed(thesis.steps.rows[0].errors.residual, 2)}&nbsp;N·m on the virtual arm, "
            f"{_share(thesis.steps.rows[0].errors.residual, printed)} of the smaller number and "
            f"{_share(thesis.steps.rows[0].errors.residual, logged)} of the larger one. "
            f"It finds ZZR₁ = {fixed(none.inertia[0], 2)}&nbsp;kg·m² where Table 4.1 has "
            f"{fixed(published().base['ZZR_1'][0], 3)}. The rest has another cause."
        ),
        Text(
            "<b>The search.</b> Each row changes the virtual arm or its recording in one way, identifies it by "
            "Algorithm 3 as printed (elastic joints as in [Spong1987]), and compares three observations with those "
            "of the thesis: a residual from "
            f"{fixed(printed, 2)} to {fixed(logged, 2)}&nbsp;N·m; ZZR₁ within {100.0 * CLOSE:.0f}&nbsp;% of Table "
            "4.1; and oscillations between the jumps that the prediction overestimates, by "
            f"{100.0 * (MORE - 1.0):.0f}&nbsp;% or more in the median of the joints, as the "
            "thesis says of Figure 4.2."
        ),
        _causes(search.rows, (float(printed), float(logged))),
        Text(_verdict(thesis)),
    )


def _share(part: float, whole: float) -> str:
    return f"{fixed(100.0 * part / whole, 0)}&nbsp;%"


def _causes(rows: tuple[Cause, ...], implied: tuple[float, float]) -> Table:
    columns = [
        Column("cause", words=True), Column("residual", "N·m"), Column("ZZR₁", "kg·m²"), Column("ZZR₂", "kg·m²"),
        Column("second moments", "%"), Column("beyond ± 10 %", "%"), Column("oscillation"),
        Column("reproduces", words=True),
    ]  # fmt: skip
    names = ("residual", "ZZR₁", "oscillation")
    cells = [
        [
            TableCell(subscripts(row.title), row.title),
            number(row.residual, fixed(row.residual, 2)),
            *(number(x, fixed(x, 2)) for x in row.inertia),
            number(100.0 * row.second_moments, fixed(100.0 * row.second_moments, 0)),
            number(100.0 * row.beyond, fixed(100.0 * row.beyond, 1)),
            number(row.oscillation, fixed(row.oscillation, 2)),
            TableCell(
                ", ".join(name for name, found in zip(names, reproduced(row, implied), strict=True) if found) or "–"
            ),
        ]
        for row in rows
    ]
    printed = published().base
    cells.append(
        [
            TableCell("the thesis"),
            TableCell(f"{fixed(implied[0], 2)} to {fixed(implied[1], 2)}", ""),
            *(number(printed[name][0], fixed(printed[name][0], 2)) for name in ("ZZR_1", "ZZR_2")),
            TableCell("0", ""), TableCell("occasionally", ""), TableCell("above 1", ""), TableCell("", ""),
        ]
    )  # fmt: skip
    note = (
        "Second moments: norm of the difference of all moments and products of inertia from Table 4.1, divided by "
        "the norm there. Oscillation: RMS of the predicted torque about the mean of each stretch between two "
        "reversals, divided by that of the measured torque, median of the joints."
    )
    return Table("causes", "Candidate causes of the thesis's residual", columns, cells, note)


def _verdict(thesis: Thesis) -> str:
    """Text with the conclusion of the search for causes of the residual."""
    search, implied = thesis.steps.search, thesis.audit.deviations.implied[1:]
    found = {row.key: reproduced(row, (float(implied[0]), float(implied[1]))) for row in search.rows}
    rows = {row.key: row for row in search.rows}
    complete = [rows[key].title for key, each in found.items() if all(each)]
    two = [rows[key].title for key, each in found.items() if each[1] and each[2] and not each[0]]
    lag, forward = rows["lag"], rows["forward"]
    parts = [
        (
            f"<b>Result.</b> Of {len(search.rows)} candidates, {len(complete)} reproduce all three observations: "
            f"{'; '.join(complete)}."
            if complete
            else f"<b>Result.</b> None of the {len(search.rows)} candidates reproduces all three observations."
        ),
        (
            f"ZZR₁ and the overestimated oscillations together are reproduced by {'; '.join(two)}."
            if two
            else "None reproduces ZZR₁ and the oscillations together."
        ),
        "No effect of friction does: they add to the residual but leave ZZR₁ small. Rotor inertia increases ZZR₁ to "
        f"{fixed(rows['rotor'].inertia[0], 2)}&nbsp;kg·m², but not the residual."
        if not any(found[key][1] for key in FRICTION)
        else "",
        "What changes all three at once, in the right direction, is <b>positions that lag the torque</b>: with "
        f"{fixed(search.lag[0], 3)}&nbsp;s ZZR₁ is that of Table 4.1, ZZR₂ is {fixed(lag.inertia[1], 2)} (Table 4.1: "
        f"{fixed(published().base['ZZR_2'][0], 2)}), all second moments come from "
        f"{fixed(100.0 * rows['none'].second_moments, 0)} to {fixed(100.0 * lag.second_moments, 0)}&nbsp;% of Table "
        f"4.1, the prediction oscillates {fixed(lag.oscillation, 2)} times as much as the measurement, and the "
        f"residual is {fixed(lag.residual, 2)}&nbsp;N·m; with rotor inertia {fixed(search.lag[1], 3)}&nbsp;s "
        "suffice. Such a "
        "lag has a possible origin in the text: Butterworth filters of order 20 at 3&nbsp;Hz (positions) and "
        f"3.5&nbsp;Hz (torques) delay their signals by times that differ by {fixed(search.forward_lag, 3)}&nbsp;s "
        "if they run "
        "forwards only, and not forwards and backwards as the thesis says. With such filters, ZZR₁ is "
        f"{fixed(forward.inertia[0], 2)}, the oscillation {fixed(forward.oscillation, 2)} and the residual "
        f"{fixed(forward.residual, 2)}&nbsp;N·m. This is inferred from the tables; without the recordings it cannot "
        "be decided. The size of the residual is "
        + ("reproduced." if complete else f"not reached by this: {_share(lag.residual, float(implied[0]))} of it."),
    ]
    return subscripts(" ".join(part for part in parts if part))


def ringing_text(thesis: Thesis) -> str:
    """Text on oscillations between the jumps of friction in Figure 4.2, as printed and with filtered columns."""
    printed, corrected = thesis.results.printed_pictures, thesis.results.corrected_pictures

    def span(x: np.ndarray) -> str:
        return f"{short(float(np.nanmin(x)), 2)} to {short(float(np.nanmax(x)), 2)}&nbsp;N·m"

    ratio = float(np.nanmedian(printed.oscillation[1] / printed.oscillation[0]))
    return (
        "Between the jumps, more than 0.3&nbsp;s away from a reversal, it is the <i>measured</i> torque that rings, "
        "because its jumps were filtered by a sharp low-pass: its fast oscillation has an RMS of "
        f"{span(printed.ringing[0])} over the joints, that of the prediction {span(printed.ringing[1])}. The slow "
        f"oscillation of the prediction is {fixed(ratio, 2)} times that of the measurement in the median of the "
        "joints. So the oscillations that the thesis's simulation overestimated are not these corners; the next "
        "chapter looks for their cause. With filtered columns the fast oscillations are "
        f"{span(corrected.ringing[0])} and {span(corrected.ringing[1])}."
    )
