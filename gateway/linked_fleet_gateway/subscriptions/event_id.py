"""Ids of messages: the version of the resource, and a tag of the representation that the message is of.

Resources of a robot that change in one frame have the same version, and so may other resources with equal facts. The
tag makes the id of one of them differ from those of the others, also from that of the same thing without its values. A
client that resumes elsewhere with an id thus gets the present state.
"""

from base64 import urlsafe_b64encode
from hashlib import blake2b

_TAG_BYTES = 6  # eight characters: among the resources of a robot no two tags are ever equal in practice


def event_tag(path: str, with_values: bool) -> str:
    """Return the tag of a resource, described with or without measured values; equal on all gateways."""
    named = f"{path} {with_values:d}".encode()
    return urlsafe_b64encode(blake2b(named, digest_size=_TAG_BYTES).digest()).decode()


def event_id(version: str, tag: str) -> str:
    """Return the id of a message."""
    return f"{version}~{tag}"
