"""The secret that a service on this machine and its learners share."""

import os
import re
import secrets

from dovetail.errors import ConfigError

TOKEN = "DOVETAIL_TOKEN"
"""Environment variable: the token of a service, for it and for its learners."""
TOKEN_LENGTH = 16
"""Fewest characters of a token."""
AUTHORIZATION = "authorization"
"""Key of a call's metadata under which the token is sent."""


def make_token() -> str:
    """Return the token of a new service: the environment's, or a random one.

    Raises:
        ConfigError: The environment's can be guessed, or does not fit into an address.
    """
    token = os.environ.get(TOKEN) or secrets.token_urlsafe(TOKEN_LENGTH)
    if len(token) < TOKEN_LENGTH or not re.fullmatch(r"[\w-]+", token, re.ASCII):
        raise ConfigError(
            f"{TOKEN} has {len(token)} characters; give {TOKEN_LENGTH} or more, only "
            "letters, digits, - and _, or leave it out: then a random one is printed"
        )
    return token


def bearer(token: str) -> str:
    """Return what is sent for a token."""
    return f"Bearer {token}"
