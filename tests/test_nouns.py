"""The nouns keep their shape: short constructors, and no word of one task elsewhere."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "src" / "dovetail"
PARAMETERS_MAX = 8
SUFFIXES = {".py", ".toml", ".cpp", ".hpp", ".proto"}


def classes():
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                yield f"{path.relative_to(PACKAGE)}: {node.name}", node


def parameters(class_):
    """Names that a class is made with; None where a base class says it."""
    made_by = [ast.unparse(decorator) for decorator in class_.decorator_list]
    for node in class_.body:
        if isinstance(node, ast.FunctionDef) and node.name == "__init__":
            a = node.args
            more = [a.vararg, a.kwarg]
            every = [*a.posonlyargs, *a.args, *a.kwonlyargs, *filter(None, more)]
            return [arg.arg for arg in every][1:]
    if any("dataclass" in words and "frozen=True" not in words for words in made_by):
        fields = [node for node in class_.body if isinstance(node, ast.AnnAssign)]
        return [ast.unparse(field.target) for field in fields]
    return None


def test_public_classes_are_made_with_at_most_8_parameters():
    """Frozen dataclasses apart: theirs are a file's keys or a record's columns.

    A dataclass that is not frozen counts as any other class.
    """
    made = {name: parameters(node) for name, node in classes()}
    assert len([given for given in made.values() if given is not None]) > 50
    long = {
        name: given
        for name, given in made.items()
        if given is not None and len(given) > PARAMETERS_MAX
    }
    assert not long


def bases(class_):
    return {ast.unparse(base) for base in class_.bases}


def settings(class_, known):
    """Names of a dataclass's fields, what it inherits too; none are a named tuple's."""
    given = []
    for base in sorted(bases(class_)):
        given += settings(known[base], known) if base in known else []
    fields = [node for node in class_.body if isinstance(node, ast.AnnAssign)]
    own = [f for f in fields if "ClassVar" not in ast.unparse(f.annotation)]
    return list(dict.fromkeys(given + [ast.unparse(f.target) for f in own]))


def test_what_has_sections_has_at_most_8_settings_in_each():
    """Frozen or not, in all of a training and its environment."""
    made = dict(classes())
    known = {name.rpartition(" ")[2]: node for name, node in made.items()}
    rooms = ("learn/", "envs/")
    given = {n: settings(made[n], known) for n in made if n.startswith(rooms)}
    parts = {"Section", "Sectioned"}
    given |= {n: settings(made[n], known) for n in made if parts & bases(made[n])}
    assert len(given["learn/config.py: TrainConfig"]) == PARAMETERS_MAX
    assert len(given["evaluate/config.py: EvaluationConfig"]) == 5
    assert {n: names for n, names in given.items() if len(names) > PARAMETERS_MAX} == {}


def words(text):
    """How often a text says what one task has; TypeGuard and whole do not count."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    return len(re.findall(r"(?i)(?<![a-z])(?:hole|peg)s?(?![a-z])", apart))


def test_no_room_says_hole_or_peg_but_the_task_that_has_them():
    own = [PACKAGE / name for name in ("tasks/peg_in_hole", "policies", "reproduce")]
    left = {}
    for folder in (PACKAGE, ROOT / "cpp", ROOT / "proto"):
        for path in sorted(folder.rglob("*")):
            if path.suffix in SUFFIXES and not any(map(path.is_relative_to, own)):
                left[str(path.relative_to(ROOT))] = words(path.read_text())
    assert len(left) > 200
    assert {name: count for name, count in left.items() if count} == {}
