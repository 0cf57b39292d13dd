"""What two arms say of themselves, to be compared number by number."""


def state_numbers(state):
    """Every number of an arm's state by its name, those of the tool too."""
    numbers = state._asdict()
    return numbers | numbers.pop("tool")._asdict()
