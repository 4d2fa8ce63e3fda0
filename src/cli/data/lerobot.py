"""What `tdcr data export --format lerobot` runs: the Python package, with what is asked for on standard input."""

import json
import sys

# Python looks for modules in the working directory first, where a folder may be called `tdcr`.
if sys.path[0] == "":
    del sys.path[0]
request = json.load(sys.stdin)
wanted = f"the Python package tdcr {request['version']} and LeRobot"
way = f"{sys.executable} -m pip install 'tdcr[lerobot]', or name another interpreter by the variable TDCR_PYTHON"
try:
    from tdcr import __version__
    from tdcr._lerobot_command import run
except ImportError as error:
    sys.exit(f"error: --format lerobot needs {wanted}, which {sys.executable} cannot import ({error}); {way}")
if __version__ != request["version"]:
    sys.exit(f"error: --format lerobot needs {wanted}; {sys.executable} has tdcr {__version__}; {way}")
sys.exit(run(request))
