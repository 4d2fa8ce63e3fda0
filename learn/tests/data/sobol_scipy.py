"""Writes sobol_scipy.json: points of SciPy's unscrambled Sobol sequence in 64 dimensions."""

import json
import pathlib

from scipy.stats import qmc

INDEX = [1, 2, 3, 5, 100, 1023, 1024, 4095]


def fixture():
    points = qmc.Sobol(64, scramble=False, bits=32).random(4096)
    return {"index": INDEX, "points": points[INDEX].tolist()}


if __name__ == "__main__":
    path = pathlib.Path(__file__).with_suffix(".json")
    path.write_text(json.dumps(fixture()))
