"""The calls of the service, from its description: handlers for it, stubs for clients.

Names are in the house's spelling: GetInfo is `get_info`.
"""

import asyncio
import re
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import grpc
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass

from dovetail.errors import ConfigError, DovetailError
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.problems import SilentCallError, abort

SERVICE = pb.DESCRIPTOR.services_by_name["Arm"]

MESSAGE_MAX = 64 * 2**20
"""Longest answer [bytes]: the longest step at the shortest period fits."""
REQUEST_MAX = 2**18
"""Longest request [bytes]; each is a few kilobytes."""
FIRST_MESSAGE_MAX = 3.0
"""Longest wait for a call's first message [s]; a client sends it with the call."""

KEEPALIVE = (
    ("grpc.keepalive_time_ms", 2000),
    ("grpc.keepalive_timeout_ms", 2000),
    ("grpc.keepalive_permit_without_calls", 1),
    ("grpc.http2.ping_timeout_ms", 2000),
    # gRPC's bandwidth probe is a ping, too; while it is unanswered no other is sent.
    ("grpc.http2.bdp_probe", 0),
    ("grpc.http2.max_pings_without_data", 0),
    ("grpc.http2.min_recv_ping_interval_without_data_ms", 500),
    ("grpc.http2.min_ping_interval_without_data_ms", 500),
)
"""Both ends ask every 2 s whether the other is there, and wait 2 s for the answer: the
loss of a peer's machine or cable is noticed within 4 s, a peer's own end at once."""

Call = Callable[[Any, grpc.aio.ServicerContext], Awaitable[Any]]
"""A method of the servicer: takes the first message and the call's context."""


def _spelled(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()


def make_handler(servicer: Any) -> grpc.GenericRpcHandler:
    """Return the handler that passes each call to the servicer's method.

    The servicer's `admit(name, context)` comes first, before any message is read: it
    raises where the caller may not make this call. On the wire a call with one request
    and a call with many look the same. Here each is a stream, because only its reader
    can end a call whose first message does not come.
    """
    handlers = {}
    for method in SERVICE.methods:
        name = _spelled(method.name)
        call = _answered(servicer, name, getattr(servicer, name))
        make = (
            grpc.stream_stream_rpc_method_handler
            if method.server_streaming
            else grpc.stream_unary_rpc_method_handler
        )
        handlers[method.name] = make(
            call,
            request_deserializer=GetMessageClass(method.input_type).FromString,
            response_serializer=GetMessageClass(method.output_type).SerializeToString,
        )
    return grpc.method_handlers_generic_handler(SERVICE.full_name, handlers)


def _answered(servicer: Any, name: str, method: Call) -> Call:
    """Return a method whose exceptions become the call's status."""

    async def call(requests: Any, context: grpc.aio.ServicerContext) -> Any:
        try:
            servicer.admit(name, context)
            return await method(await _first_message(context), context)
        except DovetailError as error:
            await abort(context, error)
        except DecodeError as error:
            await abort(context, ConfigError(f"not the message of {name}: {error}"))
        except grpc.aio.InternalError:
            return None  # the client has gone: no answer is due
        except Exception as error:
            servicer.fail(name, error)
            await abort(context, error)

    return call


async def read_message(context: grpc.aio.ServicerContext) -> Any:
    """Return a call's next message; None at its end."""
    message = await context.read()
    # grpcio's types (1.85) do not know the constant that its documentation names.
    is_end = message is grpc.aio.EOF  # pyright: ignore[reportAttributeAccessIssue]
    return None if is_end else message


async def _first_message(context: grpc.aio.ServicerContext) -> Any:
    """Wait for a call's first message.

    Raises:
        SilentCallError: It does not come in time, or never will.
    """
    try:
        async with asyncio.timeout(FIRST_MESSAGE_MAX):
            message = await read_message(context)
    except TimeoutError:
        raise SilentCallError(
            f"the call was silent for {FIRST_MESSAGE_MAX:g} s and has ended: call "
            "again and send its first message at once"
        ) from None
    if message is None:
        raise SilentCallError("the call has no message: send one")
    return message


class Stub:
    """A client's end of every call."""

    def __init__(
        self, channel: grpc.Channel, metadata: Sequence[tuple[str, str]] = ()
    ) -> None:
        """Make the calls.

        Args:
            channel: To the service.
            metadata: Sent with every call.
        """
        for method in SERVICE.methods:
            make = {
                (False, False): channel.unary_unary,
                (False, True): channel.unary_stream,
                (True, True): channel.stream_stream,
            }[method.client_streaming, method.server_streaming]
            call = make(
                f"/{SERVICE.full_name}/{method.name}",
                request_serializer=GetMessageClass(method.input_type).SerializeToString,
                response_deserializer=GetMessageClass(method.output_type).FromString,
            )
            setattr(self, _spelled(method.name), partial(call, metadata=metadata))

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...


def is_failed_call(error: Exception) -> bool:
    """Say whether an exception is a call that failed or a channel that was closed."""
    return isinstance(error, grpc.RpcError) or (
        isinstance(error, ValueError) and "closed channel" in str(error)
    )
