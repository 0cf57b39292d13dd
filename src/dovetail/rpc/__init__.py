"""The gRPC service of an arm and what both of its ends share.

`dovetail_pb2` is generated from `proto/dovetail.proto`; CONTRIBUTING.md says how.
"""
