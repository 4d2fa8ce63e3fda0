"""The fixture of the Sobol points is what SciPy gives."""

import json
import pathlib
import sys

DATA = pathlib.Path(__file__).parents[2] / "learn/tests/data"
sys.path.insert(0, str(DATA))

import sobol_scipy  # noqa: E402


def test_the_fixture_is_what_scipy_gives():
    assert json.loads((DATA / "sobol_scipy.json").read_text()) == sobol_scipy.fixture()
