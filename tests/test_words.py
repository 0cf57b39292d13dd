"""A docstring says what a thing is or does: it does not begin with a question word."""

import ast
import re
from pathlib import Path

SRC = Path(__file__).parents[1] / "src"
QUESTION = re.compile(
    r"(Who(ever|se)?|What(ever)?|Where|When|Which|Whether|Why|How)\b", re.IGNORECASE
)
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def docstrings(tree):
    """Yield the line and text of each docstring, those of fields included."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        for before, this in zip([None, *body], body, strict=False):
            is_first = before is None and isinstance(node, DOCUMENTED)
            is_of_field = isinstance(before, ast.Assign | ast.AnnAssign)
            if not (is_first or is_of_field) or not isinstance(this, ast.Expr):
                continue
            value = this.value
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                yield this.lineno, value.value


def test_no_docstring_begins_with_a_question_word():
    found = [
        f"{path.relative_to(SRC)}:{line}: {text.splitlines()[0]}"
        for path in sorted(SRC.rglob("*.py"))
        if not path.stem.endswith("_pb2")
        for line, text in docstrings(ast.parse(path.read_text()))
        if QUESTION.match(text)
    ]
    assert found == []


def test_the_rule_sees_each_kind_of_docstring():
    tree = ast.parse(
        '"""What it is."""\nclass A:\n    """Who."""\n    x: int\n    """How long."""\n'
        '    def f(self):\n        """Whether it is."""\n'
    )
    assert sum(bool(QUESTION.match(text)) for _, text in docstrings(tree)) == 4
