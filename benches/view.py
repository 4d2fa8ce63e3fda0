"""Frames of `tdcr view`, in Chromium: the time to the first one, what the solver takes of those of a drag, and from a move of the
hand to its frame; with a network's cloud following (the default MLP, hardly trained: its time is that of any) and without.

    python benches/view.py target/release/tdcr [ROBOT ...]

needs Playwright and Chromium.
"""

from __future__ import annotations

import pathlib
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time

from playwright.sync_api import Page, sync_playwright

ROBOTS = ["2m", "3m", "5m"]
# WebGL by the processor, where there is no graphics card.
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
# The tip is led around a circle about where it is, one move of the hand after the frame that answers the last. A disc that is on
# its way still goes on in frames of its own, which take the solver's time but answer no move.
DRAG = """async ([count, radius]) => {
    const { stage } = await import('./main.js');
    const tip = stage.solids.filter((one) => one.userData.disc !== null).at(-1);
    const middle = tip.position.toArray();
    const found = { solves: [], trips: [] };
    const frames = new MutationObserver(() => found.solves.push(Number(document.body.dataset.solve)));
    frames.observe(document.body, { attributeFilter: ['data-solve'] });
    for (let step = 0; step < count; step++) {
        const turn = (4 * Math.PI * step) / count;
        const to = [middle[0] + radius * Math.sin(turn), middle[1] + radius * (1 - Math.cos(turn)), middle[2]];
        const before = document.body.dataset.stamp;
        stage.hand.drag(tip.userData.disc, to);
        while (document.body.dataset.stamp === before) await new Promise((done) => setTimeout(done, 0));
        found.trips.push(Number(document.body.dataset.trip));
        await new Promise(requestAnimationFrame);
    }
    frames.disconnect();
    return found;
}"""


def frames(page: Page, address: str, begun: float) -> tuple[float, list[float], list[float]]:
    """Time to the first frame (s), the solver's time of each frame of a drag and that from each move to its frame (ms)."""
    page.goto(address)
    page.wait_for_selector("body[data-tip]", state="attached", timeout=120_000)
    first = time.perf_counter() - begun
    found = page.evaluate(DRAG, [240, 0.03])
    return first, [1e3 * solve for solve in found["solves"]], found["trips"]


def trained(binary: str, folder: pathlib.Path, robot: str) -> pathlib.Path:
    """A network of the usual size, trained in a moment."""
    data, run = folder / f"data-{robot}", folder / f"run-{robot}"
    collect = ["collect", "--robot", robot, "--samples", "20", "--points", "1000", "--out", data, "--quiet"]
    train = ["train", "--data", data, "--out", run, "--steps", "2", "--validate-every", "2", "--quiet"]
    for arguments in (collect, train):
        subprocess.run([binary, *map(str, arguments)], check=True)
    return run / "model.safetensors"


def main() -> None:
    binary, *robots = sys.argv[1:]
    chromium = next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])))
    print(f"{'robot':8} {'network':8} {'first frame':>12} {'solver, median':>15} {'99 %':>8} {'hand to frame, median':>22}")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        for robot in robots or ROBOTS:
            model = trained(binary, pathlib.Path(folder), robot)
            for name, options in [("-", []), ("on", ["--model", str(model)])]:
                begun = time.perf_counter()
                command = [binary, "view", "--no-browser", "--robot", robot, *options]
                with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
                    page = browser.new_page(viewport={"width": 1280, "height": 800})
                    assert server.stdout is not None
                    first, solves, trips = frames(page, server.stdout.readline().strip(), begun)
                    page.close()
                    server.send_signal(signal.SIGINT)
                solves.sort()
                tail = solves[int(0.99 * len(solves))]
                print(
                    f"{robot:8} {name:8} {first:10.2f} s {statistics.median(solves):12.2f} ms {tail:5.2f} ms "
                    f"{statistics.median(trips):19.1f} ms",
                    flush=True,
                )
        browser.close()


if __name__ == "__main__":
    main()
