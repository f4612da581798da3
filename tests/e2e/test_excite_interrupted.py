"""`armid excite` stopped by Ctrl-C: exit code 130 at any stage, and no plan that is not whole."""

from __future__ import annotations

from pathlib import Path

import pytest

from armid.cli.main import main
from pendulums import ARM


def interrupted_in(where: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """Exit code of a design that is stopped in a function."""

    def stop(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(where, stop)
    (folder / "pendulum.toml").write_text(ARM)
    monkeypatch.chdir(folder)
    with pytest.raises(SystemExit) as end:
        main(["excite", "pendulum.toml", "--budget", "0.3", "--workers", "0", "--harmonics", "4", "--out", "plan"])
    assert isinstance(end.value.code, int)
    return end.value.code


@pytest.mark.parametrize(
    "where",
    [
        "armid.study.plans.design.place_motion",
        "armid.excitation.design.multistart.descend",
        "armid.study.plans.design.certified_plan",
        "armid.study.plans.design_writing.report_text",
    ],
)
def test_an_interrupted_design_writes_nothing(
    where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    assert interrupted_in(where, tmp_path, monkeypatch) == 130
    said = capsys.readouterr()
    assert said.out == "" and said.err.endswith("interrupted; nothing was written\n")
    assert [path.name for path in tmp_path.iterdir()] == ["pendulum.toml"]


@pytest.mark.parametrize(
    ("where", "page", "others"),
    [
        ("armid.report.preflight_page.render_preflight", "preflight.html", False),
        ("armid.report.preview.page.write_preview", "preview.html", True),
    ],
)
def test_an_interrupted_page_leaves_the_whole_plan(
    where: str,
    page: str,
    others: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    assert interrupted_in(where, tmp_path, monkeypatch) == 130
    assert capsys.readouterr().err.endswith(
        f"interrupted; the plan in plan is complete, but {page} was not written\n"
    )
    written = {path.name for path in (tmp_path / "plan").iterdir()}
    assert {"plan.json", "plan.csv", "preflight.json", "preflight.txt"} <= written and page not in written
    assert ("preflight.html" in written) == others
