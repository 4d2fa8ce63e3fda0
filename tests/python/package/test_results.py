"""Results: compared by value, shown in a few lines, their rows taken like those of arrays, drawn in notebooks."""

from __future__ import annotations

import copy
import pickle
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr.errors import InputError

ROBOT = tdcr.Robot("2m")
COMMANDS = ROBOT.random_commands(6)


def results() -> list[Any]:
    """One of each kind of result that is made without files."""
    settled = tdcr.settle_batch(ROBOT, COMMANDS)
    motions = tdcr.rollout(ROBOT, COMMANDS[:3, np.newaxis].repeat(4, axis=1))
    target = tdcr.inverse.Target(position=settled[0].tip)
    shape = tdcr.inverse.shape(ROBOT, target)
    unknowns = {"gain": [f"gain[{t}]" for t in range(6)]}
    path = tdcr.FrictionPath(ROBOT)
    view = tdcr.render(ROBOT, settled[0])[0]
    cloud = tdcr.cloud(ROBOT, settled[0])
    return [
        settled,
        settled[0],
        motions,
        motions[1],
        motions[1].end,
        target,
        shape,
        tdcr.inverse.ShapeController(ROBOT).path().follow(target),
        tdcr.calibrate(ROBOT, unknowns, COMMANDS, settled.tips[:, np.newaxis]),
        path.start(COMMANDS[0]),
        path.start(COMMANDS[0]).tendons[0],
        tdcr.rollout_vjp(ROBOT, COMMANDS[:2, np.newaxis], by_positions=np.ones((2, 1, 10, 3))),
        tdcr.linearise(ROBOT, motions[1].end, COMMANDS[0]),
        view,
        cloud,
        tdcr.Sample(COMMANDS[0], cloud.points, cloud.colors),
        tdcr.metrics.emd(cloud.points[:50], cloud.points[50:100]),
        tdcr.Loads(payload=0.01, wrenches=(tdcr.Wrench(3, force=np.ones(3)),)),
    ]


def test_results_are_compared_by_value_and_shown_in_twenty_lines() -> None:
    for result in results():
        other = pickle.loads(pickle.dumps(result))
        assert (result == other) is True and (result != other) is False, type(result)
        assert (result == 3) is False and (result == None) is False  # noqa: E711
        assert len(repr(result).splitlines()) <= 20 and type(result).__name__ in repr(result)
        assert len(repr(result)) < 2500
    first, second = (tdcr.settle(ROBOT, command) for command in COMMANDS[:2])
    assert (first == second) is False
    changed = copy.deepcopy(first)
    changed.tensions[3] += 1e-12
    assert first != changed
    # Rows that failed are not numbers, and equal all the same.
    diverged = tdcr.rollout(ROBOT, COMMANDS[:1, np.newaxis], payload=1e200)
    assert np.isnan(diverged.positions).any() and diverged == copy.deepcopy(diverged)


def test_slices_masks_and_numbers_take_rows() -> None:
    settled = tdcr.settle_batch(ROBOT, COMMANDS)
    mask = np.array([True, False, True, True, False, False])
    for rows in (slice(2, 5), slice(None, None, -2), mask, [0, 2, 3], np.array([-1, 0]), np.zeros(0, dtype=int)):
        taken = settled[rows]
        assert isinstance(taken, tdcr.Equilibria)
        for name in ("positions", "tensions", "converged", "stability"):
            assert np.array_equal(getattr(taken, name), getattr(settled, name)[rows])
        assert len(taken) == len(settled.residual[rows])
    assert settled[mask] == settled[[0, 2, 3]] and settled[-1] == settled[np.int64(5)]
    assert [one == settled[row] for row, one in enumerate(settled)] == [True] * 6
    for wrong, says in (
        ([True, False], r"expected \(6,\)"),
        ("a", "expected a number, a slice, a mask of 6 flags"),
        (1.5, "1.5"),
    ):
        with pytest.raises(InputError, match=says):
            settled[wrong]  # type: ignore[index]
    for row in (6, -7, [0, 6]):
        with pytest.raises(IndexError, match="expected -6 to 5"):
            settled[row]


def test_failures_keep_their_rows() -> None:
    payload = np.array([0.0, 1e200, 0.01, 1e200])
    motions = tdcr.rollout(ROBOT, COMMANDS[:4, np.newaxis], payload)
    assert sorted(motions.failures) == [1, 3]
    taken = motions[1:4]
    assert sorted(taken.failures) == [0, 2] and taken.diverged.tolist() == [True, False, True]
    assert motions[~motions.diverged].failures == {}
    gradients = tdcr.rollout_vjp(ROBOT, COMMANDS[:4, np.newaxis], np.ones((4, 1, 10, 3)), payload=payload)
    assert sorted(gradients[[3, 2]].failures) == [0] and len(gradients[2:]) == 2


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> tdcr.Dataset:
    made = tdcr.collect("2m", tmp_path_factory.mktemp("results") / "<data>", samples=10, points=100)
    assert made is not None
    return made


def test_notebooks_show_a_drawing_with_axes_and_a_table(data: tdcr.Dataset) -> None:
    for shown, words in (
        (tdcr.Robot("5m")._repr_html_(), ["5m", "Tendons", "15", "Length", "0 to 0.04 m"]),
        (tdcr.settle(ROBOT, COMMANDS[0])._repr_html_(), ["Stability", "stable", "Tensions", "N"]),
        (data._repr_html_(), ["Points of a cloud", "100", "8 samples", "&lt;data&gt;"]),
    ):
        # Well-formed, so that nothing of it breaks a page.
        root = ElementTree.fromstring(shown)
        svg = root.find(".//{http://www.w3.org/2000/svg}svg")
        assert svg is not None
        texts = [text.text for text in svg.iter("{http://www.w3.org/2000/svg}text")]
        assert {"x (mm)", "y (mm)", "z (mm)"} <= set(texts)
        assert all(word in shown for word in words), words
        assert len(shown) < 200_000
    # The tip in the drawing is where the tip is: the last corner of the first line, in the scale of the ticks.
    settled = tdcr.settle(ROBOT, COMMANDS[0])
    svg = ElementTree.fromstring(settled._repr_html_()).find(".//{http://www.w3.org/2000/svg}svg")
    assert svg is not None
    line = next(svg.iter("{http://www.w3.org/2000/svg}polyline")).attrib["points"].split()
    ticks = [(text.text, float(text.attrib["y"])) for text in svg.iter() if text.attrib.get("text-anchor") == "end"]
    (low, y_low), (high, y_high) = ((float(value or 0), y - 3.5) for value, y in (ticks[0], ticks[1]))
    height = low + (float(line[-1].split(",")[1]) - y_low) * (high - low) / (y_high - y_low)
    assert abs(height - 1e3 * settled.tip[2]) < 1.0


def test_splits_take_masks_and_compare(data: tdcr.Dataset, tmp_path: Path) -> None:
    split = data.train
    mask = np.zeros(8, dtype=bool)
    mask[[1, 4]] = True
    assert split[mask] == [split[1], split[4]] == split[np.array([1, 4])] and split[1] != split[4]
    assert split == data.split("train") and split != data.val
    with pytest.raises(IndexError, match="sample 8; expected -8 to 7"):
        split[8]


def test_copies_of_a_settler_go_on_with_its_branch() -> None:
    settler = tdcr.Settler("3m")
    path = np.linspace(*tdcr.Robot("3m").random_commands(2, seed=4), 30)
    for command in path[:15]:
        settler.follow(command, payload=0.01)
    copies = [copy.deepcopy(settler), pickle.loads(pickle.dumps(settler))]
    for command in path[15:]:
        expected = settler.follow(command, payload=0.01)
        # To the last bit, the number of Newton steps too.
        assert all(one.follow(command, payload=0.01) == expected for one in copies)
    assert pickle.loads(pickle.dumps(tdcr.Settler("2m"))).follow(COMMANDS[0]) == tdcr.settle("2m", COMMANDS[0])
    assert settler.settle(path[0], payload=0.02) == settler.settle(path[0], tdcr.Loads(payload=0.02))
    with pytest.raises(InputError, match="given by `payload` beside `loads`"):
        settler.settle(path[0], tdcr.Loads(), payload=0.02)
