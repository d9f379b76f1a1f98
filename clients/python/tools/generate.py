"""Writes the package's models, operations and messages from the contract: generate.py PROTO [INTO].

PROTO is the folder with `openapi.json` and `plenalign/v1/frame.proto`. What is written is formatted by `ruff`.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

Schema = dict[str, Any]

HEAD = '"""{about}\n\nWritten from the contract by `tools/generate.py`: change that, not this.\n"""\n'
# What names the members of a union of objects, after the member's own name.
MEMBER_SUFFIX = {"JobRequest": "Job", "Outcome": "Outcome", "ServerMessage": "Message", "ViewerMessage": "Request"}
SCALARS = {"string": "str", "boolean": "bool", "integer": "int", "number": "float", "null": "None"}
FORMATS = {"uuid": "UUID", "date-time": "datetime"}
KEYWORDS = {"from"}
CONFIGURATION = "Config."


def reference(schema: Schema) -> str | None:
    """Name of the schema that is referred to."""
    ref: str | None = schema.get("$ref")
    return ref and ref.rsplit("/", 1)[1]


def camel(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def class_name(name: str) -> str:
    return name.removeprefix(CONFIGURATION)


def enumeration(schema: Schema) -> list[tuple[str, str | None]] | None:
    """Values and their meanings of an enumeration of texts."""
    members = schema.get("oneOf", [])
    if members and all("const" in member for member in members):
        return [(member["const"], member.get("description")) for member in members]
    if "enum" in schema:
        return [(value, None) for value in schema["enum"]]
    return None


def tag(schema: Schema) -> tuple[str, str] | None:
    """The key, and its value, by which an object is told from others."""
    for key, of in schema.get("properties", {}).items():
        if key in ("type", "kind") and len(of.get("enum", [])) == 1:
            return key, of["enum"][0]
    return None


def is_union_of_objects(schema: Schema) -> bool:
    members = schema.get("oneOf", [])
    return bool(members) and all(tag(member) is not None for member in members)


class Writer:
    """Writes one module: the configuration's, or that of everything else."""

    def __init__(self, schemas: dict[str, Schema], configuration: bool) -> None:
        self.schemas = schemas
        self.configuration = configuration
        self.lines: list[str] = []

    def names(self) -> list[str]:
        def of_here(name: str) -> bool:
            return (name == "Config" or name.startswith(CONFIGURATION)) == self.configuration

        return [name for name in self.schemas if of_here(name)]

    def named(self, name: str) -> str:
        elsewhere = (name == "Config" or name.startswith(CONFIGURATION)) and not self.configuration
        return ("configuration." if elsewhere else "") + class_name(name)

    def type_of(self, schema: Schema) -> str:
        if (name := reference(schema)) is not None:
            return self.named(name)
        for key in ("oneOf", "anyOf"):
            if key in schema:
                return " | ".join(dict.fromkeys(self.type_of(member) for member in schema[key]))
        kinds = schema.get("type", [])
        kinds = [kinds] if isinstance(kinds, str) else kinds
        return " | ".join(self.of_kind(kind, schema) for kind in kinds) or "Any"

    def of_kind(self, kind: str, schema: Schema) -> str:
        if kind == "array":
            return f"list[{self.type_of(schema.get('items', {}))}]"
        if kind == "object":
            values = schema.get("additionalProperties")
            return f"dict[str, {self.type_of(values) if isinstance(values, dict) else 'Any'}]"
        if kind == "string":
            return FORMATS.get(schema.get("format", ""), "str")
        return SCALARS[kind]

    def text(self, text: str, indent: str) -> None:
        quote = textwrap.wrap(" ".join(text.split()), 113 - len(indent))
        if len(quote) == 1 and not quote[0].endswith('"'):
            self.lines.append(f'{indent}"""{quote[0]}"""')
        else:
            self.lines += [f'{indent}"""{quote[0]}', *(indent + line for line in quote[1:]), f'{indent}"""']

    def enum(self, name: str, schema: Schema, values: list[tuple[str, str | None]]) -> None:
        self.lines += ["", "", f"class {class_name(name)}(str, Enum):"]
        self.text(schema.get("description", class_name(name)), "    ")
        for value, about in values:
            self.lines.append(f'    {value.upper()} = "{value}"')
            if about:
                self.text(about, "    ")

    def depth(self, name: str) -> int:
        """How many others come before it: what it is derived from, what that is derived from, and so on."""
        bases = [base for part in self.schemas[name].get("allOf", []) if (base := reference(part))]
        return max((1 + self.depth(base) for base in bases), default=0)

    def struct(self, name: str, schema: Schema, bases: list[str], options: str = "") -> None:
        base = ", ".join(bases) or "Struct"
        self.lines += ["", "", f"class {name}({base}, frozen=True, kw_only=True, omit_defaults=True{options}):"]
        self.text(schema.get("description", name), "    ")
        key = tag(schema) if "tag=" in options else None
        for field, of in schema.get("properties", {}).items():
            if key is None or field != key[0]:
                self.field(field, of, field in schema.get("required", []))

    def field(self, field: str, of: Schema, required: bool) -> None:
        kind = self.type_of(of)
        nullable = "None" in kind.split(" | ") or kind == "Any"
        name = f"{field}_" if field in KEYWORDS else field
        default = "" if required else ("None" if nullable else "UNSET")
        if default == "UNSET":
            kind += " | UnsetType"
        if name != field:
            default = f'field(name="{field}"' + (f", default={default})" if default else ")")
        self.lines.append(f"    {name}: {kind}" + (f" = {default}" if default else ""))
        about = of.get("description") or next(
            (member["description"] for member in of.get("oneOf", []) if "description" in member), None
        )
        if about:
            self.text(about, "    ")

    def write(self, about: str) -> str:
        later: list[str] = []
        for name in sorted(self.names(), key=self.depth):
            schema = self.schemas[name]
            values = enumeration(schema)
            if values is not None:
                self.enum(name, schema, values)
            elif is_union_of_objects(schema):
                members = []
                for member in schema["oneOf"]:
                    key, value = tag(member) or ("", "")
                    members.append(camel(value) + MEMBER_SUFFIX.get(name, name))
                    member = {"description": f"`{value}`: {schema.get('description', name)}", **member}
                    self.struct(members[-1], member, [], f', tag_field="{key}", tag="{value}"')
                later += ["", f"{class_name(name)}: TypeAlias = {' | '.join(members)}"]
            elif "allOf" in schema:
                bases = [self.named(base) for part in schema["allOf"] if (base := reference(part))]
                own: Schema = next((part for part in schema["allOf"] if "properties" in part), {})
                self.struct(class_name(name), {**own, "description": schema.get("description", name)}, bases)
            elif "properties" in schema:
                self.struct(class_name(name), schema, [])
            else:
                later += ["", f"{class_name(name)}: TypeAlias = {self.type_of(schema)}"]
        lines = [*self.lines, "", *later]
        return HEAD.format(about=about) + "\n".join([*self.imports("\n".join(lines)), *lines]) + "\n"

    def imports(self, body: str) -> Iterator[str]:
        yield "from __future__ import annotations\n"
        if "datetime" in body:
            yield "from datetime import datetime"
        yield "from enum import Enum"
        typing = [name for name in ("Any", "TypeAlias") if re.search(rf"\b{name}\b", body)]
        if typing:
            yield f"from typing import {', '.join(typing)}"
        if "UUID" in body:
            yield "from uuid import UUID"
        names = [
            name
            for name in ("UNSET", "Struct", "UnsetType", "field")
            if re.search(rf"\b{name}\b" if name != "field" else r"= field\(", body)
        ]
        yield f"\nfrom msgspec import {', '.join(names)}"
        if "configuration." in body:
            yield "\nfrom . import configuration"


def operations(paths: dict[str, Any]) -> str:
    """The module of the operations."""
    lines = [
        HEAD.format(about="The daemon's operations."),
        "from typing import NamedTuple\n\n",
        "class Operation(NamedTuple):",
        '    """An operation: its method and path, and what it takes beside a body."""\n',
        "    method: str",
        "    path: str",
        "    query: tuple[str, ...] = ()",
        "    headers: tuple[str, ...] = ()\n\n",
    ]
    for path, methods in paths.items():
        for method, operation in methods.items():
            takes = operation.get("parameters", [])
            arguments = [f'"{method.upper()}"', f'"{path}"']
            for where, keyword in (("query", "query"), ("header", "headers")):
                names = tuple(parameter["name"] for parameter in takes if parameter["in"] == where)
                if names:
                    arguments.append(f"{keyword}={names!r}")
            lines.append(f"{operation['operationId'].upper()} = Operation({', '.join(arguments)})")
    return "\n".join(lines) + "\n"


def messages(proto: Path, into: Path) -> None:
    """The Protobuf messages' module and its types, by protoc."""
    (into / "_pb").mkdir(parents=True, exist_ok=True)
    (into / "_pb" / "__init__.py").write_text('"""The WebSocket\'s binary messages, by protoc."""\n')
    source = proto / "plenalign" / "v1"
    command = [sys.executable, "-m", "grpc_tools.protoc", f"--proto_path={source}"]
    command += [f"--python_out={into / '_pb'}", f"--pyi_out={into / '_pb'}", str(source / "frame.proto")]
    subprocess.run(command, check=True)  # noqa: S603


def main() -> None:
    """Writes everything."""
    proto = Path(sys.argv[1])
    into = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).parent.parent / "src" / "plenalign"
    contract = json.loads((proto / "openapi.json").read_text())
    schemas = contract["components"]["schemas"]
    into.mkdir(parents=True, exist_ok=True)
    written = {
        "configuration.py": Writer(schemas, True).write("The configuration. A key that is left out has its default."),
        "models.py": Writer(schemas, False).write("What the daemon is asked and answers."),
        "_operations.py": operations(contract["paths"]),
    }
    for name, text in written.items():
        (into / name).write_text(text)
    messages(proto, into)
    files = [str(into / name) for name in written]
    config = str(Path(__file__).parent.parent / "pyproject.toml")
    for arguments in (["check", "--quiet", "--fix", "--select", "I"], ["format", "--quiet"]):
        subprocess.run([sys.executable, "-m", "ruff", *arguments, "--config", config, *files], check=True)  # noqa: S603


if __name__ == "__main__":
    main()
