"""The benchmarks are not run with the tests: that what they import is still there, is looked up in the sources."""

import ast
from functools import cache
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PACKAGES = ("station", "drivers", "procedures", "simulators")


@cache
def names_in(module: str) -> set[str]:
    """Everything that a module binds, wherever in it; of a package also what lies in its folder."""
    folder = ROOT.joinpath(*module.split("."))
    texts = folder / "__init__.pyi", folder / "__init__.py", folder.with_suffix(".py")
    tree = ast.parse(next(path for path in texts if path.is_file()).read_text(encoding="utf-8"))
    found = {path.stem for path in folder.iterdir()} if folder.is_dir() else set()
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.Name(id=name, ctx=ast.Store()):
                found.add(name)
            case ast.ImportFrom(names=names):
                found |= {one.asname or one.name for one in names}
    return found


@pytest.mark.parametrize("script", sorted(HERE.glob("*.py")), ids=lambda path: path.stem)
def test_what_it_imports_is_there(script):
    wanted = [
        (node.module, one.name)
        for node in ast.walk(ast.parse(script.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in PACKAGES
        for one in node.names
    ]
    assert [f"{module}.{name}" for module, name in wanted if name not in names_in(module)] == []
