"""Pages opened in a browser: nothing is fetched, nothing complains, all is drawn, and the arm is where it is."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from armid.cli import main as cli
from armid.excitation.collision.distances import floor
from armid.excitation.plan import Plan
from armid.excitation.thesis_plans import builtin_plan
from armid.report.page import write_report
from armid.report.preview.animation_frames import clip_of_plan
from armid.report.preview.inertia_ellipsoids import MassLayer, layer_of_description
from armid.report.preview.nearest_bodies import bodies_to_watch
from armid.report.preview.page import Preview, write_preview
from armid.robot import Robot, load_robot
from armid.robot.kinematics import frame_pose
from browser import LAPTOP, PHONE, Browser, Tab, browser, needs_chromium
from reports import Page, make_run

pytest.importorskip("plotly")
pytest.importorskip("jinja2")
pytestmark = needs_chromium

LARGEST = 6_000_000
"""Bytes of the largest page that anyone should have to mail."""

DRAWN = 1e-6
"""Metres by which the tip may be elsewhere on the page: positions are four-byte numbers."""


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with browser() as running:
        yield running


@pytest.fixture(scope="module")
def arm() -> Robot:
    """The iiwa hanging from a ceiling."""
    return load_robot("iiwa14-r820", gravity=(0.0, 0.0, 9.81))


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a plan."""
    folder = tmp_path_factory.mktemp("flight") / "plan"
    options = "--gravity 0 0 9.81 --collision --budget 1 --workers 0 --duration 8 --harmonics 3 --format csv"
    with pytest.raises(SystemExit) as ended:
        cli.main(["excite", "iiwa14-r820", *options.split(), "--acceleration", "8", "--out", str(folder)])
    assert not ended.value.code
    return folder


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a small run."""
    run = make_run(tmp_path_factory.mktemp("run"))
    return write_report(run, Path(run.folder) / "report.html")


@pytest.fixture(scope="module")
def moving(arm: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A preview of it with everything there is to see."""
    known = layer_of_description(arm)
    assert known is not None
    layers = (known, MassLayer("estimate", 1.1 * known.links))
    around = (floor(-0.3),)
    clip = clip_of_plan(Plan(builtin_plan("thesis-a1")), "thesis-a1")
    shown = Preview(arm, clip, around, bodies_to_watch(arm, around), layers)
    return write_preview(shown, tmp_path_factory.mktemp("pages") / "preview.html")[0]


def assert_quiet(tab: Tab, path: Path) -> None:
    """Nothing but the file itself was asked for, and nothing was said but what software drawing says of itself."""
    assert {where for where in tab.asked if not where.startswith(("data:", "blob:"))} == {path.resolve().as_uri()}
    assert [words for words in tab.said if "GL Driver Message" not in words] == []
    assert path.stat().st_size < LARGEST


def is_inside(tab: Tab) -> bool:
    """Tell whether nothing makes the page scroll sideways."""
    return tab.run("document.documentElement.scrollWidth <= innerWidth")


LOOKS = pytest.mark.parametrize(
    ("size", "dark"), [(LAPTOP, False), (PHONE, True)], ids=["laptop, light", "phone, dark"]
)
"""Sizes and colours have nothing to do with each other, so that each is looked at once."""


@pytest.mark.parametrize("width", [360, 800, 1400])
def test_no_caption_fact_or_command_is_cut_off(width: int, report: Path, chromium: Browser):
    tab = chromium.open(report, size=(width, 900))
    beyond = (
        "[...document.querySelectorAll('caption:not(.hidden) span, .facts dd, .commands dt, .commands dd')]"
        ".filter((each) => each.getClientRects().length && each.getBoundingClientRect().right > innerWidth)"
        ".map((each) => each.textContent)"
    )
    assert tab.run(beyond) == []
    assert is_inside(tab)
    assert_quiet(tab, report)


@pytest.mark.collision
@LOOKS
@pytest.mark.parametrize("page", ["report", "preflight"])
def test_every_plot_is_drawn(
    page: str, size: tuple[int, int], dark: bool, report: Path, flight: Path, chromium: Browser
):
    path = report if page == "report" else flight / "preflight.html"
    plots = len(Page(path.read_text(encoding="utf-8")).data["plots"])
    assert plots > 20
    tab = chromium.open(path, size=size, dark=dark)
    tab.wait("document.documentElement.dataset.drawn")
    tab.run("document.querySelectorAll('main details').forEach((each) => { each.open = true; })")
    tab.wait(f"document.documentElement.dataset.drawn === '{plots}'")
    # Each has lines or points that are more than a dot.
    drawn = tab.run(
        "[...document.querySelectorAll('[data-plot]')].map((plot) => [...plot.querySelectorAll("
        "'.scatterlayer path')].filter((path) => (path.getAttribute('d') || '').length > 10).length)"
    )
    assert len(drawn) == plots and min(drawn) > 0
    assert is_inside(tab)
    assert_quiet(tab, path)


SCREENS = {LAPTOP: 8, PHONE: 16}
"""Screens that a report takes at most while it is folded."""


@pytest.mark.parametrize("size", SCREENS, ids=["laptop", "phone"])
def test_a_folded_report_is_short_and_its_contents_stay_in_view(
    size: tuple[int, int], report: Path, chromium: Browser
):
    tab = chromium.open(report, size=size)
    tab.wait("document.documentElement.dataset.drawn")
    assert tab.run("document.documentElement.scrollHeight") <= SCREENS[size] * size[1]
    links = "[...document.querySelectorAll('nav a')]"
    if size == PHONE:  # a bar that opens
        assert tab.run("document.querySelector('nav').offsetHeight") < 60
        tab.run("document.querySelector('nav summary').click()")
        assert tab.run("document.querySelector('nav details').open")
    tab.run(f"{links}.find((a) => a.hash === '#friction').click()")
    tab.wait("Math.abs(document.getElementById('friction').getBoundingClientRect().top) < 150")
    tab.wait(f"{links}.find((a) => a.getAttribute('aria-current')).hash === '#friction'")
    box = tab.run("(({top, bottom}) => [top, bottom])(document.querySelector('nav').getBoundingClientRect())")
    assert 0 <= box[0] < box[1] <= size[1]
    # Whoever chose a section on a phone sees the section and not the menu.
    assert tab.run("document.querySelector('nav details').open") is (size == LAPTOP)
    assert is_inside(tab)


def test_everything_is_opened_at_once_and_on_paper(report: Path, chromium: Browser):
    tab = chromium.open(report)
    tab.wait("document.documentElement.dataset.drawn")
    closed = "document.querySelectorAll('main details:not([open])').length"
    folded, plots = tab.run(closed), tab.run("document.querySelectorAll('[data-plot]').length")
    assert folded > 5 and int(tab.run("document.documentElement.dataset.drawn")) < plots
    tab.run("dispatchEvent(new Event('beforeprint'))")
    assert tab.run(closed) == 0
    assert tab.run("document.querySelectorAll('[data-plot] .plot-container').length") == plots
    tab.run("dispatchEvent(new Event('afterprint'))")
    assert tab.run(closed) == folded
    tab.run("document.getElementById('unfold').click()")
    tab.wait(f"document.documentElement.dataset.drawn === '{plots}'")
    assert tab.run(closed) == 0
    assert_quiet(tab, report)


def test_tables_that_go_on_say_so_and_keep_their_first_column(report: Path, chromium: Browser):
    tab = chromium.open(report, size=PHONE)
    tab.run("document.querySelectorAll('main details').forEach((each) => { each.open = true; })")
    tab.wait("document.querySelector('#table-parameters').offsetWidth > 0")
    goes_on = "[...document.querySelectorAll('.scroll')].map((each) => each.scrollWidth > each.clientWidth + 2)"
    said = "[...document.querySelectorAll('.scroll')].map((each) => each.nextElementSibling.offsetHeight > 0)"
    tab.wait(f"JSON.stringify({goes_on}) === JSON.stringify({said})")
    assert any(tab.run(goes_on))
    place = "document.querySelector('#table-torque').closest('.scroll')"
    tab.run(f"{place}.scrollLeft = 10000")
    tab.wait(f"{place}.nextElementSibling.offsetHeight === 0")  # it has come to its end
    head = tab.run(f"{place}.querySelector('tbody th').getBoundingClientRect().left")
    assert head == pytest.approx(tab.run(f"{place}.getBoundingClientRect().left"), abs=1.0)


def test_the_residual_shares_the_abscissa_of_its_torque(report: Path, chromium: Browser):
    tab = chromium.open(report)
    tab.wait("document.documentElement.dataset.drawn")
    upper, lower = "document.getElementById('plot-torque-0-0')", "document.getElementById('plot-left-0-0')"
    edges = "._fullLayout.xaxis._offset"
    assert tab.run(f"{upper}{edges}") == tab.run(f"{lower}{edges}")
    tab.run(f"Plotly.relayout({upper}, {{'xaxis.range[0]': 1, 'xaxis.range[1]': 2}}).then(() => true)")
    tab.wait(f"Math.abs({lower}.layout.xaxis.range[1] - 2) < 1e-9")


def test_a_finger_on_a_plot_scrolls_the_page(report: Path, chromium: Browser):
    tab = chromium.open(report, size=PHONE)
    tab.wait("document.documentElement.dataset.drawn")
    tab.run("document.querySelector('.fold:has([data-plot])').open = true")
    tab.wait("document.documentElement.dataset.drawn > 0")
    assert tab.run("document.querySelectorAll('.modebar-btn').length") == 0
    assert tab.run("document.querySelector('[data-plot]')._fullLayout.dragmode") is False


def test_tables_are_copied(report: Path, chromium: Browser):
    tab = chromium.open(report)
    tab.wait("document.documentElement.dataset.drawn")
    tab.run("document.querySelector('[data-copy][data-form=latex]').click()")
    tab.wait("document.querySelector('.said').textContent === 'Copied.'")
    assert_quiet(tab, report)


@pytest.mark.collision
def test_the_plans_own_preview_moves(flight: Path, chromium: Browser):
    tab = chromium.open(flight / "preview.html", mark="still")
    tab.wait("document.documentElement.dataset.drawn")
    assert tab.run("document.getElementById('clock').textContent") == "0.0 of 8.0 s"
    assert_quiet(tab, flight / "preview.html")


@pytest.mark.collision
@LOOKS
def test_the_preview_is_drawn(size: tuple[int, int], dark: bool, moving: Path, chromium: Browser):
    tab = chromium.open(moving, size=size, dark=dark, mark="still")
    tab.wait("document.documentElement.dataset.drawn")
    assert is_inside(tab)
    # Pixels of the arm, read where they are drawn anew.
    colours = tab.run(
        "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => {"
        "armidPreview.seek(1); requestAnimationFrame(() => { const page = document.querySelector('#view canvas');"
        "const flat = document.createElement('canvas'); [flat.width, flat.height] = [64, 64];"
        "const ink = flat.getContext('2d'); ink.drawImage(page, 0, 0, 64, 64);"
        "done(new Set(new Uint32Array(ink.getImageData(0, 0, 64, 64).data.buffer)).size); }); })))"
    )
    assert colours > 100
    assert tab.run("document.querySelectorAll('#chart path').length") == 1
    assert_quiet(tab, moving)


@pytest.mark.collision
def test_without_webgl_a_message_and_the_picture_of_the_joints_stand_there(
    moving: Path, tmp_path: Path, chromium: Browser
):
    blind = tmp_path / "blind.html"
    no_context = "<script>HTMLCanvasElement.prototype.getContext = () => null;</script>"
    blind.write_text(moving.read_text(encoding="utf-8").replace("<head>", f"<head>{no_context}", 1), encoding="utf-8")
    tab = chromium.open(blind, size=PHONE, mark="still")
    shown = "document.querySelector('#skeleton .arm').getBoundingClientRect().height > 100"
    tab.wait(shown)
    assert "could not be drawn in this browser" in tab.run("document.getElementById('undrawn').textContent")
    assert is_inside(tab)
    tab = chromium.open(moving, mark="still")
    tab.wait("document.documentElement.dataset.drawn")
    assert not tab.run(shown)
    context = "document.querySelector('#view canvas').getContext('webgl2')"
    tab.run(f"{context}.getExtension('WEBGL_lose_context').loseContext()")
    tab.wait(shown)
    assert "context was lost" in tab.run("document.getElementById('undrawn').textContent")


@pytest.mark.collision
def test_the_arm_is_where_it_is(moving: Path, arm: Robot, chromium: Browser):
    tab = chromium.open(moving, mark="still")
    tab.wait("document.documentElement.dataset.drawn")
    plan = Plan(builtin_plan("thesis-a1"))
    frames = clip_of_plan(plan, "").time
    for time in frames[[0, 100, 333, -1]]:
        tab.run(f"armidPreview.seek({time})")
        tip = frame_pose(arm, plan.at([time]).q)[1][0]
        assert tab.run("armidPreview.tip()") == pytest.approx(tip, abs=DRAWN)
        value = tab.run("document.querySelector('#joints .value').textContent")
        assert value.endswith(f"{abs(plan.at([time]).q[0, 0]):.3f} rad")


@pytest.mark.collision
def test_it_plays_stops_and_shows_masses(moving: Path, chromium: Browser):
    tab = chromium.open(moving, mark="still")
    tab.wait("document.documentElement.dataset.drawn")
    assert float(tab.run("document.getElementById('time').value")) == 0.0
    tab.run("document.getElementById('play').click()")
    tab.wait("document.getElementById('time').value > 0.002")
    assert tab.run("document.getElementById('play').getAttribute('aria-label')") == "Pause"
    tab.run("document.getElementById('play').click()")
    stopped = tab.run("document.getElementById('time').value")
    place = tab.run(
        "(({x, y, width, height}) => [x + width / 2, y + height / 2])"
        "(document.getElementById('chart').getBoundingClientRect())"
    )
    assert tab.run("document.getElementById('time').value") == stopped
    tab.click(*place)
    assert float(tab.run("document.getElementById('time').value")) == pytest.approx(0.5, abs=0.01)
    tab.run("document.querySelectorAll('[data-layer^=masses]').forEach((box) => box.click())")
    tab.click(500, 400, (620, 440))
    assert_quiet(tab, moving)


@pytest.mark.collision
def test_a_limit_is_marked(arm: Robot, tmp_path: Path, chromium: Browser):
    from armid.report.preview.animation_frames import still

    q = np.zeros(7)
    q[1] = arm.joints[1].position_limits[1] - 0.05
    path, _ = write_preview(Preview(arm, still(q, "near a stop"), (), bodies_to_watch(arm)), tmp_path / "near.html")
    tab = chromium.open(path)
    tab.wait("document.documentElement.dataset.drawn")
    marked = tab.run("[...document.querySelectorAll('#joints li')].map((item) => item.textContent.includes('▲'))")
    assert marked == [False, True, False, False, False, False, False]
    assert_quiet(tab, path)
