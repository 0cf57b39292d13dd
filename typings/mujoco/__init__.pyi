"""MuJoCo's package re-exports from binaries that type checkers cannot read."""

from typing import Any

def __getattr__(name: str) -> Any: ...
