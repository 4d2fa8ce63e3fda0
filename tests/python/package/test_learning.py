"""Training, predicting and scoring from Python."""

from __future__ import annotations

import json
import multiprocessing
import os
import pickle
import signal
import threading
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from by_command_line import TINY, command_line

import tdcr
from tdcr.errors import CommandError, DataError, InputError, LoadsError, TdcrError, TrainError

SIZE = ["--width", 16, "--depth", 2, "--embedding", 16, "--clouds", 8, "--validate-every", 20]
"""The options of `TINY`."""

SCORING: dict[str, Any] = {"points": 400, "emd_points": 100}


@pytest.fixture(scope="module")
def predictor(run: tdcr.Run) -> tdcr.Predictor:
    return run.predictor


@pytest.fixture(scope="module")
def conditions(dataset: tdcr.Dataset) -> np.ndarray:
    return dataset.test.conditions.astype(np.float64)


def test_a_run_is_that_of_the_command_line(run: tdcr.Run, dataset: tdcr.Dataset, folder: Path) -> None:
    out = folder / "run-by-command"
    said = command_line("train", "--data", dataset.path, "--out", out, *SIZE, "--steps", 60, "--colors")
    for file in ("model.safetensors", "log.csv"):
        assert (run.folder / file).read_bytes() == (out / file).read_bytes()
    # Of the refined network, where that is better.
    assert said["validation_cd"] == pytest.approx(run.predictor.about["validation_cd"], rel=1e-6)
    assert said["validation_cd"] <= run.validation_cd.min() * (1 + 1e-6)
    assert (said["steps"], said["parameters"]) == (run.steps, run.predictor.parameters)
    assert said["best_step"] == run.validation_steps[run.validation_cd.argmin()] == run.predictor.about["step"]
    assert list(run.validation_steps) == [20, 40, 60] and run.losses.shape == (60,)


def test_other_options_are_those_of_the_command_line(dataset: tdcr.Dataset, run: tdcr.Run, folder: Path) -> None:
    def same(name: str, arguments: dict[str, Any], *options: object) -> None:
        made = tdcr.train(out=folder / name, steps=20, **TINY, **arguments)
        flags = ["--steps", 20, *SIZE, *options]
        command_line("train", *flags, "--out", folder / f"{name}-by-command")
        found, expected = (path.read_bytes() for path in (made.model, folder / f"{name}-by-command/model.safetensors"))
        assert found == expected, name

    data: list[object] = ["--data", dataset.path]
    small = {"net": "hybrid", "channels": (8, 8, 8), "resolutions": (4, 4, 4), "blocks": 1, "context": 8}
    flags = ["--net", "hybrid", "--channels", "8,8,8", "--resolutions", "4,4,4", "--blocks", 1, "--context", 8]
    same("hybrid", {"data": dataset, **small}, *data, *flags)
    rates = {"optimizer": "adamw", "learning_rate": 1e-3, "warmup": 1, "points": 50, "seed": 9}
    flags = ["--optimizer", "adamw", "--learning-rate", 1e-3, "--warmup", 1, "--points", 50, "--seed", 9]
    path = {"coupling": "optimal-transport:8", "time_exponent": 1.5, "patience": 4, "precision": "float32"}
    flags += ["--coupling", "optimal-transport:8", "--time-exponent", 1.5, "--patience", 4, "--precision", "float32"]
    path |= {"late_times": 0.25, "prior_cut": 0, "octaves": 2, "condition_blocks": 1}
    flags += ["--late-times", 0.25, "--prior-cut", 0, "--octaves", 2, "--condition-blocks", 1]
    same("rates", {"data": dataset.path, **rates, **path}, *data, *flags)
    start = {"init": run.folder, "normalisation_from": run.model, "colors": True, "color_weight": 0.2}
    flags = ["--init", run.model, "--normalisation-from", run.model, "--colors", "--color-weight", 0.2]
    same("start", {"data": dataset, **start}, *data, *flags)
    stream = {"stream": "2m", "stream_points": 200, "window": 8, "fresh": 1, "payload": (0.0, 0.03)}
    flags = ["--stream", "2m", "--stream-points", 200, "--window", 8, "--fresh", 1, "--payload", "0:0.03"]
    same("stream", {**stream, "validation": dataset.path}, *flags, "--validation", dataset.path)


def test_a_run_that_is_stopped_ends_as_one_that_is_not(run: tdcr.Run, dataset: tdcr.Dataset, folder: Path) -> None:
    arguments: dict[str, Any] = {"out": folder / "stopped-run", "steps": 60, "colors": True, **TINY}
    taken = 0

    def stop(count: int) -> None:
        nonlocal taken
        taken += count
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tdcr.train(dataset, progress=stop, **arguments)
    done: list[int] = []
    again = tdcr.train(dataset, progress=done.append, **arguments)
    assert sum(done) == 60
    for file in ("model.safetensors", "state.safetensors", "log.csv"):
        assert (again.folder / file).read_bytes() == (run.folder / file).read_bytes()
    # Ctrl-C ends a run of many steps soon.
    timer = threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        tdcr.train(dataset, folder / "endless", steps=10_000_000, **TINY)
    timer.join()
    with pytest.raises(TrainError, match="cannot be resumed: .*; choose another folder"):
        tdcr.train(dataset, folder / "endless", steps=10_000_000, **{**TINY, "width": 32})


def test_clouds_are_those_of_the_command_line(
    predictor: tdcr.Predictor, run: tdcr.Run, conditions: np.ndarray, folder: Path
) -> None:
    table, archive = folder / "commands.csv", folder / "clouds.npz"
    np.savetxt(table, conditions, delimiter=",")
    shared = ["--model", run.model, "--commands", table, "--points", 100, "--seed", 4]
    sampler = {"sampler": "heun", "sampler_steps": 3, "sampler_power": 1.5}
    flags = ["--sampler", "heun", "--sampler-steps", 3, "--sampler-power", 1.5]
    adaptive = {"sampler": "exponential", "sampler_tolerance": 1e-2}
    for options, extra in [
        ({}, []),
        (sampler, flags),
        (adaptive, ["--sampler", "exponential", "--sampler-tolerance", 1e-2]),
    ]:
        said = command_line("predict", *shared, *extra, "--prior-samples", 3, "--out", archive)
        found = predictor.clouds(conditions, 100, seed=4, uncertainty=True, prior_samples=3, **options)  # type: ignore[arg-type]
        with np.load(archive) as stored:
            assert np.array_equal(found.points, stored["points"])
            assert found.colors is not None and np.array_equal(found.colors, stored["rgb"])
            assert found.uncertainty is not None and np.array_equal(found.uncertainty, stored["uncertainty"])
        assert list(found.evaluations) == [row["evaluations"] for row in said]
    points = predictor.predict(conditions, 100, seed=4)
    assert points.shape == (2, 100, 3) and points.dtype == np.float32
    assert np.array_equal(predictor.predict(conditions[1], 100, seed=4)[0], points[1])
    plain = predictor.clouds(conditions, 100, seed=4)
    assert plain.uncertainty is None and np.array_equal(plain.points, points)
    assert np.array_equal(
        predictor.uncertainty(conditions, 100, seed=4),
        predictor.clouds(conditions, 100, seed=4, uncertainty=True).uncertainty,
    )
    archive.unlink()


def test_a_predictor_says_what_it_is(predictor: tdcr.Predictor, dataset: tdcr.Dataset, run: tdcr.Run) -> None:
    assert predictor.robot == tdcr.Robot("2m")
    assert (predictor.base, predictor.payload, predictor.has_colors) == (False, (0.0, 0.03), True)
    assert (predictor.condition_width, predictor.condition_ranges.shape) == (7, (7, 2))
    assert np.array_equal(predictor.condition_ranges[:, 0], dataset.normalisation.condition_min)
    assert predictor.normalisation.scale == dataset.normalisation.scale
    assert predictor.about["settings"]["steps"] == 60
    refined = predictor.about["validation_cd"] < run.validation_cd.min() * (1 - 1e-6)
    factor = predictor.uncertainty_factor
    assert predictor.refined == refined and factor is not None and factor > 0
    assert tdcr.Predictor(run.folder, precision="float32").precision == "float32"
    assert "2m" in repr(predictor) and "Run(" in repr(run)
    copy = run.folder / "copy.safetensors"
    predictor.save(copy)
    assert copy.read_bytes() == run.model.read_bytes()


def predicted(arguments: tuple[tdcr.Predictor, np.ndarray]) -> np.ndarray:
    predictor, conditions = arguments
    return predictor.predict(conditions, 50)


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_other_processes_predict(predictor: tdcr.Predictor, conditions: np.ndarray, method: str) -> None:
    expected = predictor.predict(conditions, 50)
    with multiprocessing.get_context(method).Pool(1) as pool:
        found = pool.map_async(predicted, [(predictor, conditions)]).get(timeout=60.0)
    assert np.array_equal(found[0], expected)
    assert pickle.loads(pickle.dumps(predictor)).path == predictor.path


def test_predictions_count_and_stop(predictor: tdcr.Predictor, conditions: np.ndarray) -> None:
    done: list[int] = []
    predictor.predict(conditions, 50, progress=done.append)
    assert sum(done) == 2
    timer = threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        predictor.predict(np.tile(conditions, (100_000, 1)), 200)
    timer.join()


def test_conditions_that_cannot_be_are_named(predictor: tdcr.Predictor, conditions: np.ndarray) -> None:
    def refused(error: type[TdcrError], match: str, rows: Any, **options: Any) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", tdcr.ExtrapolationWarning)
            with pytest.raises(error, match=match):
                predictor.predict(rows, **{"points": 20, **options})

    def changed(column: int, value: float) -> np.ndarray:
        rows = conditions.copy()
        rows[1, column] = value
        return rows

    refused(InputError, "conditions has 6 entries a row; expected 7, one for each tendon of 2m, then", conditions[:, :6])
    refused(InputError, r"conditions\[1\]\[2\] is nan", changed(2, np.nan))
    refused(CommandError, "row 1: ", changed(2, 9.0))
    refused(LoadsError, "row 1: ", changed(6, -0.1))
    refused(InputError, "points is 0; expected 1", conditions, points=0)
    refused(InputError, 'sampler is "rk4"; expected one of "heun"', conditions, sampler="rk4")
    refused(InputError, "sampler steps is 0", conditions, sampler_steps=0)
    refused(InputError, "expected one of them", conditions, sampler_power=2.0, sampler_tolerance=0.1)
    with pytest.raises(InputError, match="points is 15; expected 16 or more"):
        predictor.uncertainty(conditions, 15)
    with pytest.warns(tdcr.ExtrapolationWarning, match=r"1 of 2 conditions .* number 6 of row 1 is 0.1, the range 0.0 to"):
        predictor.predict(changed(6, 0.1), 20)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        predictor.predict(conditions.astype(np.float32), 20)
        predictor.predict(predictor.condition_ranges.T, 20)


def test_scores_are_those_of_the_command_line(
    run: tdcr.Run, dataset: tdcr.Dataset, predictor: tdcr.Predictor, folder: Path
) -> None:
    flags = ["--data", dataset.path, "--points", 400, "--emd-points", 100, "--worst", 1]
    expected = command_line("eval", "--model", run.model, *flags)
    done: list[int] = []
    assert tdcr.evaluate(run.folder, dataset, worst=1, progress=done.append, **SCORING) == expected
    assert sum(done) == 2
    pages = [folder / "by-command.html", folder / "scores.html"]
    steps = command_line("eval", "--model", run.model, *flags, "--sampler-steps", 4, "--seed", 7, "--report", pages[0])
    options: dict[str, Any] = {"worst": 1, "seed": 7, "sampler_steps": 4, "report": pages[1], **SCORING}
    assert tdcr.evaluate(predictor, dataset, **options) == steps
    assert pages[0].read_bytes() == pages[1].read_bytes()
    first = command_line("eval", "--model", run.model, *flags, "--tests", 1)
    assert tdcr.evaluate(predictor, dataset, tests=1, worst=1, **SCORING) == first
    assert (first["tests"], expected["tests"]) == (1, 2)
    with pytest.raises(InputError, match="3 test commands are to be scored; expected 1 to 2"):
        tdcr.evaluate(predictor, dataset, tests=3, **SCORING)


def test_clouds_of_any_program_are_scored(
    predictor: tdcr.Predictor, dataset: tdcr.Dataset, conditions: np.ndarray, folder: Path
) -> None:
    clouds = predictor.clouds(conditions, 400)
    file = folder / "strangers.npz"
    np.savez(file, points=clouds.points, rgb=clouds.colors, commands=conditions.astype(np.float32))
    flags = ["--data", dataset.path, "--points", 400, "--emd-points", 100]
    pages = [folder / "strangers-by-command.html", folder / "strangers.html"]
    expected = command_line("eval", "--predictions", file, *flags, "--report", pages[0])
    of_arrays = tdcr.evaluate(data=dataset, predictions=clouds.points, colors=clouds.colors, commands=conditions, **SCORING)
    assert tdcr.evaluate(data=dataset, predictions=file, report=pages[1], **SCORING) == of_arrays == expected
    assert pages[0].read_bytes() == pages[1].read_bytes()
    assert expected["color"] is not None
    truth = tdcr.evaluate(data=dataset, predictions=dataset.test.clouds, **SCORING)
    assert truth["cd"] < 1e-3 * expected["cd"] and truth["precision"] is None

    def refused(match: str, **arguments: Any) -> None:
        with pytest.raises(TdcrError, match=match):
            tdcr.evaluate(data=dataset, **{**SCORING, **arguments})

    refused("sampler_steps is of a model; predictions are scored", sampler_steps=4, predictions=clouds.points)
    refused(r"predictions has shape \(2, 400, 2\)", predictions=clouds.points[..., :2])
    refused(
        r"colors has shape \(2, 400\) of uint8; expected \(2, 400, 3\)",
        predictions=clouds.points,
        colors=np.zeros((2, 400), np.uint8),
    )
    refused("commands has 1 rows; expected 2", predictions=clouds.points, commands=conditions[:1])
    refused("^points is 401; expected 1 to 400", predictions=clouds.points, points=401)
    refused("^emd_points is 300; expected 1 to 200", predictions=clouds.points, points=200, emd_points=300)
    usual = tdcr.evaluate(data=dataset, predictions=clouds.points)
    assert (usual["points"], usual["emd_points"]) == (400, 400)
    refused("1 .*2|2 .*1", predictions=clouds.points[:1])
    refused("colors is of predictions; a model is scored", model=predictor, colors=clouds.colors)
    refused("report is .*scores.pdf'; expected a name that ends in .html", predictions=file, report=folder / "scores.pdf")
    refused("there is no folder .*nowhere", predictions=file, report=folder / "nowhere/scores.html")


def test_several_methods_are_scored_beside_each_other(
    run: tdcr.Run, predictor: tdcr.Predictor, dataset: tdcr.Dataset, folder: Path
) -> None:
    truth, conditions = dataset.test.clouds, dataset.test.conditions
    near, far = truth + np.float32(0.001), truth + np.float32(0.004)
    files = [folder / "near.npz", folder / "far.npz"]
    np.savez(files[0], points=near, commands=conditions)
    said = {"method": np.array("für fern"), "training_seconds": np.array(12.5), "prediction_seconds": np.float64(0.25)}
    np.savez(files[1], points=far, commands=conditions, **said)
    flags = ["--data", dataset.path, "--points", 400, "--emd-points", 100, "--worst", 1]
    pages = [folder / "methods-by-command.html", folder / "methods.html"]
    given = [part for file in files for part in ("--predictions", file)]
    expected = command_line("eval", *given, "--model", run.model, *flags, "--report", pages[0])
    options: dict[str, Any] = {"data": dataset, "worst": 1, **SCORING}
    found = tdcr.evaluate(predictor, predictions=files, report=pages[1], **options)
    for scores in (expected, found):
        for row in scores["methods"]:
            # A time that is measured is another one each time.
            row["prediction_seconds"] = None if row["key"] == "network" else row["prediction_seconds"]
    assert found == expected
    assert "für fern" in pages[1].read_text() and "Prediction (ms)" in pages[1].read_text()
    rows = {row["name"]: row for row in found["methods"]}
    assert [row["name"] for row in found["methods"] if row["kind"] == "method"] == ["network", "near", "für fern"]
    assert (rows["für fern"]["training_seconds"], rows["für fern"]["prediction_seconds"]) == (12.5, 0.25)
    assert rows["near"]["cd"] < rows["für fern"]["cd"] and rows["near"]["best"]["test"] in (0, 1)
    # By names, as arrays and files; each is as it is alone.
    named = tdcr.evaluate(predictions={"a": far, "b": str(files[0])}, commands=None, **options)
    by_name = {row["key"]: row for row in named["methods"]}
    for key, values in (("a", far), ("b", near)):
        alone = tdcr.evaluate(predictions=values, **options)
        assert "methods" not in alone
        for score in ("cd", "emd", "emd_squared", "tip"):
            assert by_name[key][score] == alone[score]
    # Models go by their files.
    copy = folder / "copy.safetensors"
    copy.write_bytes(Path(run.model).read_bytes())
    both = [row for row in tdcr.evaluate([run.model, copy], **options)["methods"] if row["kind"] == "method"]
    assert [row["name"] for row in both] == [str(run.model), str(copy)] and both[0]["cd"] == both[1]["cd"]

    def refused(match: str, **arguments: Any) -> None:
        with pytest.raises(InputError, match=match):
            tdcr.evaluate(**{**options, **arguments})

    refused("^c: 1 predicted clouds, expected 2", predictions={"a": far, "c": truth[:1]})
    refused("^c: predicted cloud 0 is of the command", predictions={"c": truth, "d": far}, commands=conditions[::-1])
    refused("^c: points is 400; expected 1 to 399", predictions={"a": far, "c": truth[:, :399]})
    refused("far.npz: two predictors have the key `für fern`", predictions=[files[1], files[1]])
    refused("^floor: two predictors have the key `floor`", predictions={"a": far, "floor": truth})
    refused("predictions is an empty dictionary", predictions={})
    refused("model is an empty list", model=[])


def test_a_distilled_network_is_that_of_the_command_line(
    run: tdcr.Run, dataset: tdcr.Dataset, folder: Path, conditions: np.ndarray
) -> None:
    made = tdcr.distill(run.predictor, dataset, folder / "student", evaluations=2, steps=4, seed=2)
    flags = ["--model", run.model, "--data", dataset.path, "--evaluations", 2, "--steps", 4, "--seed", 2]
    command_line("distill", *flags, "--out", folder / "student-by-command")
    assert made.model.read_bytes() == (folder / "student-by-command/model.safetensors").read_bytes()
    assert list(made.predictor.clouds(conditions, 20).evaluations) == [2, 2]
    with pytest.raises(InputError, match="the network was distilled for 2 evaluations by its own sampler"):
        made.predictor.predict(conditions, 20, sampler_steps=3)


def test_a_comparison_is_that_of_the_command_line(dataset: tdcr.Dataset, folder: Path) -> None:
    pages = [folder / "compared-by-command.html", folder / "compared.html"]
    flags = ["--robot", "2m", "--split", "test", "--emd-points", 100, "--seed", 3, "--worst", 1]
    expected = command_line("compare", dataset.path, *flags, "--report", pages[0])
    done: list[int] = []
    simulator: dict[str, Any] = {"robot": "2m", "split": "test", "emd_points": 100, "seed": 3, "worst": 1}
    assert tdcr.compare(dataset, report=pages[1], progress=done.append, **simulator) == expected
    assert sum(done) == expected["pairs"] == 2
    assert pages[0].read_bytes() == pages[1].read_bytes()
    itself = tdcr.compare(dataset, dataset.path, match="index", points=400, emd_points=50)
    assert itself["pairs"] == 20 and itself["cd"]["mean"] == itself["tip"]["mean"] == 0.0
    for match, b, arguments in [
        ("robot and base are of the simulator; two data sets are compared", dataset, {"robot": "2m"}),
        ("tolerance is 2.0; expected 0 to 1", dataset, {"tolerance": 2.0}),
        ('match is "name"; expected one of "condition", "index"', dataset, {"match": "name"}),
        ("^points is 401; expected 1 to 400", dataset, {"points": 401}),
        ("^emd_points is 401; expected 1 to 400", dataset, {"emd_points": 401}),
        ("report is .*expected a name that ends in .html", dataset, {"report": folder / "page.pdf"}),
    ]:
        with pytest.raises(InputError, match=match):
            tdcr.compare(dataset, b, **arguments)  # type: ignore[arg-type]


def test_the_demo_is_that_of_the_command_line(folder: Path) -> None:
    options = {"samples": 10, "steps": 6, "seed": 1, "precision": "float32"}
    out, by_command = folder / "demo", folder / "demo-by-command"
    done: list[int] = []

    def stop(count: int) -> None:
        done.append(count)
        if sum(done) > 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tdcr.demo(out, progress=stop, **options)  # type: ignore[arg-type]
    again: list[int] = []
    found = tdcr.demo(out, progress=again.append, **options)  # type: ignore[arg-type]
    # Of a data set that is there nothing is told; of steps that were taken, it is.
    assert sum(again) <= 6 + 1 and sum(done) in range(11, 18)
    flags = ["--samples", 10, "--steps", 6, "--seed", 1, "--precision", "float32"]
    expected = command_line("demo", *flags, "--out", by_command)
    assert json.loads((out / "metrics.json").read_bytes()) == found
    for times in ("seconds", "stages"):
        del found[times], expected[times]
    assert found == expected
    assert (out / "shapes.png").read_bytes() == (by_command / "shapes.png").read_bytes()
    assert (out / "report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    with pytest.raises(DataError, match="holds 10 samples, and 11 are asked for; ask for samples=10"):
        tdcr.demo(out, samples=11, steps=6)


def test_arguments_that_make_no_run_are_named(dataset: tdcr.Dataset, run: tdcr.Run, folder: Path) -> None:
    def refused(error: type[TdcrError], match: str, **arguments: Any) -> None:
        with pytest.raises(error, match=match):
            tdcr.train(**{"data": dataset, "out": folder / "never", "steps": 20, **TINY, **arguments})

    refused(InputError, 'net is "cnn"; expected one of "mlp", "hybrid"', net="cnn")
    refused(InputError, "channels is of the net 'hybrid'", channels=(8, 8, 8))
    refused(InputError, "channels has 2 values; expected 3", net="hybrid", channels=(8, 8))
    refused(InputError, "color_weight is of a network with colors=True", color_weight=0.1)
    refused(InputError, 'preset is "slow"; expected one of "quick", "laptop", "paper"', preset="slow")
    refused(InputError, "the coupling is `any`, expected independent", coupling="any")
    refused(InputError, "width is 2.5; expected a whole number", width=2.5)
    refused(TrainError, "steps", steps=0)
    refused(TrainError, "width", width=0)
    refused(TrainError, "learning_rate", learning_rate=-1.0)
    refused(TrainError, "there is no model .*nowhere", init=folder / "nowhere")
    refused(TrainError, "shape", init=run.model, width=32)
    refused(DataError, "there is no data set in", data=folder / "nowhere")
    refused(InputError, "data is of a run on a data set; this one is on a stream", stream="2m")
    refused(InputError, "preset paper takes 500 epochs", data=None, stream="2m", preset="paper", steps=None)
    refused(TrainError, "cannot be resumed", out=run.folder)
    assert not (folder / "never/model.safetensors").exists()
    broken = folder / "broken.safetensors"
    broken.write_bytes(run.model.read_bytes()[:-9])
    with pytest.raises(TrainError, match="broken.safetensors"):
        tdcr.Predictor(broken)
    with pytest.raises(TrainError, match="there is no model"):
        tdcr.Predictor(folder / "nowhere")
