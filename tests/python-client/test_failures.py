"""Servers that hang, cut the connection or speak garbage: what cannot be had from the daemon itself."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import plenalign
import pytest
from plenalign.models import SpacingWatchJob

Reply = Callable[[socket.socket, int], None]


class Bad:
    """A server that reads a request, notes its first line, and then does as it is told."""

    def __init__(self, reply: Reply) -> None:
        self.asked: list[str] = []
        self._reply = reply
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"http://127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._answer, args=(connection,), daemon=True).start()

    def _answer(self, connection: socket.socket) -> None:
        with connection:
            head = b""
            while b"\r\n\r\n" not in head:
                piece = connection.recv(65536)
                if not piece:
                    return
                head += piece
            self.asked.append(head.split(b" HTTP", 1)[0].decode())
            try:
                self._reply(connection, len(self.asked))
            except OSError:
                pass

    def close(self) -> None:
        self._listener.close()


@contextmanager
def bad(reply: Reply, timeout_s: float = 0.5) -> Iterator[tuple[Bad, plenalign.Client]]:
    server = Bad(reply)
    with plenalign.Client(server.address, timeout_s=timeout_s) as client:
        try:
            yield server, client
        finally:
            server.close()


def answer(body: bytes, kind: str = "application/json", status: str = "200 OK", more: str = "") -> Reply:
    head = (
        f"HTTP/1.1 {status}\r\ncontent-type: {kind}\r\ncontent-length: {len(body)}\r\nconnection: close\r\n{more}\r\n"
    )
    return lambda connection, _: connection.sendall(head.encode() + body)


def hang(_connection: socket.socket, _number: int) -> None:
    time.sleep(5)


def cut(_connection: socket.socket, _number: int) -> None:
    """Nothing is said, and the connection closed."""


def cut_within(connection: socket.socket, _number: int) -> None:
    connection.sendall(b'HTTP/1.1 200 OK\r\ncontent-type: application/json\r\ncontent-length: 100\r\n\r\n{"lat')


def trickle(connection: socket.socket, _number: int) -> None:
    connection.sendall(b"HTTP/1.1 200 OK\r\ncontent-type: application/json\r\ncontent-length: 1000\r\n\r\n")
    for _ in range(100):
        connection.sendall(b" ")
        time.sleep(0.1)


def lease(key: str = "key") -> bytes:
    view = {
        "id": "0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11",
        "owner": "ada",
        "since": "2026-01-01T00:00:00Z",
        "ttl_s": 3600,
    }
    return json.dumps({"key": key, "lease": view}).encode()


@pytest.mark.parametrize("reply", [hang, cut, cut_within, trickle], ids=lambda reply: reply.__name__)
def test_a_reading_that_fails_is_told_in_time(reply: Reply) -> None:
    with bad(reply) as (server, client):
        before = time.monotonic()
        with pytest.raises(plenalign.ConnectionLostError, match="GET /api/v1/bench"):
            client.bench()
        assert time.monotonic() - before < 3
        assert server.asked == ["GET /api/v1/bench"]


@pytest.mark.parametrize("reply", [hang, cut, cut_within, trickle], ids=lambda reply: reply.__name__)
def test_a_command_whose_answer_does_not_come_is_not_sent_again(reply: Reply) -> None:
    def first_lease(connection: socket.socket, number: int) -> None:
        (answer(lease(), status="201 Created") if number == 1 else reply)(connection, number)

    with bad(first_lease) as (server, client):
        held = client.lease("ada")
        with pytest.raises(plenalign.OutcomeUnknownError, match="may have been obeyed") as unknown:
            held.start(SpacingWatchJob(duration_s=1.0))
        assert unknown.value.idempotency_key
        assert server.asked == ["POST /api/v1/lease", "POST /api/v1/jobs"]


def test_a_move_whose_answer_does_not_come_is_stopped_and_not_sent_again() -> None:
    def reply(connection: socket.socket, number: int) -> None:
        if number == 1:
            answer(lease(), status="201 Created")(connection, number)
        elif number > 2:
            answer(b'{"focus": "confirmed", "e": "confirmed"}')(connection, number)

    with bad(reply) as (server, client):
        held = client.lease("ada")
        with pytest.raises(plenalign.OutcomeUnknownError):
            held.move("focus", 1.0)
        assert server.asked[:2] == ["POST /api/v1/lease", "POST /api/v1/axes/focus/move"]
        stopped = server.asked[2:]
        assert len(stopped) == 1 and stopped[0].startswith("POST /api/v1/stop?owner=")


def test_a_jog_whose_answer_does_not_come_is_ended() -> None:
    def reply(connection: socket.socket, number: int) -> None:
        if number == 1:
            answer(lease(), status="201 Created")(connection, number)

    with bad(reply) as (server, client):
        held = client.lease("ada")
        with pytest.raises(plenalign.OutcomeUnknownError):
            held.jog("focus", "high", 5.0)
        assert server.asked[1:] == ["POST /api/v1/axes/focus/jog", "DELETE /api/v1/axes/focus/jog"]


def test_the_stop_is_asked_again() -> None:
    def reply(connection: socket.socket, number: int) -> None:
        if number == 3:
            answer(b'{"focus": "confirmed", "e": "sent", "latency_ms": 2.5, "kept": true}')(connection, number)

    with bad(reply) as (server, client):
        assert client.stop(owner="ada").latency_ms == 2.5
        assert server.asked == ["POST /api/v1/stop?owner=ada"] * 3
    with bad(cut) as (server, client):
        with pytest.raises(plenalign.OutcomeUnknownError):
            client.stop()
        assert len(server.asked) == 3


GARBAGE = {
    "no HTTP": lambda connection, _: connection.sendall(b"SSH-2.0-OpenSSH_9.2\r\n"),
    "no JSON": answer(b"hello"),
    "no text": answer(b"\xff\xfe{"),
    "another JSON": answer(b'{"status": 7}'),
    "a list": answer(b"[]"),
    "nothing": answer(b""),
    "a page": answer(b"<html>", "text/html", "502 Bad Gateway"),
    "a problem that is none": answer(b'{"type": 5}', "application/problem+json", "500 Internal Server Error"),
    "deep JSON": answer(b"[" * 100_000, "application/problem+json", "500 Internal Server Error"),
    "elsewhere": answer(b"", status="302 Found", more="location: http://example.invalid/\r\n"),
}


@pytest.mark.parametrize("what", GARBAGE)
def test_garbage_is_told_as_such(what: str) -> None:
    with bad(GARBAGE[what]) as (_, client), pytest.raises(plenalign.PlenalignError) as wrong:
        client.health()
    expected = plenalign.ConnectionLostError if what == "no HTTP" else plenalign.UnexpectedAnswerError
    assert type(wrong.value) is expected
    assert client.address.base in str(wrong.value)


def test_a_kind_of_problem_that_is_not_known_is_a_problem() -> None:
    problem = {"type": "urn:plenalign:problem:new", "title": "New", "status": 418, "detail": "do this", "cup": 3}
    reply = answer(json.dumps(problem).encode(), "application/problem+json", "418 I'm a teapot", "retry-after: 4\r\n")
    with bad(reply) as (_, client), pytest.raises(plenalign.ProblemError) as refused:
        client.health()
    it = refused.value
    assert (it.kind, it.title, it.status, it.detail, it.members) == ("new", "New", 418, "do this", {"cup": 3})
    assert it.retry_after_s == 4.0
    assert str(it) == "New: do this"


def test_where_nothing_listens() -> None:
    with plenalign.Client("http://127.0.0.1:9") as client:
        for ask in (client.health, client.stop, lambda: client.lease("ada")):
            with pytest.raises(plenalign.NotReachedError, match="plenalign serve"):
                ask()


def test_a_websocket_that_is_none() -> None:
    for reply in (answer(b"<html>", "text/html", "200 OK"), cut, GARBAGE["no HTTP"]):
        with bad(reply) as (_, client), pytest.raises((plenalign.UnexpectedAnswerError, plenalign.NotReachedError)):
            client.watch().__enter__()


def stream(*pieces: bytes) -> Reply:
    head = b"HTTP/1.1 200 OK\r\ncontent-type: multipart/x-mixed-replace;boundary=plenalign-frame\r\n\r\n"
    return lambda connection, _: connection.sendall(head + b"".join(pieces))


PART = b"--plenalign-frame\r\ncontent-type: image/jpeg\r\ncontent-length: 3\r\nplenalign-frame-seq: 7\r\n\r\nabc\r\n"


def test_a_stream_that_ends_or_is_none() -> None:
    with bad(stream(PART, PART)) as (_, client):
        pictures = client.images.stream()
        assert [next(pictures).data, next(pictures).seq] == [b"abc", 7]
        with pytest.raises(plenalign.ConnectionLostError):
            next(pictures)
    for wrong in (
        PART.replace(b": 3", b": x"),
        PART.replace(b": 3", b": -1"),
        PART.replace(b": 7", b": y"),
        b"x" * 70_000,
    ):
        with bad(stream(wrong)) as (_, client), pytest.raises(plenalign.UnexpectedAnswerError):
            next(client.images.stream())


def test_a_picture_that_is_none() -> None:
    with bad(answer(b"no picture", "image/png")) as (_, client), pytest.raises(plenalign.UnexpectedAnswerError):
        client.images.frame().array()
