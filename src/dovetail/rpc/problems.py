"""Errors across the wire: which exception, its words, and each wrong field."""

from collections.abc import Sequence
from typing import Any, NamedTuple, NoReturn

import grpc

from dovetail.errors import (
    ArmError,
    ConfigError,
    DovetailError,
    LimitError,
    LogError,
    MissingDependencyError,
    PlantError,
)
from dovetail.printable import printable
from dovetail.rpc import dovetail_pb2 as pb

METADATA_KEY = "dovetail-problem-bin"
"""Trailing metadata of a failed call: a serialized Problem."""

_KNOWN: dict[str, type[DovetailError]] = {
    kind.__name__: kind
    for kind in (
        ArmError,
        ConfigError,
        LimitError,
        LogError,
        MissingDependencyError,
        PlantError,
    )
}


class Field(NamedTuple):
    """One wrong field of a request."""

    path: str
    """Path of the field, as target.f_star[Z]."""
    value: str
    """Value that was given, with its unit."""
    allowed: str
    """Allowed values."""

    def __str__(self) -> str:
        """Say all three in words."""
        return f"{self.path} is {self.value}; allowed: {self.allowed}"


class FieldError(ConfigError):
    """Fields of a request are wrong; every one of them is listed."""

    def __init__(self, wrong: Sequence[Field]) -> None:
        super().__init__("; ".join(map(str, wrong)))
        self.fields = tuple(wrong)


class TokenError(ArmError):
    """A call does not carry the service's token."""


class NoRoomError(ArmError):
    """All the room for calls of one kind is taken."""


class SilentCallError(ArmError):
    """A call was begun and nothing was said, or nothing of its answer was read."""


_STATUS = {
    ConfigError: grpc.StatusCode.INVALID_ARGUMENT,
    LimitError: grpc.StatusCode.INVALID_ARGUMENT,
    PlantError: grpc.StatusCode.ABORTED,
    TokenError: grpc.StatusCode.UNAUTHENTICATED,
    NoRoomError: grpc.StatusCode.RESOURCE_EXHAUSTED,
    SilentCallError: grpc.StatusCode.DEADLINE_EXCEEDED,
    DovetailError: grpc.StatusCode.FAILED_PRECONDITION,
}
"""Status of a failed call by its error: the first that it is."""


def problem_of(error: Exception) -> pb.Problem:
    """Put an exception into a message."""
    kind = type(error)
    if isinstance(error, DovetailError):
        known = next((k for k in kind.__mro__ if k.__name__ in _KNOWN), ArmError)
        reason = error.reason if isinstance(error, ArmError) else ""
        problem = pb.Problem(kind=known.__name__, text=str(error), reason=reason)
    else:
        problem = pb.Problem(kind="ArmError", text=f"{kind.__name__}: {error}")
    for path, value, allowed in error.fields if isinstance(error, FieldError) else ():
        problem.fields.add(path=path, value=value, allowed=allowed)
    return problem


def error_of(problem: pb.Problem) -> DovetailError:
    """Return the exception that a message tells of."""
    if problem.fields:
        facts = ((f.path, f.value, f.allowed) for f in problem.fields)
        return FieldError([Field(*map(printable, texts)) for texts in facts])
    kind, text = _KNOWN.get(problem.kind, ArmError), printable(problem.text)
    if kind is ArmError:
        return ArmError(text, printable(problem.reason))
    return kind(text)


def status_of(error: Exception) -> grpc.StatusCode:
    """Return the status with which a call fails."""
    fits = (code for kind, code in _STATUS.items() if isinstance(error, kind))
    return next(fits, grpc.StatusCode.INTERNAL)


async def abort(context: grpc.aio.ServicerContext, error: Exception) -> NoReturn:
    """End a call with an exception's status, words and fields; does not return."""
    problem = problem_of(error)
    metadata = ((METADATA_KEY, problem.SerializeToString()),)
    await context.abort(status_of(error), problem.text, metadata)


def problem_in(call: grpc.RpcError) -> pb.Problem | None:
    """Return what the service said of a failed call, if it said anything."""
    if not isinstance(call, grpc.Call):
        return None
    metadata: Any = call.trailing_metadata()  # pairs; its stubs do not say so
    for key, value in metadata or ():
        if key == METADATA_KEY and isinstance(value, bytes):
            return pb.Problem.FromString(value)
    return None
