"""Which modules of the package import which: in one direction only."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[3] / "python/tdcr"


def names(tree: ast.AST) -> Iterator[str]:
    """Names of all modules that code imports, within functions too, and of what it imports from them as if they were modules.

    What only type checkers read is left out.
    """
    for node in ast.iter_child_nodes(tree):
        match node:
            case ast.If(test=ast.Name("TYPE_CHECKING"), orelse=others):
                yield from names(ast.Module(others, []))
            case ast.Import(names=modules):
                yield from (alias.name for alias in modules)
            case ast.ImportFrom(module=module, names=members, level=0):
                yield from (f"{module}.{alias.name}" for alias in members)
            case ast.ImportFrom():
                raise AssertionError(f"line {node.lineno} imports relative to its package; expected the whole name")
            case _:
                yield from names(node)


def imports(package: Path) -> dict[str, set[str]]:
    """The modules of a package, each with those of it that it imports."""
    files = {}
    for file in package.rglob("*.py"):
        parts = file.relative_to(package.parent).with_suffix("").parts
        files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file

    def module(name: str) -> str:
        # `a.b.C` is of the module `a.b`, unless it is one itself.
        return name if name in files else name.rpartition(".")[0]

    # The package itself is imported before any of its modules, so what stands in no file is no import of it.
    native = f"{package.name}._{package.name}"
    found = {}
    for name, file in files.items():
        others = {module(other) for other in names(ast.parse(file.read_text())) if not other.startswith(native)}
        found[name] = others & files.keys() - {name}
    return found


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Modules each of which imports the next, and the last the first; none where there is no such circle."""
    left = {name: set(others) for name, others in graph.items()}
    while done := [name for name, others in left.items() if not others]:
        for name in done:
            del left[name]
        for others in left.values():
            others.difference_update(done)
    if not left:
        return []
    way = [min(left)]
    while (after := min(left[way[-1]])) not in way:
        way.append(after)
    return way[way.index(after) :]


def test_no_module_imports_itself_through_others() -> None:
    graph = imports(PACKAGE)
    assert "tdcr.robot" in graph["tdcr.statics"] and "tdcr.robot" in graph["tdcr"]
    assert "tdcr._torch_data" in graph["tdcr.data"]  # Within a function.
    assert circle(graph) == []


@pytest.mark.parametrize(
    "import_",
    [
        "def f():\n    from toy import a\n",
        "import toy.a",
        "class C:\n    def f(self):\n        import toy.a as other",
        "from toy.a import A",
        "from toy import A",
    ],
)
def test_circles_are_found_wherever_the_import_stands(tmp_path: Path, import_: str) -> None:
    folder = tmp_path / "toy"
    (folder / "deep").mkdir(parents=True)
    (folder / "__init__.py").write_text("from toy.a import A\nfrom toy import _toy\n")
    (folder / "a.py").write_text("from toy import _toy\nfrom toy.deep.b import B\nA = B\n")
    (folder / "deep/__init__.py").write_text("")
    beneath = folder / "deep/b.py"
    for harmless in ("", "if TYPE_CHECKING:\n    from toy.a import A\n"):
        beneath.write_text(f"B = 1\n{harmless}")
        assert circle(imports(folder)) == []
    beneath.write_text(f"B = 1\n{import_}")
    found = circle(imports(folder))
    assert {"toy.a", "toy.deep.b"} <= set(found), found
