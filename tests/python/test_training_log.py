"""The log of a training run as other programs read it."""

import csv
import math
import struct

import pytest


def table(polynomial):
    def entry(value):
        for _ in range(8):
            value = value >> 1 ^ (polynomial if value & 1 else 0)
        return value

    return [entry(value) for value in range(256)]


CASTAGNOLI = table(0x82F63B78)


def masked_checksum(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc = crc >> 8 ^ CASTAGNOLI[(crc ^ byte) & 0xFF]
    crc ^= 0xFFFFFFFF
    return ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF


def records(data):
    """The records of a TFRecord file."""
    while data:
        (length,) = struct.unpack("<Q", data[:8])
        content = data[12 : 12 + length]
        sums = struct.unpack("<I", data[8:12]) + struct.unpack("<I", data[12 + length : 16 + length])
        assert sums == (masked_checksum(data[:8]), masked_checksum(content))
        yield content
        data = data[16 + length :]


def fields(message):
    """Number and value of the fields of a protocol buffer."""

    def varint():
        nonlocal message
        value, place = 0, 0
        while True:
            byte, message = message[0], message[1:]
            value |= (byte & 0x7F) << place
            place += 7
            if byte < 0x80:
                return value

    while message:
        key = varint()
        if key & 7 == 0:
            yield key >> 3, varint()
            continue
        size = {1: 8, 5: 4}.get(key & 7) or varint()
        value, message = message[:size], message[size:]
        assert len(value) == size
        yield (
            key >> 3,
            {1: lambda b: struct.unpack("<d", b)[0], 5: lambda b: struct.unpack("<f", b)[0]}.get(key & 7, lambda b: b)(value),
        )


@pytest.fixture
def run_folder(tdcr, tmp_path):
    tdcr("collect", "--samples", 20, "--points", 400, "--out", tmp_path / "data")
    size = ["--width", 16, "--depth", 2, "--embedding", 16, "--steps", 240, "--validate-every", 64]
    tdcr("train", "--data", tmp_path / "data", "--out", tmp_path / "run", *size)
    return tmp_path / "run"


def rows(run_folder):
    with (run_folder / "log.csv").open() as file:
        return [{k: float(v) if v else None for k, v in row.items()} for row in csv.DictReader(file)]


def test_the_event_file_says_what_the_csv_says(run_folder):
    data = (run_folder / "events.out.tfevents.tdcr").read_bytes()
    first, *events = [dict(fields(record)) for record in records(data)]
    assert first[3] == b"brain.Event:2"
    table = rows(run_folder)
    assert [row["step"] for row in table] == [event[2] for event in events]
    assert [row["step"] for row in table if row["validation_cd"]] == [64, 128, 192, 240]
    times = [event[1] for event in events]
    assert times == sorted(times) and times[0] > 1.7e9
    for row, event in zip(table, events):
        summary = [dict(fields(value)) for number, value in fields(event[5]) if number == 1]
        scalars = {value[1].decode(): value[2] for value in summary}
        del row["step"]
        expected = {tag: scalar for tag, scalar in row.items() if scalar is not None}
        assert scalars.keys() == expected.keys()
        assert all(math.isclose(scalars[tag], expected[tag], rel_tol=1e-6) for tag in expected)


def test_tensorboard_reads_the_event_file(run_folder):
    reader = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    events = reader.EventAccumulator(str(run_folder)).Reload()
    table = rows(run_folder)
    assert set(events.Tags()["scalars"]) == set(table[0]) - {"step"}
    for tag in events.Tags()["scalars"]:
        read = [(event.step, event.value) for event in events.Scalars(tag)]
        written = [(row["step"], row[tag]) for row in table if row[tag] is not None]
        assert [step for step, _ in read] == [step for step, _ in written]
        assert all(math.isclose(a[1], b[1], rel_tol=1e-6) for a, b in zip(read, written))
