"""The page of `tdcr view` in a real browser: Debian's Chromium, driven by Playwright."""

import contextlib
import os
import pathlib
import shutil
import signal
import subprocess
import time

import numpy as np
import pytest

CHROMIUM = next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])), None)
sync_api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed: the page was not opened in a browser")

SHELF = pathlib.Path(__file__).parents[2] / "examples/scenes/shelf.toml"
# WebGL by the processor, where there is no graphics card.
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]


@contextlib.contextmanager
def serving(*options):
    """The address of a page, served while the context lasts."""
    binary = os.environ.get("TDCR") or str(pathlib.Path(__file__).parents[2] / "target/release/tdcr")
    command = [binary, "view", "--no-browser", *map(str, options)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        try:
            yield server.stdout.readline().strip()
        finally:
            server.send_signal(signal.SIGINT)
            server.wait(20)


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@contextlib.contextmanager
def opened(browser, address, **context):
    """A page at an address, without a word on its console."""
    page = browser.new_page(viewport={"width": 1280, "height": 800}, **context)
    said = []
    # Software WebGL warns of slow read-backs, which only pictures need.
    page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto(address)
    page.wait_for_selector("body[data-tip]", state="attached", timeout=60_000)
    yield page
    page.close()
    assert not said


def numbers(page, name):
    return np.array([float(number) for number in page.get_attribute("body", f"data-{name}").split(",")])


def wait_for(page, name, is_there):
    """The numbers that a page shows, once they are as wanted."""
    end = time.monotonic() + 30
    while not is_there(found := numbers(page, name)):
        assert time.monotonic() < end, f"{name}: {found}"
        page.wait_for_timeout(20)
    return found


def test_a_slider_moves_the_tip_to_where_settle_has_it(browser, tdcr):
    with serving() as address, opened(browser, address) as page:
        assert page.title() == "2m - tdcr view"
        slider = page.locator("[data-tendon='1']")
        slider.evaluate("(input) => { input.value = 0.030; input.dispatchEvent(new Event('input', { bubbles: true })); }")
        command = wait_for(page, "command", lambda command: abs(command[0] - 0.030) < 1e-9)
        text = ",".join(map(repr, command.tolist()))
        expected = tdcr("settle", "--command", text)["positions"][-1]
        np.testing.assert_allclose(numbers(page, "tip"), expected, atol=1e-6)


def test_a_dragged_disc_arrives_and_can_be_undone(browser):
    with serving() as address, opened(browser, address) as page:
        before, command = numbers(page, "tip"), numbers(page, "command")
        box = page.locator("#stage canvas").bounding_box()
        # Where the tip is on the screen.
        x, y = page.evaluate(
            """async ([width, height]) => {
                const { stage } = await import('./main.js');
                const place = stage.solids.filter((one) => one.userData.disc !== null).at(-1).position.clone();
                place.project(stage.camera);
                return [((place.x + 1) / 2) * width, ((1 - place.y) / 2) * height];
            }""",
            [box["width"], box["height"]],
        )
        page.mouse.move(box["x"] + x, box["y"] + y)
        page.mouse.down()
        page.mouse.move(box["x"] + x + 60, box["y"] + y + 20, steps=12)
        moved = wait_for(page, "tip", lambda tip: np.linalg.norm(tip - before) > 0.02)
        assert page.get_attribute("body", "data-settled") == "true"
        page.mouse.up()
        page.keyboard.press("Control+z")
        wait_for(page, "command", lambda found: np.allclose(found, command, atol=1e-12))
        assert np.linalg.norm(moved - before) > 0.02


def test_a_broken_robot_shows_its_error_and_a_mended_one_is_shown(browser, tmp_path):
    with serving() as address, opened(browser, address) as page:
        page.locator("summary").click()
        text = page.input_value("#toml")
        page.fill("#toml", text.replace("discs = 5", "discs = 0", 1))
        page.wait_for_selector("#toml-error:visible")
        assert "discs" in page.inner_text("#toml-error")
        page.fill("#toml", text.replace('name = "2m"', 'name = "mine"', 1))
        sync_api.expect(page).to_have_title("mine - tdcr view")
        assert not page.is_visible("#toml-error")


def test_contacts_with_a_scene_are_shown(browser):
    command = "0.034,0.007,0.001,0.026,0.015,0.019"
    with serving("--scene", SHELF, "--command", command) as address, opened(browser, address) as page:
        assert int(page.get_attribute("body", "data-contacts")) > 0
        assert page.is_visible("#contacts tbody tr >> nth=0")


def test_pages_are_readable_on_a_tablet_and_in_the_dark(browser):
    with serving() as address, opened(browser, address, color_scheme="dark") as page:
        page.set_viewport_size({"width": 768, "height": 1024})
        stage, panel = (page.locator(place).bounding_box() for place in ["#stage", "#panel"])
        assert panel["y"] >= stage["y"] + stage["height"] - 1
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_a_notebook_shows_the_page_of_a_robot_that_is_at_hand(browser):
    tdcr = pytest.importorskip("tdcr")
    command = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019]
    with tdcr.view("2m", command=command) as viewer:
        assert viewer.address in viewer._repr_html_()
        with opened(browser, viewer.address) as page:
            np.testing.assert_allclose(numbers(page, "tip"), tdcr.settle("2m", command).tip, atol=1e-9)
    with pytest.raises(sync_api.Error):
        browser.new_page().goto(viewer.address)
