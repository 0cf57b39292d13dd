"""The calls of the service, from its description: handlers for it, stubs for clients.

Names are in the house's spelling: GetInfo is `get_info`.
"""

import re
from typing import TYPE_CHECKING, Any

import grpc
from google.protobuf.message_factory import GetMessageClass

from dovetail.rpc import dovetail_pb2 as pb

SERVICE = pb.DESCRIPTOR.services_by_name["Arm"]

MESSAGE_MAX = 64 * 2**20
"""Longest answer [bytes]: the longest step at the shortest period fits."""
REQUEST_MAX = 2**18
"""Longest request [bytes]; each is a few kilobytes."""

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


def _spelled(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()


def _shape(method: Any) -> str:
    ends = (method.client_streaming, method.server_streaming)
    return "_".join("stream" if is_stream else "unary" for is_stream in ends)


_HANDLERS = {
    "unary_unary": grpc.unary_unary_rpc_method_handler,
    "unary_stream": grpc.unary_stream_rpc_method_handler,
    "stream_stream": grpc.stream_stream_rpc_method_handler,
}


def make_handler(servicer: Any) -> grpc.GenericRpcHandler:
    """Return the handler that passes each call to the servicer's method."""
    handlers = {}
    for method in SERVICE.methods:
        make = _HANDLERS[_shape(method)]
        handlers[method.name] = make(
            getattr(servicer, _spelled(method.name)),  # the proto says which
            request_deserializer=GetMessageClass(method.input_type).FromString,
            response_serializer=GetMessageClass(method.output_type).SerializeToString,
        )
    return grpc.method_handlers_generic_handler(SERVICE.full_name, handlers)


class Stub:
    """A client's end of every call."""

    def __init__(self, channel: grpc.Channel) -> None:
        for method in SERVICE.methods:
            make = {
                "unary_unary": channel.unary_unary,
                "unary_stream": channel.unary_stream,
                "stream_stream": channel.stream_stream,
            }[_shape(method)]
            call = make(
                f"/{SERVICE.full_name}/{method.name}",
                request_serializer=GetMessageClass(method.input_type).SerializeToString,
                response_deserializer=GetMessageClass(method.output_type).FromString,
            )
            setattr(self, _spelled(method.name), call)

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...


def is_failed_call(error: Exception) -> bool:
    """Say whether an exception is a call that failed or a channel that was closed."""
    return isinstance(error, grpc.RpcError) or (
        isinstance(error, ValueError) and "closed channel" in str(error)
    )
