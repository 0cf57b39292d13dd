"""Text from outside, made safe for a terminal: nothing in it moves or hides anything.

Names in files, words of a service, a cabinet's events: each may hold escape sequences,
line breaks that forge a line of our own, or marks that turn the order of letters round.
"""


def printable(text: str, keep: str = "") -> str:
    r"""Return text with every character that cannot be seen written as an escape.

    Args:
        text: Anything.
        keep: Characters that stay as they are, such as "\n" in a text of several lines.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else repr(c)[1:-1] for c in text)
