"""Parts of docs/thesis.md and docs/theory/errata.md that are written from the record of a run, `thesis.json`.

    python docs/extensions/thesis_results.py [thesis.json]

writes them anew between the comments `<!-- run: NAME -->` and `<!-- run: end -->`. Without an argument, the record is
that of the golden tests. A contract test compares the pages with the record.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

from armid.report.data.number_format import fixed, short

ROOT = Path(__file__).parents[2]

RECORD = ROOT / "tests" / "golden" / "data" / "thesis_retold.json"

Record = dict[str, Any]


def _percent(value: float, digits: int = 2) -> str:
    return f"{short(100.0 * value, digits)} %"


def _errors(record: Record) -> dict[str, Record]:
    return {row["key"]: row["errors"] for row in record["steps"]["rows"]}


def model(record: Record) -> str:
    """Paragraph on the model, Algorithm 1 and the derivation."""
    dynamics, found = record["dynamics"], record["reduction"]
    wrong = [each for each in found["identities"] if each["right"]]
    odd = [line for line in found["dependences"] if line["printed_error"] and line["printed_error"] > 1e-12]
    labels = sum(line["label"] != line["column"] for line in found["dependences"])
    right = sum(line["error"] < 1e-12 for line in found["groupings"])
    names = ", ".join(f"{line['column']} ({_percent(line['printed_error'])})" for line in odd)
    steps = "; ".join(f"{each['number']} has an error of {_percent(each['error'])}" for each in wrong)
    return (
        "The regressors of the Lagrangian computation and of the kernel differ by "
        f"{short(dynamics['regressor_error'], 1)} "
        f"of the largest entry, the mass matrices by {short(dynamics['mass_error'], 1)}, and τ(μ) of Algorithm 1, "
        "computed from M, C and g of the physical parameters, differs from Y_b π_b by "
        f"{short(found['torque_error'], 1)}. "
        f"The rank is {found['rank']} of {found['columns']}, {len(found['zero'])} columns are zero, and {right} of "
        f"{len(found['groupings'])} lines of (3.39) are exact. Of {len(found['identities'])} equations of the "
        f"derivation, (3.9) to (3.30), {len(found['identities']) - len(wrong)} hold; {steps}. In the copy of the "
        "text in use, "
        f"{labels} of {len(found['dependences'])} lines of (A.1) have the label of another column, and the sums of "
        f"these differ from the column: {names}. The thesis must have used the right line of M_7, because (3.39) is "
        "right."
    )


def gravity(record: Record) -> str:
    """Paragraphs on the sign of gravity."""
    dynamics, results = record["dynamics"], record["results"]
    at = {name: k for k, name in enumerate(results["names"])}
    truth, wrong = (results[key][at["MYR_2"]] for key in ("truth", "wrong"))
    ratio = record["steps"]["spread"]
    return (
        "With (2.21) as printed, the balance of power along Table A.1 has an error of "
        f"{fixed(dynamics['literal_imbalance'], 1)} W; with the other sign the error is "
        f"{short(dynamics['imbalance'], 1)} "
        "W, that of a difference quotient. Table 4.1 shows the same: MYR_2 and MYR_4 are negative. If data of the "
        f"hanging virtual arm are identified with the printed sign, MYR_2 is {fixed(wrong, 2)} instead of "
        f"{fixed(truth, 2)}. The "
        "wrong sign increases the residual by a factor of "
        f"{fixed(median(ratio['one_sided_ratio']), 2)} with the filter on one side, which is hardly noticeable; with "
        f"filtered columns the factor is {fixed(median(ratio['corrected_ratio']), 1)} in the median of "
        f"{ratio['seeds']} "
        f"seeds and at least {fixed(min(ratio['corrected_ratio']), 1)}."
    )


def steps(record: Record) -> str:
    """Table of the results of Algorithm 3."""
    lines = ["| processing | error of the base parameters | torque error on Table A.2, N·m |", "|---|---|---|"]
    lines += [
        f"| {row['group']}: {row['title']} | {_percent(row['errors']['relative'], 3)} | "
        f"{short(row['errors']['unseen'], 3)} |"
        for row in record["steps"]["rows"]
    ]
    return "\n".join(lines)


def spread(record: Record) -> str:
    """Ranges over the seeds of the noise."""
    found = record["steps"]["spread"]
    (low, least), (high, most) = ([pick(x) for x in zip(*found["one_sided"], strict=True)] for pick in (min, max))
    worst = [max(x) for x in zip(*found["corrected"], strict=True)]
    return (
        f"Over {found['seeds']} seeds, with the right sign of gravity and periodic edges, the errors are "
        f"{_percent(low, 3)} to {_percent(high, 3)} and {fixed(least, 3)} to {fixed(most, 3)} N·m with the filter "
        f"on one side, and at most {_percent(worst[0])} and {short(worst[1], 2)} N·m with filtered columns."
    )


def residual(record: Record) -> str:
    """Paragraphs on the residual of the thesis and its causes."""
    deviations, search = record["audit"]["deviations"], record["steps"]["search"]
    rows = {row["key"]: row for row in search["rows"]}
    implied, printed = deviations["implied"], _errors(record)["printed"]
    lines = [
        f"The printed standard deviations imply a residual of {fixed(implied[1], 2)} N·m, if they are those of the "
        f"printed 392 000 rows, or {fixed(implied[2], 2)} N·m for 27 s at 8 kHz. A residual of "
        f"{fixed(search['typical'], 2)} N·m "
        "would cross the lines of Figure 4.3 in a twentieth of the samples, and the thesis says that they are "
        "crossed occasionally. Algorithm 3 as printed, with both certain errors, leaves "
        f"{fixed(printed['residual'], 2)} "
        "N·m on the virtual arm. So most of the residual has another cause. Each row of this table changes the "
        "virtual arm or "
        "its recording in one way and identifies it as printed:",
        "",
        "| cause | residual, N·m | ZZR_1 | ZZR_2 | predicted / measured oscillation |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {row['title']} | {fixed(row['residual'], 2)} | {fixed(row['inertia'][0], 2)} | "
        f"{fixed(row['inertia'][1], 2)} | "
        f"{fixed(row['oscillation'], 2)} |"
        for row in search["rows"]
    ]
    lag = rows["lag"]
    lines += [
        f"| the thesis | {fixed(implied[1], 2)} to {fixed(implied[2], 2)} | 4.28 | 9.57 | above 1 |",
        "",
        "None reproduces everything. With the effects of friction, ZZR_1 stays at most at "
        f"{fixed(_largest(rows), 2)}. "
        f"Rotor inertia of a usual size increases ZZR_1 to {fixed(rows['rotor']['inertia'][0], 2)}. "
        f"Positions that lag the torque by {fixed(search['lag'][0], 3)} s give ZZR_1 of Table 4.1, nearly its "
        "ZZR_2, and "
        f"oscillations that the prediction overestimates by a factor of {fixed(lag['oscillation'], 2)}; the "
        "distance of all "
        f"second moments from Table 4.1 falls from {fixed(100.0 * rows['none']['second_moments'], 0)} to "
        f"{fixed(100.0 * lag['second_moments'], 0)} %, and the residual is {fixed(lag['residual'], 2)} N·m. "
        "Butterworth filters of order 20 at 3 and 3.5 Hz that run forwards only delay positions by "
        f"{fixed(search['forward_lag'], 3)} s more than torques. Whether this happened cannot be decided without the "
        "recordings.",
    ]
    return "\n".join(lines)


FRICTION = ("stribeck", "asymmetric", "load", "hysteresis", "ripple", "temperature", "slow-ripple")
"""Keys of the candidates that are effects of friction."""


def _largest(rows: Record) -> float:
    """Largest ZZR_1 with an effect of friction [kg·m²]."""
    return max(rows[key]["inertia"][0] for key in FRICTION)


def published(record: Record) -> str:
    """Paragraphs on the published tables."""
    audit = record["audit"]
    certificate, pose = audit["base"], audit["base"]["mass_matrix"]
    deviations, conditions = audit["deviations"], audit["conditions"]
    by: dict[str, list[int]] = {}
    for each in audit["broken"]:
        by.setdefault(each["constraint"], []).append(each["link"])
    broken = "; ".join(f"{key} in links {', '.join(map(str, links))}" for key, links in by.items())
    printed, right = deviations["printed_error"], deviations["one_sided_error"]
    return (
        "**No real bodies have the parameters of Table 4.1.** The distance to the nearest consistent parameters is "
        f"{fixed(certificate['distance'], 3)}, or {fixed(100.0 * certificate['relative_distance'], 2)} % of the "
        "norm. A search for a pose in which M(q) is not positive definite found none (smallest eigenvalue "
        f"{short(pose['min_eigenvalue'])} kg·m²); this is no proof. Table 4.2 violates {len(audit['broken'])} of "
        f"its own constraints: {broken}.\n\n"
        "**The printed standard deviations** agree with Table A.1 in 27 s up to a common factor (with a scatter of "
        f"{fixed(100.0 * deviations['hanging'][1], 1)} %, or {fixed(100.0 * deviations['literal'][1], 1)} % with the "
        f"printed sign of gravity; in 20 s the scatter is {fixed(100.0 * deviations['literal'][0], 0)} %). So the "
        "trajectory, the order of the columns and the least squares are as described in the thesis. On the virtual "
        f"arm, with Algorithm 3 as printed, the true errors are {fixed(printed[0], 0)} of these standard deviations "
        "in "
        f"the median and up to {fixed(printed[1], 0)}; with the right sign of gravity, {fixed(right[0], 0)} and "
        f"{fixed(right[1], 0)}, because standard deviations do not contain the bias.\n\n"
        f"**The condition number** 111.7 belongs to the motion of 27 s ({fixed(conditions['hanging'][1], 1)}; "
        f"{fixed(conditions['literal'][1], 1)} with the printed sign) and not to the 20 s of the design "
        f"({fixed(conditions['hanging'][0], 1)}). Without b_10, the row that Table A.1 lacks, it is "
        f"{fixed(conditions['without_last'], 2)}; the condition number depends so little on this row that this "
        f"proves nothing. In 20 s, velocities reach {fixed(100.0 * conditions['velocity'][0], 1)} % of the "
        "catalogue's "
        f"limits and the torques of Table 4.1 {fixed(100.0 * conditions['torque'][0], 0)} %, so these limits do not "
        "explain "
        "why the arm needed 27 s."
    )


def motion(record: Record) -> str:
    """Paragraphs on slower motion and of the designed trajectories."""
    slow, designs = record["steps"]["slower"], record["designs"]
    trials = designs["trials"]
    found = [each["condition"] for each in trials]
    lines = [
        "**Slower motion.** The thesis supposes that its parameters do better in slower motion. With a one-sided "
        "filter and the right sign of gravity, the torque error along Table A.2 rises from "
        f"{fixed(slow['one_sided'][0], 3)} N·m in "
        f"{slow['period'][0]:g} s to {fixed(slow['one_sided'][-1], 3)} N·m in {slow['period'][-1]:g} s; as printed "
        f"it is {fixed(100.0 * slow['printed'][0] / slow['torque'][0], 1)} and "
        f"{fixed(100.0 * slow['printed'][-1] / slow['torque'][-1], 1)} % of the torque.",
        "",
        f"**Algorithm 2** finds condition numbers of {fixed(min(found), 1)} to {fixed(max(found), 1)} from "
        f"{len(trials)} "
        "starts. Where a descent of thousands of steps ends differs by machine.",
        "",
        "**Other parameterisations**, each searched with the same number of tries and without gradients:",
        "",
        "| parameterisation | parameters | condition number | A.2 as printed, N·m | A.2, columns filtered, N·m |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {row['name']} | {row['unknowns']} | {fixed(row['condition'], 1)} | {fixed(row['printed'], 3)} | "
        f"{short(row['corrected'], 2)} |"
        for row in designs["families"]
    ]
    return "\n".join(lines)


def errata(record: Record) -> str:
    """Table of all errata."""
    lines = ["| place | printed | should be | what shows it | printed | right |", "|---|---|---|---|---|---|"]
    for each in record["errata"]:
        numbers = [_number(each[key]) for key in ("printed_value", "right_value")]
        if numbers[1] and not numbers[0]:
            numbers[0] = "∞"  # JSON has no number for it
        texts = [each[key].replace("|", "\\|") for key in ("item", "printed", "right", "shown")]
        place = texts[0] + (" ○" if each["typesetting"] else "")
        lines.append(
            f"| {place} | {texts[1]} | {texts[2]} | {texts[3]} | {numbers[0]} | {numbers[1]} |".replace("_", "\\_")
        )
    return "\n".join(lines)


def _number(value: Any) -> str:
    if value is None or value != value:  # NaN: the erratum has no number
        return ""
    return f"{int(value)}" if float(value).is_integer() and abs(value) >= 1.0 else short(value)


def filtering(record: Record) -> str:
    """Paragraph on the one-sided filter, for the page of errata."""
    errors = _errors(record)
    one, both = errors["one-sided"], errors["columns"]
    return (
        f"With the right sign of gravity this causes a torque error of {fixed(one['unseen'], 2)} N·m RMS on Table "
        f"A.2 and {_percent(one['friction'])} in the friction, and without noise hardly less "
        f"({_percent(errors['one-sided-quiet']['friction'])}, ends padded); with the same filter on both sides the "
        f"torque error is {short(both['unseen'], 2)} N·m."
    )


PARTS: dict[str, dict[str, Callable[[Record], str]]] = {
    "thesis.md": {
        "model": model, "gravity": gravity, "steps": steps, "spread": spread, "residual": residual,
        "published": published, "motion": motion,
    },
    "theory/errata.md": {
        "gravity": gravity, "filtering": filtering, "published": published, "errata": errata,
    },
}  # fmt: skip
"""Parts of each page by name, with the function that writes them."""

PART = re.compile(r"(<!-- run: (\w+) -->\n)(.*?)(<!-- run: end -->)", re.DOTALL)


def written(page: str, text: str, record: Record) -> str:
    """Text of a page with its parts written anew."""
    parts = PARTS[page]
    return PART.sub(lambda found: f"<!-- run: {found[2]} -->\n\n{parts[found[2]](record)}\n\n<!-- run: end -->", text)


if __name__ == "__main__":
    source = Path(sys.argv[1]) if len(sys.argv) > 1 else RECORD
    told = json.loads(source.read_text(encoding="utf-8"))
    for name in PARTS:
        path = ROOT / "docs" / name
        path.write_text(written(name, path.read_text(encoding="utf-8"), told), encoding="utf-8")
