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


def bases(class_):
    return {ast.unparse(base) for base in class_.bases}


def is_record(class_):
    """Whether its fields are what it is made with."""
    made_by = [ast.unparse(decorator) for decorator in class_.decorator_list]
    return "NamedTuple" in bases(class_) or any("dataclass" in m for m in made_by)


def fields(class_, known):
    """Names of a record's fields, what it inherits too."""
    given = []
    for base in sorted(bases(class_)):
        given += fields(known[base], known) if base in known else []
    for node in class_.body:
        if isinstance(node, ast.AnnAssign) and "init=False" not in ast.unparse(node):
            is_own = "ClassVar" not in ast.unparse(node.annotation)
            given += [ast.unparse(node.target)] if is_own else []
    return list(dict.fromkeys(given))


def parameters(class_, known):
    """Names that a class is made with; None where a base class says it."""
    for node in class_.body:
        if isinstance(node, ast.FunctionDef) and node.name == "__init__":
            a = node.args
            more = [a.vararg, a.kwarg]
            every = [*a.posonlyargs, *a.args, *a.kwonlyargs, *filter(None, more)]
            return [arg.arg for arg in every][1:]
    return fields(class_, known) if is_record(class_) else None


def test_public_classes_are_made_with_at_most_8_parameters():
    """Settings and records too: what is more has sections."""
    every = dict(classes())
    known = {name.rpartition(" ")[2]: node for name, node in every.items()}
    made = {name: parameters(node, known) for name, node in every.items()}
    assert len([given for given in made.values() if given is not None]) > 300
    assert len(made["learn/config.py: TrainConfig"]) == PARAMETERS_MAX
    assert len(made["evaluate/config.py: EvaluationConfig"]) == 6
    long = {n: given for n, given in made.items() if len(given or ()) > PARAMETERS_MAX}
    assert long == {}


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
