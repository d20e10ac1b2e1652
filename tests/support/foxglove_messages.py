"""Foxglove messages decoded by the schemas sent with them, without code of the gateway."""

from functools import cache
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory


@cache
def _factory(name: str, schema: bytes) -> Any:
    files = descriptor_pb2.FileDescriptorSet.FromString(schema)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


def decoded(name: str, schema: bytes, content: bytes) -> Any:
    """Raises google.protobuf.message.DecodeError."""
    return _factory(name, schema).FromString(content)
