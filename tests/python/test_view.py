"""The page of `tdcr view` in a real browser: Debian's Chromium, driven by Playwright."""

import contextlib
import os
import pathlib
import shutil
import signal
import subprocess
import time
import webbrowser

import numpy as np
import pytest

CHROMIUM = next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])), None)
sync_api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed: the page was not opened in a browser")

DOCS = pathlib.Path(__file__).parents[2] / "docs"
RIG = pathlib.Path(__file__).parents[2] / "examples/rig-sim.toml"
BENT = "0.034,0.007,0.001,0.026,0.015,0.019"
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
    page.goto(address, timeout=60_000)
    page.wait_for_selector("body[data-tip]", state="attached", timeout=60_000)
    yield page
    page.close()
    assert not said


def picture(page, name):
    """Makes a picture of the guide anew, where WRITE_PICTURES is set."""
    if os.environ.get("WRITE_PICTURES"):
        page.screenshot(path=DOCS / name)


def numbers(page, name):
    return np.array([float(number) for number in page.get_attribute("body", f"data-{name}").split(",")])


def wait_for(page, name, is_there):
    """The numbers that a page shows, once they are as wanted."""
    end = time.monotonic() + 30
    while not is_there(found := numbers(page, name)):
        assert time.monotonic() < end, f"{name}: {found}"
        page.wait_for_timeout(20)
    return found


def wait_for_new(page, name):
    """The numbers that a page shows once it shows any."""
    page.wait_for_selector(f"body[data-{name}]", state="attached")
    return numbers(page, name)


def place_of_tip(page, box):
    """Where the tip is on the stage (pixels)."""
    return page.evaluate(
        """async ([width, height]) => {
            const { stage } = await import('./main.js');
            const place = stage.solids.filter((one) => one.userData.disc !== null).at(-1).position.clone();
            place.project(stage.camera);
            return [((place.x + 1) / 2) * width, ((1 - place.y) / 2) * height];
        }""",
        [box["width"], box["height"]],
    )


def set_tendon(page, tendon, value):
    """Moves the slider of a tendon, from 1."""
    slider = page.locator(f"[data-tendon='{tendon}']")
    slider.evaluate(
        "(input, value) => { input.value = value; input.dispatchEvent(new Event('input', { bubbles: true })); }", value
    )


def test_a_slider_moves_the_tip_to_where_settle_has_it(browser, tdcr):
    with serving() as address, opened(browser, address) as page:
        assert page.title() == "2m - tdcr view"
        set_tendon(page, 1, 0.030)
        command = wait_for(page, "command", lambda command: abs(command[0] - 0.030) < 1e-9)
        text = ",".join(map(repr, command.tolist()))
        expected = tdcr("settle", "--command", text)["positions"][-1]
        np.testing.assert_allclose(numbers(page, "tip"), expected, atol=1e-6)


def test_a_dragged_disc_arrives_and_can_be_undone(browser):
    with serving() as address, opened(browser, address) as page:
        before, command = numbers(page, "tip"), numbers(page, "command")
        box = page.locator("#stage canvas").bounding_box()
        x, y = place_of_tip(page, box)
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
        page.locator("#robot-section summary").click()
        text = page.input_value("#toml")
        page.fill("#toml", text.replace("discs = 5", "discs = 0", 1))
        page.wait_for_selector("#toml-error:visible")
        assert "discs" in page.inner_text("#toml-error")
        line = int(page.get_attribute("body", "data-wrong-line"))
        assert page.input_value("#toml").split("\n")[line].strip() == "discs = 0"
        # The mark goes with the text.
        page.locator("#toml").evaluate(
            "(text, line) => { text.scrollTop = line * parseFloat(getComputedStyle(text).lineHeight) - 40; }", line
        )
        page.wait_for_selector("#toml-mark:visible")
        page.fill("#toml", text.replace('name = "2m"', 'name = "mine"', 1))
        sync_api.expect(page).to_have_title("mine - tdcr view")
        assert not page.is_visible("#toml-error")


def push_tip(page, by):
    """Pushes the tip with the mouse and Shift by so many pixels, and holds it."""
    box = page.locator("#stage canvas").bounding_box()
    x, y = place_of_tip(page, box)
    page.keyboard.down("Shift")
    page.mouse.move(box["x"] + x, box["y"] + y)
    page.mouse.down()
    page.mouse.move(box["x"] + x + by, box["y"] + y, steps=4)


def test_a_robot_in_motion_swings_when_it_is_pushed_and_let_go(browser):
    with serving("--command", BENT) as address, opened(browser, address) as page:
        rest = numbers(page, "tip")
        page.check("input[value=in_motion]")
        wait_for(page, "time", lambda time: time[0] > 0.2)
        assert page.get_attribute("body", "data-physics") == "in_motion"
        push_tip(page, 20)
        wait_for(page, "tip", lambda tip: np.linalg.norm(tip - rest) > 4e-3)
        page.mouse.up()
        page.keyboard.up("Shift")
        # Its slowest motion decays within many seconds.
        wait_for(page, "tip", lambda tip: np.linalg.norm(tip - rest) < 2e-3)
        page.select_option("#plotted", "tensions")
        assert page.inner_text("#legend").split() == [str(tendon) for tendon in range(1, 7)]


def test_friction_is_chosen_in_the_page_and_the_cameras_show_the_robot(browser):
    with serving() as address, opened(browser, address) as page:
        page.check("input[value=with_friction]")
        page.wait_for_selector("#friction:visible")
        page.wait_for_selector("body[data-physics=with_friction]", state="attached")
        page.locator("#cameras-section summary").click()
        page.wait_for_selector("body[data-pictures='8']", state="attached")
        colours = page.locator("#pictures canvas").first.evaluate(
            """(canvas) => {
                const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
                return new Set(new Uint32Array(data.buffer)).size;
            }"""
        )
        assert colours > 10


def test_commands_are_recorded_saved_and_played_again(browser, tmp_path, tdcr):
    with serving() as address, opened(browser, address) as page:
        page.click("#record")
        for value in [0.030, 0.025, 0.020]:
            set_tendon(page, 1, value)
            wait_for(page, "command", lambda command, value=value: abs(command[0] - value) < 1e-9)
        page.click("#record")
        with page.expect_download() as saved:
            page.click("#save-commands")
        saved.value.save_as(tmp_path / "commands.csv")
        with page.expect_download() as picture:
            page.click("#save-picture")
        assert pathlib.Path(picture.value.path()).read_bytes()[:4] == b"\x89PNG"
    settled = tdcr("settle", "--commands", str(tmp_path / "commands.csv"))
    assert settled
    with serving("--commands", tmp_path / "commands.csv") as address, opened(browser, address) as page:
        page.click("#play")
        wait_for(page, "command", lambda command: abs(command[0] - 0.020) < 1e-9)


def test_the_cloud_of_a_network_and_of_a_data_set_are_shown(browser, tmp_path, tdcr):
    data, run = tmp_path / "data", tmp_path / "run"
    tdcr("collect", "--samples", "20", "--points", "400", "--out", str(data))
    size = ["--width", "16", "--depth", "2", "--embedding", "16", "--steps", "40", "--validate-every", "20"]
    model = tdcr("train", *size, "--data", str(data), "--out", str(run))["model"]
    with serving("--data", data, "--model", model) as address, opened(browser, address) as page:
        page.wait_for_selector("body[data-predicted]", state="attached")
        first = numbers(page, "predicted")
        page.click("#sample-after")
        assert wait_for_new(page, "sample")[0] < 2e-3
        wait_for(page, "predicted", lambda apart: apart[0] != first[0])
        assert page.evaluate("import('./main.js').then(({ stage }) => [...stage.clouds.keys()].sort())") == [
            "prediction",
            "sample",
        ]
        page.uncheck("#predict")
        assert page.evaluate("import('./main.js').then(({ stage }) => [...stage.clouds.keys()])") == ["sample"]


def test_a_click_on_a_point_of_a_study_shows_its_robot(browser, tmp_path):
    binary = os.environ.get("TDCR") or str(pathlib.Path(__file__).parents[2] / "target/release/tdcr")
    text = 'robot = "2m"\nwant = ["tip"]\n[[vary]]\nwhat = "payload"\nrange = [0.0, 0.03]\nsteps = 4\n'
    (tmp_path / "study.toml").write_text(text)
    subprocess.run([binary, "study", tmp_path / "study.toml", "--out", tmp_path / "out", "--quiet"], check=True)
    with serving("--study", tmp_path / "out") as address, opened(browser, address) as page:
        before = numbers(page, "tip")
        point = page.evaluate("import('./main.js').then(({ study }) => study.points().points.at(-1))")
        canvas = page.locator("#scatter")
        box, width = canvas.bounding_box(), canvas.evaluate("(canvas) => canvas.width")
        canvas.click(position={"x": point["x"] * box["width"] / width, "y": point["y"] * box["width"] / width})
        assert page.get_attribute("body", "data-row") == "3"
        wait_for(page, "tip", lambda tip: np.linalg.norm(tip - before) > 1e-4)
        assert page.inner_text("#payload-value") == "30 g"


def test_a_rig_is_armed_in_the_page_bent_and_let_go(browser, tmp_path):
    # The example's with two small cameras, which are quick.
    small = "[[cameras]]".join(RIG.read_text().split("[[cameras]]")[:3]).replace("[640, 480]", "[160, 120]")
    (tmp_path / "rig.toml").write_text(small)
    shutil.copy(RIG.parent / "paper-robot.toml", tmp_path)
    with serving("--rig", tmp_path / "rig.toml") as address, opened(browser, address) as page:
        page.wait_for_selector("#rig-servos tbody tr")
        assert page.locator("#rig-modules input").first.is_disabled()
        assert not page.is_visible("#tendons")
        home = numbers(page, "tip")
        page.click("#rig-arm")
        page.wait_for_selector("body[data-armed=here][data-moving=false]", state="attached", timeout=60_000)
        bend = page.locator("#rig-modules input").first
        bend.evaluate("(input) => { input.value = input.max / 2; input.dispatchEvent(new Event('input', { bubbles: true })); }")
        wait_for(page, "tip", lambda tip: np.linalg.norm(tip - home) > 5e-3)
        wait_for(page, "measured", lambda points: points[0] > 100)
        page.wait_for_selector("body[data-taken='2']", state="attached")
        coloured = page.locator("#taken canvas").first.evaluate(
            """(canvas) => {
                const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
                return data.filter((value, index) => index % 4 === 0 && value > 127).length;
            }"""
        )
        assert 50 < coloured < 160 * 120 / 4
        picture(page, "view-rig.png")
        page.click("#rig-arm")
        page.wait_for_selector("body[data-armed=no]", state="attached", timeout=60_000)


def test_contacts_with_a_scene_are_shown(browser):
    with serving("--scene", SHELF, "--command", BENT) as address, opened(browser, address) as page:
        assert int(page.get_attribute("body", "data-contacts")) > 0
        assert page.is_visible("#contacts tbody tr >> nth=0")
        picture(page, "view.png")


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
        # What a program computes is shown as it is: here a robot in motion.
        moving = tdcr.MovingRobot("2m")
        moving.reset(command)
        moving.step(np.full(6, 0.01), frame_skip=40)
        viewer.show(moving)
        with opened(browser, viewer.address) as page:
            wait_for(page, "tip", lambda tip: np.allclose(tip, moving.tip, atol=1e-9))
            assert page.get_attribute("body", "data-physics") == "given"
            viewer.show(command)
            wait_for(page, "tip", lambda tip: np.allclose(tip, tdcr.settle("2m", command).tip, atol=1e-6))
    with pytest.raises(sync_api.Error):
        browser.new_page().goto(viewer.address)


def test_an_environment_for_humans_shows_its_steps_and_its_goal_on_a_page(browser, monkeypatch):
    pytest.importorskip("tdcr")
    gymnasium = pytest.importorskip("gymnasium")
    monkeypatch.setattr(webbrowser, "open", lambda address: True)
    ranges = {"payload": (0.0, 0.02), "gain[0]": (300.0, 700.0)}
    env = gymnasium.make("tdcr.envs:tdcr/ReachObstacle2m-v0", render_mode="human", randomise=ranges).unwrapped
    env.reset(seed=1)
    with opened(browser, env.window.viewer.address) as page:
        for action in (np.ones(6), -np.ones(6)):
            env.step(action)
            tip = env.episodes.world.simulation.positions()[0, -1]
            wait_for(page, "tip", lambda found, tip=tip: np.allclose(found, tip, atol=1e-9))
        assert page.get_attribute("body", "data-physics") == "given"
        wait_for(page, "targets", lambda balls: balls[0] == 1)
        # Another robot among other obstacles.
        env.reset(seed=2)
        tip = env.episodes.world.simulation.positions()[0, -1]
        wait_for(page, "tip", lambda found: np.allclose(found, tip, atol=1e-9))
        picture(page, "view-env.png")
    env.close()
