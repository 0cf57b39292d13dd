"""Reads the data in a pickle, and runs nothing of it.

Unpickling a file calls whatever the file names: it may delete a home folder. Here each
name becomes an inert record that keeps what it would have been called with, so that the
numbers in a file can be found without trusting who wrote it.
"""

import io
import pickle
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from dovetail.errors import PolicyError

_FLOATS = ("f2", "f4", "f8")


class Inert:
    """What a pickle would have built: the name that it calls, and with what."""

    origin = ""
    """Module and name, such as numpy.ndarray."""

    def __new__(cls, *args: Any, **named: Any) -> "Inert":
        """Keep the arguments; nothing is called."""
        made = super().__new__(cls)
        made.args, made.named = args, named
        made.state, made.items = None, {}
        return made

    args: tuple[Any, ...]
    named: dict[str, Any]
    state: Any
    """What `__setstate__` would have got."""
    items: dict[Any, Any]
    """What it would have been filled with, as a mapping."""

    def __setstate__(self, state: Any) -> None:
        """Keep the state."""
        self.state = state

    def __setitem__(self, name: Any, value: Any) -> None:
        """Keep an entry."""
        self.items[name] = value

    def append(self, value: Any) -> None:
        """Keep an element."""
        self.items[len(self.items)] = value

    def extend(self, values: Any) -> None:
        """Keep elements."""
        for value in values:
            self.append(value)

    def add(self, value: Any) -> None:
        """Keep an element of a set."""
        self.append(value)

    def __call__(self, *args: Any, **named: Any) -> "Inert":
        """Keep the arguments of a call on what is inert itself."""
        return Inert(self, *args, **named)


class _Reader(pickle._Unpickler):
    """In Python, as the one in C reserves whatever memory a damaged length asks for."""

    def find_class(self, module: str, name: str) -> type[Inert]:
        """Return a record in place of what the name means."""
        return type("Named", (Inert,), {"origin": f"{module}.{name}"})

    def persistent_load(self, pid: Any) -> Inert:
        """Keep what would have been looked up elsewhere."""
        return Inert(pid)


def read_inert(content: bytes) -> Any:
    """Return a pickle's data, whatever is not plain data as `Inert`.

    Raises:
        PolicyError: The bytes are no pickle, or one of a kind that needs running.
    """
    limit = sys.getrecursionlimit()
    try:
        return _Reader(io.BytesIO(content)).load()
    except RecursionError as error:
        raise PolicyError(f"a pickle is nested deeper than {limit}") from error
    except Exception as error:
        # Whatever damaged or hostile bytes raise here, they are no policy.
        raise PolicyError(
            f"a pickle cannot be read without running it: {error}"
        ) from error


def attributes(record: Any) -> Mapping[str, Any]:
    """Return what an object would have had as attributes, or a mapping as entries."""
    if isinstance(record, Mapping):
        return record
    if not isinstance(record, Inert):
        return {}
    found: dict[str, Any] = {}
    states = record.state if isinstance(record.state, tuple) else (record.state,)
    for state in (*states, record.items):
        if isinstance(state, Mapping):
            found |= state
    return found


def find_array(record: Any) -> np.ndarray[Any, Any] | None:
    """Return the array of floats that a record of NumPy or JAX stands for, if it does.

    Raises:
        PolicyError: An array whose size is not that of its bytes.
    """
    for state in _array_states(record):
        _, shape, kind, is_fortran, raw = state
        code = kind.args[0] if isinstance(kind, Inert) and kind.args else None
        order = kind.state[1] if isinstance(kind, Inert) and kind.state else None
        if code not in _FLOATS or order not in ("<", "=", "|"):
            continue
        try:
            flat = np.frombuffer(raw, dtype=f"<{code}")
            return flat.reshape(shape, order="F" if is_fortran else "C")
        except (TypeError, ValueError) as error:
            raise PolicyError(f"an array is damaged: {error}") from error
    return None


def _array_states(record: Any) -> Iterator[tuple[Any, ...]]:
    """Yield whatever looks like the state of a NumPy array: its `__setstate__` of 5."""
    if not isinstance(record, Inert):
        return
    if record.origin.endswith("._frombuffer") and len(record.args) == 4:
        raw, kind, shape, order = record.args
        yield None, shape, kind, order == "F", raw
    for state in (record.state, *record.args):
        if isinstance(state, tuple) and len(state) == 5:
            yield state
