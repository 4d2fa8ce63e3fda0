#!/usr/bin/env python3
"""Prints what REALSENSE_LIBRARY must be for the librealsense inside the PyPI wheel `pyrealsense2` of this Python.

That library is an extension module: it needs libpython, which is named first. Says on stderr what is missing, if anything.
"""

import ctypes
import importlib.util
import os
import sys
import sysconfig
from pathlib import Path


def librealsense() -> Path | None:
    """The extension module, without importing it."""
    package = importlib.util.find_spec("pyrealsense2")
    for folder in package.submodule_search_locations or [] if package else []:
        for module in Path(folder).glob("pyrealsense2*.so"):
            return module
    return None


def libpython() -> str | None:
    """This Python's shared library: its path, or the name under which the system knows it."""
    name = str(sysconfig.get_config_var("INSTSONAME") or "")
    if ".so" not in name:
        # Of a Python that is one file: the system may have the library beside it.
        name = f"libpython{sysconfig.get_python_version()}.so.1.0"
    path = Path(str(sysconfig.get_config_var("LIBDIR"))) / name
    if path.is_file():
        return str(path)
    try:
        ctypes.CDLL(name)
    except OSError:
        return None
    return name


def main() -> int:
    module, python = librealsense(), libpython()
    if module is None:
        print("realsense_library: no pyrealsense2 here; pip install pyrealsense2", file=sys.stderr)
        return 1
    if python is None:
        version = sysconfig.get_python_version()
        print(f"realsense_library: no libpython{version}.so; apt-get install libpython{version}", file=sys.stderr)
        return 1
    print(os.pathsep.join([python, str(module)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
