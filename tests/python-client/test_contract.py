"""The package against `proto/`: a changed contract fails here, whichever side was changed."""

from __future__ import annotations

import copy
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import plenalign
import pytest

from bench import ROOT, Daemon
from contract import differences

PROTO = ROOT / "proto"
CONTRACT: dict[str, Any] = json.loads((PROTO / "openapi.json").read_text())


def test_the_package_is_what_the_contract_says() -> None:
    assert differences(CONTRACT) == []


def test_the_daemon_has_the_same_contract(daemon: Daemon, client: plenalign.Client) -> None:
    theirs = client.contract()
    assert differences(theirs) == []
    assert theirs == daemon.raw("/api/v1/openapi.json")


def schema(contract: dict[str, Any], name: str) -> Any:
    return contract["components"]["schemas"][name]


CHANGES = {
    "a field is new": lambda c: schema(c, "AxisView")["properties"].update(new_mm={"type": "number"}),
    "a field is gone": lambda c: schema(c, "AxisView")["properties"].pop("homed"),
    "a field has another type": lambda c: schema(c, "AxisView")["properties"]["homed"].update(type="string"),
    "a field may be null": lambda c: schema(c, "AxisView")["properties"]["homed"].update(type=["boolean", "null"]),
    "a field is no longer required": lambda c: schema(c, "AxisView")["required"].remove("homed"),
    "a field becomes required": lambda c: schema(c, "LeaseAsked")["required"].append("note"),
    "an element has another type": lambda c: schema(c, "JobLog")["properties"]["lines"]["items"].update(
        {"$ref": "#/components/schemas/Move"}
    ),
    "a value is new": lambda c: schema(c, "JobState")["enum"].append("paused"),
    "a value is gone": lambda c: schema(c, "JobState")["enum"].remove("failed"),
    "a described value is gone": lambda c: schema(c, "Config.Side")["oneOf"].pop(),
    "a kind of job is gone": lambda c: schema(c, "JobRequest")["oneOf"].pop(),
    "a kind of job takes more": lambda c: schema(c, "JobRequest")["oneOf"][0]["properties"].update(
        recording={"type": ["boolean", "null"]}
    ),
    "a message is new": lambda c: schema(c, "ServerMessage")["oneOf"].append(
        {"properties": {"type": {"enum": ["more"], "type": "string"}}, "required": ["type"]}
    ),
    "a structure is new": lambda c: c["components"]["schemas"].update(New={"properties": {}, "type": "object"}),
    "a structure is gone": lambda c: c["components"]["schemas"].pop("SceneFaults"),
    "what extends another has more": lambda c: schema(c, "NewToken")["allOf"][1]["properties"].update(
        more={"type": "string"}
    ),
    "a key of the configuration is new": lambda c: schema(c, "Config.AxisConfig")["properties"].update(
        more={"type": "number"}
    ),
    "an operation is new": lambda c: c["paths"].update({"/api/v1/new": {"get": {"operationId": "get_new"}}}),
    "an operation is gone": lambda c: c["paths"].pop("/api/v1/bench"),
    "an operation has another path": lambda c: c["paths"].update({"/api/v1/b": c["paths"].pop("/api/v1/bench")}),
    "an operation has another method": lambda c: c["paths"]["/api/v1/shell"].update(
        post=c["paths"]["/api/v1/shell"].pop("put")
    ),
    "an operation takes more": lambda c: c["paths"]["/api/v1/jobs"]["get"]["parameters"].append(
        {"name": "more", "in": "query"}
    ),
    "an operation takes less": lambda c: c["paths"]["/api/v1/jobs"]["post"]["parameters"].pop(),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_changed_contract_is_found(change: str) -> None:
    changed = copy.deepcopy(CONTRACT)
    CHANGES[change](changed)
    assert changed != CONTRACT
    assert differences(changed), change


def test_what_is_generated_is_what_is_kept(tmp_path: Path) -> None:
    kept = ROOT / "clients" / "python" / "src" / "plenalign"
    generator = ROOT / "clients" / "python" / "tools" / "generate.py"
    subprocess.run([sys.executable, generator, PROTO, tmp_path], check=True, timeout=120)
    written = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.py*") if path.is_file())
    assert [str(path) for path in written] == [
        "_operations.py", "_pb/__init__.py", "_pb/frame_pb2.py", "_pb/frame_pb2.pyi", "configuration.py", "models.py",
    ]  # fmt: skip
    for path in written:
        assert (tmp_path / path).read_text() == (kept / path).read_text(), (
            f"{path}: run clients/python/tools/generate.py"
        )


def test_the_tests_run_on_what_was_installed() -> None:
    assert "site-packages" in plenalign.__file__
    assert (Path(plenalign.__file__).parent / "py.typed").exists()
