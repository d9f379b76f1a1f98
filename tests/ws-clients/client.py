"""The WebSocket by the rules and by breaking them: client.py ADDRESS MESSAGES all|lease"""

import asyncio
import json
import os
import sys
import time
import urllib.request
from datetime import UTC, datetime

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

ADDRESS, MESSAGES, WHICH = sys.argv[1:]
AUTHORISED = {"Authorization": f"Bearer {os.environ['PLENALIGN_TOKEN']}"}
SOCKET = ADDRESS.replace("http", "ws", 1) + "/api/v1/ws"


def viewed_class():
    pool = descriptor_pool.DescriptorPool()
    with open(MESSAGES, "rb") as file:
        for description in descriptor_pb2.FileDescriptorSet.FromString(file.read()).file:
            pool.Add(description)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("plenalign.v1.Viewed"))


Viewed = viewed_class()


async def ask(method, path, body=None, **headers):
    data = None if body is None else json.dumps(body).encode()
    headers = {**AUTHORISED, **({"Content-Type": "application/json"} if data else {}), **headers}
    request = urllib.request.Request(ADDRESS + path, data, headers, method=method)
    answer = await asyncio.to_thread(urllib.request.urlopen, request)
    return json.loads(answer.read() or b"null")


def open_socket(query="", headers=AUTHORISED):
    # Without a bound on what waits to be read here: with one a full queue would keep the close from being seen.
    return connect(SOCKET + query, additional_headers=headers, ping_interval=None, max_size=None, max_queue=None)


async def next_text(socket):
    """The next text message that is not a sign of life."""
    async with asyncio.timeout(10):
        while True:
            message = await socket.recv()
            if isinstance(message, str) and json.loads(message)["type"] != "tick":
                return message


async def next_problem(socket):
    while True:
        message = json.loads(await next_text(socket))
        if message["type"] == "problem":
            return message["problem"]


async def closed_by(send):
    """Code and reason with which the daemon closes after what is sent."""
    async with open_socket() as socket:
        await next_text(socket)
        await send(socket)
        try:
            async with asyncio.timeout(5):
                while True:
                    await socket.recv()
        except ConnectionClosed as closed:
            assert closed.rcvd is not None, f"no close was received: {closed!r}"
            return closed.rcvd.code, closed.rcvd.reason


async def strangers_get_no_socket():
    for headers in ({}, {"Authorization": "Bearer plenalign_wrong"}):
        try:
            async with open_socket(headers=headers):
                raise AssertionError("a stranger has a socket")
        except InvalidStatus as refused:
            assert refused.response.status_code == 401, refused


async def changes_follow_the_snapshot_without_a_gap_and_are_replayed():
    async with open_socket() as socket:
        snapshot = json.loads(await next_text(socket))
        assert snapshot["type"] == "snapshot", snapshot
        changes = []
        for _ in range(3):
            await ask("POST", "/api/v1/stop")
            await ask("DELETE", "/api/v1/stop", {"why": "a test"})
        while len(changes) < 6:
            changes.append(await next_text(socket))
    seqs = [json.loads(change)["seq"] for change in changes]
    assert seqs == list(range(snapshot["seq"] + 1, snapshot["seq"] + 1 + len(seqs))), seqs
    async with open_socket(f"?after={snapshot['seq']}&boot_id={snapshot['boot_id']}") as socket:
        assert [await next_text(socket) for _ in changes] == changes
    other = "00000000-0000-0000-0000-000000000000"
    async with open_socket(f"?after={snapshot['seq']}&boot_id={other}") as socket:
        gap = json.loads(await next_text(socket))
        assert (gap["type"], gap["after"], gap["after_boot_id"]) == ("gap", snapshot["seq"], other), gap
        assert json.loads(await next_text(socket))["type"] == "snapshot"


async def pictures_are_protobuf():
    async with open_socket() as socket:
        await socket.send(json.dumps({"type": "pictures", "on": True, "max_rate_hz": 20, "reduce": 2}))
        frames = []
        async with asyncio.timeout(60):
            while len(frames) < 3:
                message = await socket.recv()
                if isinstance(message, bytes):
                    frames.append(Viewed.FromString(message).frame)
        assert sorted({frame.seq for frame in frames}) == [frame.seq for frame in frames]
        for frame in frames:
            assert frame.jpeg[:2] == b"\xff\xd8" and frame.jpeg[-2:] == b"\xff\xd9"
            assert frame.simulated and frame.reduce == 2 and frame.width_px > 0 and frame.height_px > 0
            assert abs(frame.captured_unix_us / 1e6 - time.time()) < 30, frame.captured_unix_us


async def a_connection_holds_the_lease_and_ten_seconds_longer():
    grant = await ask("POST", "/api/v1/lease", {"owner": "websockets", "ttl_s": 2})
    term = datetime.fromisoformat(grant["lease"]["expires_at"])
    lease = lambda: ask("GET", "/api/v1/lease")

    async def until(what, holds):
        end = time.monotonic() + 60
        while not holds(held := (await lease())["lease"]):
            assert time.monotonic() < end, f"never {what}: {held}"
            await asyncio.sleep(0.1)

    async with open_socket() as socket:
        await socket.send(json.dumps({"type": "hold", "lease": "guess"}))
        assert (await next_problem(socket))["status"] == 412
        await socket.send(json.dumps({"type": "hold", "lease": grant["key"]}))
        await until("its term is over", lambda held: datetime.now(UTC) > term)
        held = (await lease())["lease"]
        assert held["owner"] == "websockets" and held["expires_at"] is None, held
    gone = time.monotonic()
    await until("it is let go", lambda held: held is not None and held["expires_at"] is not None)
    await until("its grace is over", lambda held: held is None)
    assert time.monotonic() - gone < 12, "the lease outlasts its grace"
    assert time.monotonic() - gone > 9, "the lease did not have its grace"


async def fragments_are_put_together():
    async with open_socket() as socket:

        async def fragments():
            for part in ('{"type":', '"dan', 'ce"}'):
                yield part
                await socket.ping()

        await socket.send(fragments())
        assert (await next_problem(socket))["status"] == 422


async def pings_are_answered_and_nonsense_is_told():
    async with open_socket() as socket:
        latency = await asyncio.wait_for(await socket.ping(b"are you there"), 5)
        assert latency < 5
        for text, status in (("{", 400), ('{"type":"dance"}', 422), ("[]", 422), ("", 400)):
            await socket.send(text)
            assert (await next_problem(socket))["status"] == status, text
        await asyncio.wait_for(await socket.ping(), 5)


async def what_breaks_the_rules_is_closed_with_the_code_for_it():
    async def raw(socket, data):
        socket.transport.write(data)

    for what, code, send in (
        ("5000 bytes", 1009, lambda socket: socket.send("x" * 5000)),
        ("a megabyte", 1009, lambda socket: socket.send("x" * 1_000_000)),
        ("5000 bytes in parts", 1009, lambda socket: socket.send(["x" * 1000] * 5)),
        ("binary", 1003, lambda socket: socket.send(b"\x00")),
        ("no UTF-8", 1007, lambda socket: socket.send(b"\xff\xfe", text=True)),
        ("no mask", 1002, lambda socket: raw(socket, b"\x81\x02hi")),
        ("a reserved bit", 1002, lambda socket: raw(socket, b"\xc1\x80\x00\x00\x00\x00")),
        ("a reserved opcode", 1002, lambda socket: raw(socket, b"\x83\x80\x00\x00\x00\x00")),
        ("a long ping", 1002, lambda socket: raw(socket, b"\x89\xfe\x00\x7e\x00\x00\x00\x00" + b"x" * 126)),
        ("a part of nothing", 1002, lambda socket: raw(socket, b"\x80\x80\x00\x00\x00\x00")),
    ):
        found, reason = await closed_by(send)
        assert found == code, f"{what}: {found} {reason!r}"
        assert reason, what


async def a_close_is_answered():
    socket = await open_socket()
    await next_text(socket)
    await socket.close(1000, "done")
    assert socket.protocol.close_rcvd is not None and socket.protocol.close_rcvd.code == 1000, (
        socket.protocol.close_rcvd
    )
    assert socket.protocol.close_rcvd_then_sent is False


async def main():
    if WHICH == "lease":
        checks = (a_connection_holds_the_lease_and_ten_seconds_longer,)
    else:
        # One after another: they count changes of the bench.
        checks = ALL
    for check in checks:
        await check()
        print(f"- websockets: {check.__name__.replace('_', ' ')}", flush=True)


ALL = (
    strangers_get_no_socket,
    changes_follow_the_snapshot_without_a_gap_and_are_replayed,
    pictures_are_protobuf,
    fragments_are_put_together,
    pings_are_answered_and_nonsense_is_told,
    what_breaks_the_rules_is_closed_with_the_code_for_it,
    a_close_is_answered,
)

asyncio.run(main())
