"""The house's own rules: imports one way, names that say something."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "src" / "dovetail"
FOLDERS = ("src", "cpp", "tests", "examples", "benchmarks", "docs", "typings")
EMPTY_NAMES = {"utils", "util", "common", "helper", "helpers", "manager", "misc"}

LAYERS = (
    {
        "types",
        "poses",
        "archives",
        "distribution",
        "errors",
        "files",
        "interrupt",
        "mujoco_gl",
        "options",
        "settings",
        "reading",
        "page",
        "printable",
        "durations",
        "robots",
        "plugins",
        "zoomable",
    },
    {"workcell"},
    {"control", "plants"},
    {"arms", "cabinet", "episode", "gripper", "rpc"},
    {"meshes", "perceive", "tasks", "trackers", "view"},
    {"envs", "search"},
    {"learn", "evaluation"},
    {"doctor"},
    {"identify"},
    {"cockpit", "reproduce"},
    {"commands"},
    {"cli", "__main__"},
)
"""Modules and folders of the package; each imports from its own layer or from above."""


def sources(*suffixes):
    return sorted(
        path
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*")
        if path.suffix in suffixes
        and path.name not in ("_core.pyi", "_bench.pyi")
        and not path.stem.endswith("_pb2")  # generated
    )


def layer_of(name):
    for index, names in enumerate(LAYERS):
        if name in names:
            return index
    return None


MODULE = re.compile(r"dovetail\.(\w+)(\.\w+)*(:\w+)?")
"""A string that names a module, as `import_module` and gymnasium's entry points do."""
LOGGERS = {"dovetail.rpc", "dovetail.cockpit"}


def imports(path):
    """Yield the first part below dovetail of each import, TYPE_CHECKING left out.

    Strings that name a module count: a cycle of imports can hide there.
    """
    tree = ast.parse(path.read_text())
    skipped = {
        node
        for branch in ast.walk(tree)
        if isinstance(branch, ast.If) and "TYPE_CHECKING" in ast.dump(branch.test)
        for statement in branch.body
        for node in ast.walk(statement)
    }
    for node in ast.walk(tree):
        for name in () if node in skipped else named_modules(node):
            match = MODULE.fullmatch(name)
            if match and name not in LOGGERS:
                yield match[1]


def named_modules(node):
    """Return the modules that a node of the syntax imports, or names in a string."""
    if isinstance(node, ast.ImportFrom) and node.module == "dovetail":
        return [f"dovetail.{alias.name}" for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        return [node.module or ""]
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return [node.value]
    return []


def test_functions_have_at_most_60_lines_of_code():
    """Docstrings are not counted."""
    long = []
    for path in sources(".py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                body = node.body
                start = node.lineno
                if ast.get_docstring(node) and len(body) > 1:
                    start = body[1].lineno
                if (node.end_lineno or start) - start + 1 > 60:
                    long.append(f"{path.relative_to(ROOT)}: {node.name}")
    assert not long


def test_imports_point_one_way():
    wrong = []
    for path in sorted(PACKAGE.rglob("*.py")):
        own = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if own == "__init__":  # the face imports from every layer
            continue
        for name in sorted({own, *imports(path)} - {"_core", "_bench"}):
            index = layer_of(name)
            if index is None:
                wrong.append(f"{name} has no layer: add it to LAYERS")
            elif index > (layer_of(own) or 0):
                wrong.append(f"{path.relative_to(PACKAGE)} must not import {name}")
    assert not wrong


def test_no_file_has_an_empty_name():
    names = {path: path.stem.lower() for path in sources(".py", ".cpp", ".hpp")}
    empty = [
        str(path.relative_to(ROOT))
        for path, name in names.items()
        if EMPTY_NAMES & set(name.split("_"))
    ]
    assert not empty


def test_no_open_ends_are_left_in_the_code():
    words = re.compile("TO" + "DO|FIX" + "ME|X" + "XX|NotImplemented" + "Error")
    left = [
        f"{path.relative_to(ROOT)}:{number}"
        for path in sources(".py", ".cpp", ".hpp")
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if words.search(line)
    ]
    assert not left


def test_the_core_knows_nothing_of_python():
    for path in [*ROOT.glob("cpp/src/*"), *ROOT.glob("cpp/include/dovetail/*")]:
        text = path.read_text()
        assert "nanobind" not in text, path
        assert "Python.h" not in text, path


def test_nothing_loads_pickles():
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text()
        assert not re.search(r"^\s*(import|from) (pickle|cloudpickle)", text, re.M), (
            path
        )
        assert "allow_pickle=True" not in text, path
