"""One type for each data schema of a Thing Description, which SHACL shapes may leave open."""

from linked_fleet_gateway.faces import Json

_LIMITS = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")


def with_types(said: Json) -> Json:
    """Return the description with one ``type`` in each schema, as some clients need it (wotpy 0.18)."""
    properties = {name: _with_type(each) for name, each in said["properties"].items()}
    actions = {name: _typed_action(each) for name, each in said["actions"].items()}
    return said | {"properties": properties, "actions": actions}


def _typed_action(action: Json) -> Json:
    return action | {kind: _with_type(action[kind]) for kind in ("input", "output") if kind in action}


def _with_type(schema: Json) -> Json:
    """Return a schema with its type, also in its parts.

    TD 1.1 has one type for each schema. ``nullable`` beside it permits the null of an unknown value (as in Ajv, and so
    in node-wot).
    """
    found = dict(schema)
    if "properties" in schema:
        found["properties"] = {name: _with_type(each) for name, each in schema["properties"].items()}
    if "items" in schema:
        found["items"] = _with_type(schema["items"])
    if "oneOf" in schema:
        found["oneOf"] = [_with_type(each) for each in schema["oneOf"]]
    if "type" in found:
        return found
    kinds = {each.get("type") for each in found.get("oneOf", ())}
    known = kinds - {"null"}
    kind = known.pop() if len(known) == 1 else _implied_type(found)
    return found | ({} if kind is None else {"type": kind}) | ({"nullable": True} if "null" in kinds else {})


def _implied_type(schema: Json) -> str | None:
    """Return the type that the keywords of a schema are for; None if they are for any."""
    if "properties" in schema:
        return "object"
    if "items" in schema:
        return "array"
    if any(limit in schema for limit in _LIMITS):
        return "number"
    return "string" if schema.get("enum") or isinstance(schema.get("const"), str) else None
