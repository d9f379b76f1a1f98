"""Whether the package's structures are what the contract says, found without the generator that wrote them."""

from __future__ import annotations

import ast
import inspect
import types
import typing
from datetime import datetime
from enum import Enum
from pathlib import Path
from typing import Any
from uuid import UUID

import msgspec
import plenalign
from plenalign import _operations, configuration, models

NOT_OFFERED = {
    "get_docs": "a page for people",
    "sign_in": "a browser's way to a cookie",
    "sign_out": "a browser's way out of it",
    "open_websocket": "spoken by the WebSocket library, not over a request",
}
SCALARS = {str: "string", bool: "boolean", int: "integer", float: "number", type(None): "null"}
FORMATS = {UUID: "uuid", datetime: "date-time"}

Shape = frozenset[Any]


def of_schema(schema: dict[str, Any]) -> Shape:
    """What a schema allows."""
    if "$ref" in schema:
        return frozenset({("ref", schema["$ref"].rsplit("/", 1)[1])})
    for key in ("oneOf", "anyOf"):
        if key in schema:
            return frozenset().union(*(of_schema(member) for member in schema[key]))
    kinds = schema.get("type")
    if kinds is None:
        return frozenset({"any"})
    found: set[Any] = set()
    for kind in [kinds] if isinstance(kinds, str) else kinds:
        if kind == "array":
            found.add(("array", of_schema(schema.get("items", {}))))
        elif kind == "object":
            values = schema.get("additionalProperties")
            found.add(("map", of_schema(values if isinstance(values, dict) else {})))
        elif kind == "string" and schema.get("format") in ("uuid", "date-time"):
            found.add(schema["format"])
        else:
            found.add(kind)
    return frozenset(found)


def of_type(kind: Any, names: dict[Any, str]) -> Shape:
    """What a type allows; whether it may be left out is not looked at."""
    if isinstance(kind, typing.ForwardRef):
        kind = kind.__forward_arg__
    try:
        if kind in names:
            return frozenset({("ref", names[kind])})
    except TypeError:
        pass
    if kind is Any:
        return frozenset({"any"})
    if kind in SCALARS or kind in FORMATS:
        return frozenset({SCALARS.get(kind) or FORMATS[kind]})
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        members = [member for member in arguments if member is not msgspec.UnsetType]
        # A union with a name of its own has been taken apart: it is put together again.
        for name, whole in UNIONS.items() if names else ():
            parts = set(typing.get_args(whole))
            if parts and parts <= set(members):
                members = [member for member in members if member not in parts]
                return frozenset({("ref", name)}).union(*(of_type(member, names) for member in members))
        return frozenset().union(*(of_type(member, names) for member in members))
    if origin is list:
        return frozenset({("array", of_type(arguments[0], names))})
    if origin is dict:
        return frozenset({("map", of_type(arguments[1], names))})
    raise AssertionError(f"{kind} is nothing that a contract has")


def classes(module: types.ModuleType) -> dict[str, type]:
    """The structures and enumerations that a module defines."""
    return {
        name: of
        for name, of in vars(module).items()
        if inspect.isclass(of) and of.__module__ == module.__name__ and issubclass(of, (msgspec.Struct, Enum))
    }


CLASSES = {f"Config.{name}" if name != "Config" else name: of for name, of in classes(configuration).items()}
CLASSES.update(classes(models))
UNIONS: dict[str, Any] = {
    "JobRequest": models.JobRequest,
    "Outcome": models.Outcome,
    "ServerMessage": models.ServerMessage,
    "Setup": models.Setup,
    "ViewerMessage": models.ViewerMessage,
    "Config.ControlValue": configuration.ControlValue,
}


def differences(contract: dict[str, Any]) -> list[str]:
    """Everything in which package and contract differ, in both directions."""
    schemas = contract["components"]["schemas"]
    found: list[str] = []
    known = {of: name for name, of in CLASSES.items()}
    seen: set[str] = set()
    for name, schema in schemas.items():
        members = schema.get("oneOf", [])
        if name in UNIONS and any("properties" in member for member in members):
            found += _union(name, members, known, seen)
        elif name in UNIONS:
            if of_schema(schema) != of_type(UNIONS[name], {}):
                found.append(f"{name}: is {of_schema(schema)} in the contract")
        elif name not in CLASSES:
            found.append(f"{name}: is not in the package")
        else:
            seen.add(name)
            found += _class(name, schema, CLASSES[name], known, schemas)
    found += [f"{name}: is not in the contract" for name in CLASSES if name not in seen]
    found += [f"{name}: is not in the contract" for name in UNIONS if name not in schemas]
    return found + _operations_differ(contract)


def _class(name: str, schema: dict[str, Any], of: type, known: dict[Any, str], schemas: dict[str, Any]) -> list[str]:
    if issubclass(of, Enum):
        values = schema.get("enum") or [member.get("const") for member in schema.get("oneOf", [])]
        ours = [member.value for member in of]
        return [] if sorted(values) == sorted(ours) else [f"{name}: {ours} here, {values} in the contract"]
    assert issubclass(of, msgspec.Struct)
    parts = [schemas[part["$ref"].rsplit("/", 1)[1]] if "$ref" in part else part for part in schema.get("allOf", [])]
    # What is made of something that is itself made of others.
    while any("allOf" in part for part in parts):
        parts = [
            schemas[inner["$ref"].rsplit("/", 1)[1]] if "$ref" in inner else inner
            for part in parts
            for inner in part.get("allOf", [part])
        ]
    parts = parts or [schema]
    properties = {key: value for part in parts for key, value in part.get("properties", {}).items()}
    required = {key for part in parts for key in part.get("required", [])}
    return _fields(name, properties, required, of, known)


def _fields(
    name: str, properties: dict[str, Any], required: set[str], of: type[msgspec.Struct], known: dict[Any, str]
) -> list[str]:
    found = []
    fields = {field.encode_name: field for field in msgspec.structs.fields(of)}
    for key in sorted(properties.keys() | fields.keys()):
        if key not in fields:
            found.append(f"{name}.{key}: is not in the package")
        elif key not in properties:
            found.append(f"{name}.{key}: is not in the contract")
        else:
            theirs, ours = of_schema(properties[key]), of_type(fields[key].type, known)
            if theirs != ours:
                found.append(f"{name}.{key}: {sorted(map(str, ours))} here, {sorted(map(str, theirs))} in the contract")
            if fields[key].required != (key in required):
                found.append(f"{name}.{key}: required {fields[key].required} here, {key in required} in the contract")
            unset = fields[key].default is msgspec.UNSET
            if not fields[key].required and unset == bool({"null", "any"} & theirs):
                found.append(f"{name}.{key}: what stands for its absence is {fields[key].default!r}")
    return found


def _union(name: str, members: list[dict[str, Any]], known: dict[Any, str], seen: set[str]) -> list[str]:
    found = []
    ours = {of.__struct_config__.tag: of for of in typing.get_args(UNIONS[name])}
    theirs = {}
    for member in members:
        key = next(key for key in ("type", "kind") if key in member["properties"])
        (value,) = member["properties"][key]["enum"]
        theirs[value] = (key, member)
    for value in sorted(ours.keys() | theirs.keys()):
        if value not in ours or value not in theirs:
            found.append(f"{name} {value}: is only in the {'contract' if value in theirs else 'package'}")
            continue
        key, member = theirs[value]
        of = ours[value]
        seen.add(known[of])
        if of.__struct_config__.tag_field != key:
            found.append(f"{name} {value}: told by {of.__struct_config__.tag_field} here, {key} in the contract")
        properties = {each: schema for each, schema in member["properties"].items() if each != key}
        found += _fields(f"{name} {value}", properties, set(member.get("required", [])) - {key}, of, known)
    seen.update(known[of] for of in typing.get_args(UNIONS[name]) if of.__struct_config__.tag not in theirs)
    return found


def _operations_differ(contract: dict[str, Any]) -> list[str]:
    theirs = {}
    for path, methods in contract["paths"].items():
        for method, operation in methods.items():
            parameters = operation.get("parameters", [])
            names = {
                where: {each["name"] for each in parameters if each["in"] == where} for where in ("query", "header")
            }
            theirs[operation["operationId"]] = (method.upper(), path, names["query"], names["header"])
    ours = {
        name.lower(): (of.method, of.path, set(of.query), set(of.headers))
        for name, of in vars(_operations).items()
        if isinstance(of, _operations.Operation)
    }
    found = [
        f"operation {name}: {ours.get(name)} here, {theirs.get(name)} in the contract"
        for name in sorted(ours.keys() | theirs.keys())
        if ours.get(name) != theirs.get(name)
    ]
    offered = offered_operations()
    for name in sorted(theirs):
        if (name in offered) == (name in NOT_OFFERED):
            found.append(f"operation {name}: is {'' if name in offered else 'not '}offered, contrary to NOT_OFFERED")
    return found + [f"operation {name}: is in NOT_OFFERED alone" for name in NOT_OFFERED if name not in theirs]


def offered_operations() -> set[str]:
    """The operations that the package's code sends."""
    folder = Path(plenalign.__file__).parent
    return {
        node.attr.lower()
        for file in folder.glob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "op"
    }
