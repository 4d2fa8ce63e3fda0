"""The wheel in an empty environment: README's quick start prints what it says."""

from __future__ import annotations

import re
import subprocess
import sys
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)


def test_readmes_quick_start_prints_what_it_says_in_an_empty_environment(tmp_path: Path) -> None:
    wheels = sorted((ROOT / "target/wheels").glob("tdcr-*-abi3-*.whl"))
    if not wheels:
        pytest.skip("no wheel in target/wheels: `make wheel` builds one")
    (wheel,) = wheels
    venv.create(tmp_path / "venv", with_pip=True)
    python = tmp_path / "venv/bin/python"
    install = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", wheel]
    subprocess.run(install, check=True, timeout=180.0)
    (code,) = blocks("python")
    (printed,) = blocks("text")
    script = tmp_path / "start.py"
    script.write_text(code)
    found = subprocess.run([python, script], check=True, capture_output=True, text=True, timeout=60.0, cwd=tmp_path)
    assert found.stdout == printed
    # The command line came with it.
    command = tmp_path / "venv/bin/tdcr"
    for front in ([command], [python, "-m", "tdcr"]):
        said = subprocess.run([*front, "--help"], check=True, capture_output=True, text=True, timeout=60.0, cwd=tmp_path).stdout
        assert "Usage: tdcr [OPTIONS] <COMMAND>" in said and "Robots in simulation:" in said
    # Optional packages are named where they are missing.
    for module, package in (("torch", "torch safetensors"), ("jax", "jax"), ("envs", "gymnasium"), ("plot", "matplotlib")):
        refused = subprocess.run([python, "-c", f"import tdcr.{module}"], capture_output=True, text=True, cwd=tmp_path)
        assert refused.returncode == 1
        assert refused.stderr.splitlines()[-1].startswith("tdcr.errors.MissingPackageError: ")
        assert refused.stderr.endswith(f"which is not installed: pip install {package}\n")


# Packages that the native module has nothing to do with: reading their types would take most of the time.
OTHERS = "[mypy-torch.*,jax.*,ray.*,gymnasium.*]\nfollow_imports = skip\nfollow_imports_for_stubs = true\n"


def test_the_stub_is_that_of_the_module(tmp_path: Path) -> None:
    config = tmp_path / "mypy.ini"
    config.write_text(f"[mypy]\n{OTHERS}")
    check = [sys.executable, "-m", "mypy.stubtest", "tdcr._tdcr", "--mypy-config-file", str(config)]
    done = subprocess.run(check, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
