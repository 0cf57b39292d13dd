"""Facts of an error, for `pytest.raises(ConfigError, check=about("period"))`."""


def about(name, **facts):
    """Return a check that an error is about a setting, and has these facts too.

    Args:
        name: Setting, or element of one, that the error names.
        facts: Its `value`, `unit` or `allowed`.
    """

    def check(error):
        return error.name == name and all(
            getattr(error, fact) == value for fact, value in facts.items()
        )

    return check
