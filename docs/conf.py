"""Builds the site: `python -m sphinx -W -b html docs target/site`. Nothing is downloaded, and no Rust is compiled."""

import __future__

import importlib.util
import sys
import types
from pathlib import Path

import numpy.typing
from sphinx.util.nodes import make_refnode

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "python/tdcr"

project = "tdcr"
author = "the authors of tdcr"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
# Pages of modules whose optional packages are not installed are left out.
OPTIONAL = {"torch": ["torch", "h5py", "safetensors"], "jax": ["jax"], "envs": ["gymnasium"], "figures": ["matplotlib"]}
missing = [page for page, packages in OPTIONAL.items() if not all(importlib.util.find_spec(name) for name in packages)]
exclude_patterns = [f"python/{page}.*" for page in missing]
suppress_warnings = ["toc.excluded"]
# Text between single backticks in docstrings.
default_role = "literal"
html_theme = "alabaster"
html_theme_options = {
    "description": "Tendon-driven continuum robots: simulate, see, learn, predict, evaluate",
    "fixed_sidebar": True,
    "page_width": "1080px",
}
html_sidebars = {"**": ["about.html", "searchfield.html", "navigation.html"]}
html_copy_source = False
html_show_copyright = False

# Headings have the anchors that GitHub gives them.
myst_heading_anchors = 4
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
napoleon_use_ivar = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False


def _native() -> types.ModuleType:
    """The native module, from its stub: what is documented does not depend on what was built."""
    stub = PACKAGE / "_tdcr.pyi"
    module = types.ModuleType("tdcr._tdcr")
    # Annotations are not evaluated, as classes name themselves in them.
    flags = __future__.annotations.compiler_flag
    exec(compile(stub.read_text(encoding="utf-8"), stub, "exec", flags), module.__dict__)
    module.__version__ = ""
    return module


class _Array:
    """Stands for `NDArray`: shapes and types of numbers are in the text, where `ndarray[tuple[Any, ...], ...]` says less."""

    def __class_getitem__(cls, _: object) -> type:
        return numpy.ndarray


numpy.typing.NDArray = _Array
sys.path.insert(0, str(ROOT / "python"))
sys.modules["tdcr._tdcr"] = _native()


def _public(app, env, node, contnode):
    """Links a name of the module that defines it, as annotations have it, to the page of its public name."""
    parts = node.get("reftarget", "").split(".")
    if node.get("refdomain") != "py" or parts[0] != "tdcr":
        return None
    objects = env.get_domain("py").objects
    # `tdcr.robot.Robot` is `tdcr.Robot`, `tdcr.torch.model.Model.load` is `tdcr.torch.Model.load`.
    for start in range(1, len(parts)):
        for end in range(start + 1, len(parts)):
            name = ".".join([*parts[:start], *parts[end:]])
            if name in objects:
                found = objects[name]
                return make_refnode(app.builder, node["refdoc"], found.docname, found.node_id, contnode, name)
    return None


def _plain(app, what, name, obj, options, lines):
    """Keeps napoleon from taking what stands before a colon for a type: types are in the signatures."""
    if what in ("property", "attribute", "data"):
        lines.insert(0, "")
    for index, line in enumerate(lines[:-1]):
        if line.strip() == "Returns:":
            text = lines[index + 1].lstrip()
            lines[index + 1] = lines[index + 1].replace(text, f": {text}")


def setup(app):
    """Registers what is above."""
    app.connect("autodoc-process-docstring", _plain, priority=400)
    app.connect("missing-reference", _public)
