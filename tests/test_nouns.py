"""The nouns keep their shape: constructors are short."""

import ast
from pathlib import Path

PACKAGE = Path(__file__).parent.parent / "src" / "dovetail"
PARAMETERS_MAX = 8


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
    """Frozen dataclasses apart: theirs are a file's or a command line's keys.

    Or a record's columns. A dataclass that is not frozen counts as any other class.
    """
    made = {name: parameters(node) for name, node in classes()}
    assert len([given for given in made.values() if given is not None]) > 50
    long = {
        name: given
        for name, given in made.items()
        if given is not None and len(given) > PARAMETERS_MAX
    }
    assert not long
