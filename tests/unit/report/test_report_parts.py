"""Parts of pages: numbers, tables, thinned traces, reversals, shares of variance, TOML."""

from __future__ import annotations

import base64
import csv
import io
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plotly.offline import get_plotlyjs

from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.report.data.friction_at_reversals import HALF_WINDOW, find_reversals, since_reversal
from armid.report.data.number_format import decimals_of, fixed, percent, share, short
from armid.report.data.recording_data import RecordingData, Spectrum, amplitude_density
from armid.report.data.residual_dependence import classes, explained, residual_shares
from armid.report.plots.encoding import compressed, packed, packed_plotly
from armid.report.plots.plot_specification import binned, crest, envelope, line, points, spread
from armid.report.plots.style import CLOUDS, LINES, colours, resolved, trace_style
from armid.report.tables import Column, Table, TableCell, latex_text
from armid.study.config import RecordingChoice
from armid.toml_writing import to_toml


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.08391, "0.0839"), (-12345.6, "−12346"), (2.4e-6, "2.40 · 10⁻⁶"), (0.0, "0"), (np.nan, "–"), (1.0, "1.00")],
)
def test_numbers_have_significant_digits(value: float, text: str):
    assert short(value) == text


def test_digits_follow_the_interval():
    assert fixed(1.23456, decimals_of(0.034)) == "1.235"
    assert fixed(123.456, decimals_of(25.0)) == "123"
    assert fixed(-0.0001, 2) == "0.00"  # no sign without a digit
    assert decimals_of(0.0) == decimals_of(np.inf) == 3


def test_shares_keep_small_ones_apart():
    assert [share(x) for x in (0.204, 0.0123, 2e-4, 0.0, np.nan)] == [
        "20\u00a0%",
        "1.2\u00a0%",
        "less than 0.1\u00a0%",
        "0\u00a0%",
        "–",
    ]
    assert (percent(2e4), percent(12.34), percent(0.123)) == ("> 999", "12.3", "0.12")


TABLE = Table(
    "t",
    "Some, of all",
    (Column("a_b", words=True), Column("value", "N·m")),
    ((TableCell("x,y"), TableCell("−1.0 ± 0.1", -1.0)), (TableCell("ZZR_1", latex="$ZZR_{1}$"), TableCell("–", ""))),
)


def test_csv_has_full_precision_and_survives_commas():
    rows = list(csv.reader(io.StringIO(TABLE.csv())))
    assert rows == [["a_b", "value [N·m]"], ["x,y", "-1.0"], ["ZZR_1", ""]]


def test_latex_is_safe():
    text = TABLE.latex()
    assert r"a\_b & value [N$\cdot$m] \\" in text and r"$ZZR_{1}$ & -- \\" in text and r"\begin{tabular}{lr}" in text
    assert latex_text("50 % & #1_{x}~\\") == r"50 \% \& \#1\_\{x\}\textasciitilde{}\textbackslash{}"


def test_thinning_keeps_extremes_gaps_and_ends():
    rng = np.random.default_rng(3)
    y = rng.normal(size=50_000)
    y[[12_345, 40_000]] = 9.0, -9.0
    y[20_000:20_050] = np.nan
    kept = envelope(y, 300)
    assert len(kept) <= 3 * 300 + 2 and (np.diff(kept) > 0).all()
    assert {0, 12_345, 40_000, len(y) - 1} <= set(kept) and np.isnan(y[kept]).any()
    np.testing.assert_array_equal(envelope(y[:100], 300), np.arange(100))


def test_a_thinned_band_lies_about_its_extremes():
    x = np.arange(20_000.0)
    low, high = -1.0 - np.sin(x) ** 2, 1.0 + np.sin(1.1 * x) ** 2
    band = spread(x, low, high, "band")
    assert (np.nanmin(band.y), np.nanmax(band.y), band.role) == (low.min(), high.max(), "band")


def test_a_band_is_a_closed_polygon_for_each_segment_between_gaps():
    x = np.arange(9.0)
    high = np.array([1.0, 2.0, 3.0, np.nan, 4.0, 5.0, np.nan, np.nan, 6.0])
    band = spread(x, -high, high, "band")
    np.testing.assert_array_equal(band.x, [0, 1, 2, 2, 1, 0, np.nan, 4, 5, 5, 4, np.nan, 8, 8, np.nan])
    np.testing.assert_array_equal(band.y, [-1, -2, -3, 3, 2, 1, np.nan, -4, -5, 5, 4, np.nan, -6, 6, np.nan])
    assert spread(x, -high + np.nan, high, "band").x.size == 0


def test_clouds_drop_what_is_not_finite():
    x = np.arange(5000.0)
    y = np.where(x % 2, np.nan, x)
    cloud = points("training", x, y, "training", most=100)
    assert len(cloud.x) == 100 and np.isfinite(cloud.y).all() and cloud.cloud


def test_a_trace_is_packed_as_four_byte_numbers():
    record = trace_style(line("measured", np.arange(3.0), np.array([1.0, np.nan, -2.5]), "measured"), packed)
    values = np.frombuffer(base64.b64decode(record["y"]["bdata"]), dtype="<f4")
    assert record["y"]["dtype"] == "f4"
    np.testing.assert_array_equal(values, [1.0, np.nan, -2.5])


def test_every_role_has_a_look_of_its_own_in_colours_of_the_theme():
    for looks in (LINES, CLOUDS):
        assert len(set(looks.values())) == len(looks)
    names = {look[0] for looks in (LINES, CLOUDS) for look in looks.values()}
    for theme in ("light", "dark"):
        palette = colours(theme)
        assert names <= set(palette) and palette["paper"].startswith("#")
    assert colours("light")["ink"] != colours("dark")["ink"]
    nested = {"line": {"color": "--ink"}, "shapes": [{"color": "--soft"}], "width": 1, "name": "-- no colour"[3:]}
    assert resolved(nested, {"ink": "black", "soft": "grey"}) == {
        "line": {"color": "black"},
        "shapes": [{"color": "grey"}],
        "width": 1,
        "name": "no colour",
    }


def test_a_logarithmic_line_keeps_its_peaks():
    x = np.arange(1.0, 30_001.0)
    y = np.ones_like(x)
    y[[2, 29_000]] = 50.0
    found = crest("recorded", x, y, "torque")
    assert len(found.x) < 1000 and set(found.x[found.y == 50.0]) == {3.0, 29_001.0}


def test_means_of_bins():
    x = np.array([0.1, 0.2, 0.6, 0.9, np.nan])
    where, mean, count = binned(x, np.array([1.0, 3.0, 5.0, np.nan, 7.0]), np.array([0.0, 0.5, 1.0]), 1)
    np.testing.assert_allclose(where, [0.15, 0.6])
    np.testing.assert_allclose(mean, [2.0, 5.0])
    np.testing.assert_array_equal(count, [2, 1])
    assert np.isnan(binned(x, x, np.array([0.0, 0.5, 1.0]), 3)[1]).all()


def test_explained_share_is_that_of_the_classes():
    rng = np.random.default_rng(5)
    label = rng.integers(0, 8, 40_000)
    noise = rng.normal(size=len(label))
    # Noise of variance 1 about class means of variance 1 leaves half; pure noise leaves everything.
    level = np.array([1.0, -1.0] * 4)[label]
    assert explained(level + noise, label, 1.0) == pytest.approx(0.5, abs=0.02)
    assert explained(noise, label, 1.0) < 1e-3
    assert explained(level, label, 1.0) == pytest.approx(1.0)
    assert np.isnan(explained(noise[:6], label[:6], 1.0))  # as many classes as values


def test_chance_is_taken_off_for_rows_that_repeat_each_other():
    """Ten rows that are one: classes explain a lot of 40 independent values by chance, and nothing is claimed."""
    rng = np.random.default_rng(11)
    shares = [explained(np.repeat(rng.normal(size=40), 10), rng.permutation(np.repeat(np.arange(40) % 12, 10)), 0.1)
              for _ in range(50)]  # fmt: skip
    assert np.mean(shares) < 0.05


def test_classes_part_the_range_evenly():
    x = np.array([0.0, 0.5, 1.0, np.nan])
    label = classes(x)
    assert label[0] == 0 and label[2] == 11 and label[3] == 12 and len(set(classes(np.ones(4)))) == 1


def test_time_since_a_reversal():
    time = np.arange(8.0)
    dq = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 2.0, 2.0, 2.0])
    np.testing.assert_array_equal(since_reversal(time, dq), [np.nan, np.nan, 0.0, 1.0, 2.0, 0.0, 1.0, 2.0])


def moving(friction: np.ndarray, fitted: np.ndarray, time: np.ndarray, dq: np.ndarray) -> RecordingData:
    """A recording of one joint with a given friction."""
    columns = [x[:, None] for x in (np.cumsum(dq) * 0.02, dq, friction, fitted, fitted, np.ones_like(dq))]
    choice = RecordingChoice("x.csv", "train", LogFormat())
    return RecordingData(choice, time, *columns, (0, len(time)), Spectrum(time, friction[:, None], friction[:, None]))


def test_reversals_are_turned_into_one_direction_and_offsets_do_not_part_them():
    time = np.arange(0.0, 20.0, 0.02)
    dq = np.sin(2 * np.pi * time / 4.0)
    friction = 2.0 * np.sign(dq) + 30.0
    found = find_reversals([moving(friction, friction, time, dq)], 0)
    assert len(found.observed) == 9  # every 2 s, the ends too near the border left out
    after = found.time > 0.1
    np.testing.assert_allclose(found.observed[:, after], 2.0, atol=0.06)
    np.testing.assert_allclose(found.observed, found.fitted)
    assert found.time[0] == -HALF_WINDOW


def test_separate_rows_have_no_reversals():
    time = np.arange(0.0, 20.0, 0.02)
    dq = np.sin(time)
    separate = replace(moving(dq, dq, time, dq), spectrum=None)
    assert len(find_reversals([separate], 0).observed) == 0 and separate.clock == "row"
    assert np.isnan(residual_shares([separate], ProcessingOptions(), 0).reversal)


def test_trembling_about_standstill_is_no_reversal():
    time = np.arange(0.0, 20.0, 0.02)
    dq = np.where(time < 10.0, np.sin(2 * np.pi * time / 10.0), 0.01 * np.sin(2 * np.pi * time))
    assert len(find_reversals([moving(dq, dq, time, dq)], 0).observed) <= 1


def test_spectra_have_the_density_of_what_they_are_of():
    rng = np.random.default_rng(7)
    rate, deviation = 200.0, 0.3
    frequency, density = amplitude_density(rng.normal(0.0, deviation, (60_000, 1)), rate)
    # White noise spreads its variance evenly up to half the rate.
    expected = deviation / np.sqrt(rate / 2.0)
    assert np.sqrt(np.mean(density[5:-5] ** 2)) == pytest.approx(expected, rel=0.03)
    tone = np.sin(2 * np.pi * 5.0 * np.arange(20_000) / rate)[:, None]
    frequency, density = amplitude_density(tone, rate)
    assert frequency[np.argmax(density)] == pytest.approx(5.0, abs=0.01)


def test_toml_is_read_back():
    record = {
        "robot": {"description": 'a "quoted" \\ path', "gravity": [0.0, 0.0, -9.81], "tip": None},
        "recording": [
            {"path": "a.csv", "columns": {"q": "q{}", "odd key": "x"}},
            {"path": "b.csv", "consecutive": True},
        ],
    }
    found = tomllib.loads(to_toml(record))
    assert found["robot"] == {"description": 'a "quoted" \\ path', "gravity": [0.0, 0.0, -9.81]}
    assert found["recording"] == record["recording"]


def test_latex_of_what_formulas_have():
    assert latex_text("ḋ = (∂d/∂q) q̇") == r"$\dot{d}$ = ($\partial$d/$\partial$q) $\dot{q}$"
    assert latex_text("σ̂² of βᵢ, MYₙ₋₂") == r"$\hat{\sigma}$$^2$ of $\beta$$_i$, MY$_n$$_-$$_2$"
    assert latex_text("Stäubli") == "Stäubli"


def test_the_script_of_plots_is_the_same_from_the_cache_without_one_and_from_a_damaged_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("ARMID_CACHE", str(tmp_path))
    known = compressed(get_plotlyjs())
    assert packed_plotly() == known
    (entry,) = tmp_path.glob("plotly-*.npz")
    assert packed_plotly() == known
    entry.write_bytes(entry.read_bytes()[:-100])
    assert packed_plotly() == known
