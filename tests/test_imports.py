"""What keeps the files apart: no circle of imports, and nobody probes by name."""

import ast
import re
from importlib.util import resolve_name
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROBES = re.compile(r"\b(hasattr|getattr|cast)\(|type: ignore|pyright: ignore")
PROBES_MAX = 2
"""How many there are: the number only falls."""
FOREIGN = {
    "learn/foreign_actor.py",
    "learn/model_zip.py",
    "rpc/calls.py",
    "rpc/fields.py",
}
"""Files that read objects of other libraries, which have no common type."""


def modules(*folders):
    """The file of each module in these folders, by its dotted name."""
    found = {}
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            found[".".join(p for p in parts if p != "__init__")] = path
    return found


def names_in(node, package, known):
    """Names of the modules that one import statement of a package's file imports."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        module = resolve_name("." * node.level + (node.module or ""), package)
        for alias in node.names:
            whole = f"{module}.{alias.name}"
            if whole != "dovetail._core":  # of C++, which imports nothing
                yield whole if whole in known else module


def imported(tree, package, known):
    """Names of the modules that a file imports, in its functions and for types too."""
    for node in ast.iter_child_nodes(tree):
        yield from names_in(node, package, known)
        yield from imported(node, package, known)


def circles():
    """Sets of modules of which each imports the next."""
    known = modules("src", "benchmarks")
    graph = {}
    for name, path in known.items():
        package = name if path.stem == "__init__" else name.rpartition(".")[0]
        found = imported(ast.parse(path.read_text()), package, known)
        graph[name] = set(found) & known.keys() - {name}

    def reached(start):
        seen, left = set(), [start]
        while left:
            new = graph[left.pop()] - seen
            seen |= new
            left += new
        return seen

    ends = {name: reached(name) for name in graph}
    return {
        frozenset(other for other in ends[name] if name in ends[other])
        for name in graph
        if name in ends[name]
    }


def test_no_file_imports_itself_by_way_of_others_in_a_function_or_for_a_type():
    assert circles() == set()


def test_hardly_anybody_probes_an_object_by_name_or_silences_the_type_checker():
    lines = [
        (f"{path.relative_to(ROOT)}:{number}", line)
        for path in modules("src").values()
        if str(path.relative_to(ROOT / "src" / "dovetail")) not in FOREIGN
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if PROBES.search(line)
    ]
    assert len(lines) <= PROBES_MAX, lines
    assert [place for place, line in lines if "#" not in line] == [], "without a reason"
