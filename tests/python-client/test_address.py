"""Addresses, tokens and what vouches for a daemon: what is wrong is told before anything is sent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import plenalign
import pytest
from plenalign import Address


def test_the_daemon_on_this_machine_is_where_it_looks() -> None:
    assert Address().base == "http://127.0.0.1:8080"
    assert Address("https://bench.lab:8443/").socket == "wss://bench.lab:8443/api/v1/ws"


@pytest.mark.parametrize(
    ("server", "given", "word"),
    [
        ("bench.lab:8080", {}, "not an address such as"),
        ("ftp://bench.lab", {}, "not an address such as"),
        ("http://", {}, "not an address such as"),
        ("http://bench.lab:99999", {}, "not an address such as"),
        ("http://bench.lab/api/v1", {}, "alone"),
        ("http://ada:secret@bench.lab", {}, "alone"),
        ("http://bench.lab", {"token": "plenalign_x"}, "https://"),
        ("http://127.0.0.1", {"token": "plenalign x"}, "token"),
        ("http://127.0.0.1", {"token": "plenalign_\u00e9"}, "token"),
        ("http://127.0.0.1", {"ca": "ca.pem"}, "not encrypted"),
        ("http://127.0.0.1", {"fingerprint": "00" * 32}, "not encrypted"),
        ("https://bench.lab", {"ca": "/nowhere/ca.pem"}, "/nowhere/ca.pem"),
        ("https://bench.lab", {"fingerprint": "12:34"}, "64 hexadecimal"),
        ("https://bench.lab", {"fingerprint": "x" * 64}, "64 hexadecimal"),
        ("https://bench.lab", {"ca": "ca.pem", "fingerprint": "00" * 32}, "not both"),
    ],
)
def test_what_is_wrong_is_told(server: str, given: dict[str, Any], word: str) -> None:
    with pytest.raises(plenalign.AddressError, match=word) as wrong:
        Address(server, **given)
    assert "secret" not in str(wrong.value)
    assert given.get("token", "\0") not in str(wrong.value)


def test_a_file_that_holds_no_certificate_is_told(tmp_path: Path) -> None:
    (tmp_path / "ca.pem").write_text("nothing")
    with pytest.raises(plenalign.AddressError, match=r"ca\.pem"):
        Address("https://bench.lab", ca=tmp_path / "ca.pem")


def test_on_loopback_a_token_may_go_unencrypted() -> None:
    for server in ("http://127.0.0.1:1", "http://localhost:1", "http://[::1]:1"):
        assert Address(server, token="plenalign_x").headers == {"authorization": "Bearer plenalign_x"}
    assert Address("http://bench.lab", token="plenalign_x", insecure=True).token == "plenalign_x"


@pytest.mark.parametrize("timeout_s", [0.0, -1.0, float("nan"), float("inf")])
def test_there_is_no_waiting_for_ever(timeout_s: float) -> None:
    with pytest.raises(ValueError, match="seconds above 0"):
        plenalign.Client(timeout_s=timeout_s)
