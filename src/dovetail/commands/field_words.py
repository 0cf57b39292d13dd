"""First sentences of the docstrings under a dataclass's fields."""

import ast
import inspect
import textwrap
from collections.abc import Mapping
from functools import cache


@cache
def field_words(kind: type) -> Mapping[str, str]:
    """Return the first sentence of the string under each field, inherited ones too."""
    found = {}
    for base in reversed(kind.__mro__[:-1]):
        try:
            source = inspect.getsource(base)
        except (OSError, TypeError):  # made by a program or typed in: it has no words
            continue
        body = ast.parse(textwrap.dedent(source)).body[0]
        assert isinstance(body, ast.ClassDef)
        for field, text in zip(body.body, body.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
                name, words = ast.unparse(field.target), ast.literal_eval(text.value)
                found[name] = " ".join(words.split()).partition(". ")[0].rstrip(".")
    return found
