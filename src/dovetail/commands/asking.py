"""Ask a person before a real arm is moved."""

from dovetail.errors import ConfigError


def ask(question: str) -> bool:
    """Ask at the terminal; an empty answer goes on, anything else ends.

    Raises:
        ConfigError: The input has ended, so that no answer can come.
    """
    try:
        return input(f"{question}. Enter goes on, n ends: ").strip() == ""
    except EOFError as error:
        raise ConfigError(
            "nobody answers: run this in a terminal, or with --yes"
        ) from error
