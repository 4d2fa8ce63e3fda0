"""Our control tables, entry by entry, are those that the manufacturer's SDK ships."""

import csv
import importlib.resources
import pathlib

import pytest

OURS = pathlib.Path(__file__).parents[2] / "hw/src/dynamixel/tables"
THEIRS = importlib.resources.files("dynamixel_easy_sdk") / "control_table"

MODELS = ["xl330-m288", "xc330-m288", "xc330-t288"]
LAYOUTS = [("..52", "_fw52"), ("53..", "")]
SIZES = {"u8": 1, "i8": 1, "u16": 2, "i16": 2, "u32": 4, "i32": 4}
# The e-Manual has them, the SDK's tables do not.
OURS_ALONE = {"Startup Configuration", "Backup Ready"}
# The SDK's own choice of a part of the indirect items: the first byte of each part, counted from 0.
PARTS = {"Write": 0, "Read": 6}


def sections(text):
    """The rows of each section of a .model file, without its line of headings."""
    found = {}
    for line in text.splitlines():
        if line.startswith("["):
            rows = found.setdefault(line.strip("[]"), [])
        elif line.strip():
            rows.append(line.split("\t"))
    return {name: rows[1:] for name, rows in found.items()}


def ours(model, firmware):
    with (OURS / f"{model}.csv").open(newline="") as file:
        return {row["name"]: row for row in csv.DictReader(file) if row["firmware"] in ("", firmware)}


def theirs(model, suffix):
    return sections((THEIRS / f"{model.replace('-', '_')}{suffix}.model").read_text())


@pytest.mark.parametrize(("firmware", "suffix"), LAYOUTS)
@pytest.mark.parametrize("model", MODELS)
def test_addresses_and_sizes_are_the_sdks(model, firmware, suffix):
    expected = {name: (int(address), int(size)) for address, size, name in theirs(model, suffix)["control table"]}
    found = {}
    for name, row in ours(model, firmware).items():
        address, size = int(row["address"]), SIZES[row["type"]]
        if name.startswith("Indirect"):
            found[f"{name} 1"] = (address, size)
            for part, first in PARTS.items():
                found[f"{name} {part}"] = (address + first * size, size)
        elif name not in OURS_ALONE:
            found[name] = (address, size)
    assert found == expected


@pytest.mark.parametrize(("firmware", "suffix"), LAYOUTS)
@pytest.mark.parametrize("model", MODELS)
def test_signs_and_the_unit_of_velocity_are_the_sdks(model, firmware, suffix):
    rows = ours(model, firmware)
    units = theirs(model, suffix)["unit info"]
    assert {name for name, *_ in units} == {
        "Present Velocity",
        "Goal Velocity",
        "Present Current",
        "Goal Current",
    }
    for name, value, unit, sign in units:
        assert rows[name]["type"].startswith("i") == (sign == "signed")
        # For currents the SDK gives raw counts or a torque.
        if unit == "rad/s":
            assert (float(rows[name]["scale"]), rows[name]["unit"]) == (float(value), unit)


@pytest.mark.parametrize("model", MODELS)
def test_model_numbers_are_the_sdks(model):
    lines = (THEIRS / "dynamixel.model").read_text().splitlines()[1:]
    numbers = dict(line.split("\t")[::-1] for line in lines if line.strip())
    assert ours(model, "")["Model Number"]["initial"] == numbers[f"{model.replace('-', '_')}.model"]
