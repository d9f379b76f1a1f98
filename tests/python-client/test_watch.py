"""Watching: a snapshot, then changes; on after a break, and not on where that is no use."""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import Callable

import plenalign
import pytest
from plenalign.models import (
    BenchMessage,
    GapMessage,
    JobMessage,
    JobState,
    MeasurementMessage,
    PicturesRequest,
    ProblemMessage,
    ReadingsRequest,
    Show,
    SnapshotMessage,
    SpacingWatchJob,
    TickMessage,
    Viewport,
)

from bench import Daemon


def until(watch: plenalign.Watch, kind: type, within_s: float = 30.0) -> plenalign.Message:
    """The next message of a kind."""
    deadline = time.monotonic() + within_s
    for message in watch:
        if isinstance(message, kind):
            return message
        assert time.monotonic() < deadline, f"no {kind.__name__}"
    raise AssertionError("the watching ended")


def test_everything_first_and_then_what_changes(homed: plenalign.Client) -> None:
    with homed.watch() as watch, homed.lease("ada") as lease:
        first = next(watch)
        assert isinstance(first, SnapshotMessage)
        assert first.version == homed.health().version
        job = lease.start(SpacingWatchJob(duration_s=1.0))
        numbers = [first.seq]
        measured = 0
        for message in watch:
            if isinstance(message, BenchMessage | JobMessage | MeasurementMessage):
                numbers.append(message.seq)
            measured += isinstance(message, MeasurementMessage)
            if isinstance(message, JobMessage) and message.job.state is JobState.SUCCEEDED:
                assert message.job.id == job.id
                break
        assert measured >= 1
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
        assert isinstance(until(watch, TickMessage), TickMessage)


def test_live_pictures(homed: plenalign.Client) -> None:
    wanted = PicturesRequest(on=True, reduce=4, max_rate_hz=10.0, overlay=True, window=1)
    with homed.watch(pictures=wanted, readings=ReadingsRequest(on=True)) as watch:
        pictures = [until(watch, plenalign.Picture) for _ in range(3)]
        readings = [until(watch, plenalign.Reading) for _ in range(3)]
        spacing = until(watch, plenalign.SpacingMap, 60.0)
    for picture in pictures:
        assert isinstance(picture, plenalign.Picture)
        assert picture.jpeg.startswith(b"\xff\xd8")
        assert (picture.raw_size, picture.reduce, picture.show) == ((560, 560), 4, Show.RAW)
        assert picture.alike == 1
        assert picture.simulated
        assert picture.focus_mm is not None
    assert isinstance(spacing, plenalign.SpacingMap)
    assert len(spacing.x_px) == len(spacing.y_px) == len(spacing.spacing_px) == len(spacing.matched) > 0
    assert any(spacing.matched)
    for reading in readings:
        assert isinstance(reading, plenalign.Reading)
        assert reading.simulated
        assert (reading.spacing_px is None) == (reading.why is not None)
        assert reading.spacing_target_px > 0
        assert (reading.combined_spacing_px is None) == (reading.spacing_px is None)
        if reading.combined_frames is not None:
            assert reading.combined_frames >= 1
            assert isinstance(reading.combined_since, plenalign.CombinedSince)


def test_a_part_of_the_frame_without_loss(homed: plenalign.Client) -> None:
    part = Viewport(
        x_px=100, y_px=40, width_px=64, height_px=32, picture_width_px=640, picture_height_px=320, lossless=True
    )
    with homed.watch(pictures=PicturesRequest(on=True, viewport=part)) as watch:
        picture = until(watch, plenalign.Picture)
    assert isinstance(picture, plenalign.Picture)
    assert picture.viewport == Viewport(
        x_px=100, y_px=40, width_px=64, height_px=32, picture_width_px=64, picture_height_px=32, lossless=True
    )
    assert (picture.reduce, picture.sample_bits, picture.jpeg) == (0, 8, b"")
    # Columns, rows and depth stand behind the name of a PNG's first part.
    assert picture.png[12:25] == b"IHDR" + bytes([0, 0, 0, 64, 0, 0, 0, 32, 8])


def test_what_cannot_be_used_is_told(homed: plenalign.Client) -> None:
    with homed.watch(pictures=PicturesRequest(on=True, reduce=3)) as watch:
        message = until(watch, ProblemMessage)
    assert isinstance(message, ProblemMessage)
    assert "1, 2 or 4" in message.problem.detail


def test_it_goes_on_where_it_was(homed: plenalign.Client) -> None:
    with homed.watch() as watch:
        first = next(watch)
        assert isinstance(first, SnapshotMessage)
        watch._drop()
        with homed.lease("missed"):
            pass
        missed: list[BenchMessage] = []
        while not missed or missed[-1].bench.lease is not None or len(missed) < 2:
            message = next(watch)
            # What follows is what was missed, and nothing is said twice.
            assert not isinstance(message, SnapshotMessage | GapMessage)
            if isinstance(message, BenchMessage):
                missed.append(message)
    assert [change.seq for change in missed] == list(range(first.seq + 1, first.seq + 1 + len(missed)))
    assert "missed" in {change.bench.lease.owner for change in missed if change.bench.lease}


def test_a_daemon_started_anew_is_a_gap_and_a_snapshot(new_daemon: Callable[..., Daemon]) -> None:
    daemon = new_daemon().start()
    with plenalign.Client(daemon.address) as client, client.watch(reconnect_s=60.0) as watch:
        first = next(watch)
        assert isinstance(first, SnapshotMessage)
        daemon.end(signal.SIGKILL)
        daemon.start()
        gap = until(watch, GapMessage)
        assert isinstance(gap, GapMessage)
        assert gap.after_boot_id == first.boot_id != gap.boot_id
        assert isinstance(next(watch), SnapshotMessage)
        daemon.end()
        watch._reconnect_s = 1.0
        with pytest.raises(plenalign.ConnectionLostError, match="broke"):
            until(watch, GapMessage)


def test_a_daemon_that_says_nothing_is_lost(new_daemon: Callable[..., Daemon]) -> None:
    daemon = new_daemon().start()
    with plenalign.Client(daemon.address) as client, client.watch(reconnect_s=0.0) as watch:
        next(watch)
        daemon.signal(signal.SIGSTOP)
        before = time.monotonic()
        with pytest.raises(plenalign.ConnectionLostError):
            until(watch, GapMessage, 60.0)
        assert 8.0 < time.monotonic() - before < 25.0
        daemon.signal(signal.SIGCONT)


def test_where_there_is_no_daemon() -> None:
    with plenalign.Client("http://127.0.0.1:9") as client, pytest.raises(plenalign.NotReachedError):
        client.watch().__enter__()


def test_a_token_is_needed_and_its_revocation_ends_it(guarded: Daemon, admin: plenalign.Client) -> None:
    with plenalign.Client(guarded.address) as stranger, pytest.raises(plenalign.UnauthorisedError):
        stranger.watch().__enter__()
    made = admin.access.create_token("watcher", "view")
    with plenalign.Client(guarded.address, token=made.secret) as viewer, viewer.watch() as watch:
        assert isinstance(next(watch), SnapshotMessage)
        admin.access.revoke_token(made)
        with pytest.raises(plenalign.ConnectionLostError, match="revoked"):
            until(watch, GapMessage)


def test_closed_by_another_thread_it_ends(homed: plenalign.Client) -> None:
    watch = homed.watch()
    with watch:
        next(watch)
    assert list(watch) == []


def test_asynchronously(daemon: Daemon, homed: plenalign.Client) -> None:
    async def follow() -> list[plenalign.Message]:
        found: list[plenalign.Message] = []
        pictures = PicturesRequest(on=True, reduce=4)
        async with plenalign.aio.watch(daemon.address, pictures=pictures) as messages:
            async for message in messages:
                found.append(message)
                if len(found) == 1:
                    lease = await asyncio.to_thread(homed.lease, "seen")
                # Of two changes of the bench at once only the newer is told.
                seen = any(isinstance(each, BenchMessage) and each.bench.lease for each in found)
                pictured = any(isinstance(each, plenalign.Picture) for each in found)
                if seen and pictured and isinstance(message, TickMessage):
                    break
            await asyncio.to_thread(lease.release)
            await messages._drop()
            found.append(await asyncio.wait_for(anext(messages), 10))
        return found

    found = asyncio.run(follow())
    assert isinstance(found[0], SnapshotMessage)
    owners = [each.bench.lease.owner for each in found if isinstance(each, BenchMessage) and each.bench.lease]
    assert "seen" in owners


def test_asynchronously_where_it_fails(guarded: Daemon) -> None:
    async def refused(address: str, **given: str) -> None:
        async with plenalign.aio.watch(address, **given):  # type: ignore[arg-type]
            raise AssertionError("it was let in")

    with pytest.raises(plenalign.UnauthorisedError):
        asyncio.run(refused(guarded.address))
    with pytest.raises(plenalign.UnauthorisedError):
        asyncio.run(refused(guarded.address, token="plenalign_wrong"))
    with pytest.raises(plenalign.NotReachedError):
        asyncio.run(refused("http://127.0.0.1:9"))
