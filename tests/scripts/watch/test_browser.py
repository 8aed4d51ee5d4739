"""`slcp watch` in a real browser: the page loads, pictures arrive, a drag pulls, sliders and choices work."""

import os
import time
from pathlib import Path

import chromium
import pytest
from test_server import Running

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(chromium.EXECUTABLE is None, reason="no Chromium is installed"),
]


@pytest.fixture(scope="module")
def running():
    server = Running()
    server.engine.prepare()
    yield server
    server.close()


@pytest.fixture
def page(running):
    running.engine.send(0, {"do": "reset"})
    opened = chromium.Page(running.server.address)
    opened.wait("picture && picture.frame && view !== null")
    yield opened
    assert opened.errors == []
    opened.close()


def window(page, x, y):
    """Where a point of the world is in the window."""
    return page.value(
        f"[(view.cell(0)[0] + ({x} - view.middle[0]) * view.scale) / view.ratio,"
        f" (view.cell(0)[1] - ({y} - view.middle[1]) * view.scale) / view.ratio]"
    )


def test_a_drag_of_the_ellipse_changes_its_velocity(page, tmp_path):
    page.wait("picture.time > 0.3")
    start = page.value("picture.state[2]")
    page.mouse("Moved", *window(page, 0.2, -3.05))
    page.mouse("Pressed", *window(page, 0.2, -3.05))
    for i in range(1, 6):
        page.mouse("Moved", *window(page, 0.2 + 0.1 * i, -3.05 + 0.15 * i))
    page.wait("picture.pull && picture.pull[5] > 0.1")
    page.wait(f"Math.abs(picture.state[2] - {start}) > 0.2")
    shot = Path(os.environ.get("SLCP_SCREENSHOT", tmp_path / "watch.png"))
    page.screenshot(shot)
    assert shot.stat().st_size > 5000
    page.mouse("Released", *window(page, 0.7, -2.3))
    page.wait("picture.pull === null")


def test_pictures_arrive_and_time_passes(page):
    first, began = page.value("picture.frame"), time.monotonic()
    page.wait(f"picture.frame > {first + 30}")
    assert page.value("picture.time") > 0.0 and time.monotonic() - began < 30.0


def test_sliders_buttons_and_choices_reach_the_engine(running, page):
    page.value("(() => { const r = $('knob-gravity'); r.value = 0; r.oninput(); })()")
    page.wait("picture.frame")
    page.value("$('variant').value = 'hard'; $('variant').onchange()")
    page.wait("picture.variant === 'hard'")
    assert not running.engine.worlds.params["gravity"].any()
    page.value("$('pause').onclick()")
    page.wait("picture.paused")
    stopped = page.value("picture.time")
    page.value("$('step').onclick()")
    page.wait(f"picture.time > {stopped} + 0.049")
    page.value("$('pause').onclick()")
    page.wait("!picture.paused")


def test_a_lost_connection_is_said(running, page):
    page.value("socket.close()")
    page.wait("$('clock').textContent.startsWith('not connected')")
