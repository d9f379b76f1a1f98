"""Pictures as files, as arrays, and live."""

from __future__ import annotations

import re
from datetime import datetime, timedelta, timezone
from pathlib import Path

import plenalign
import pytest
from plenalign.images import moment
from plenalign.models import CameraFaults, Faults


def test_a_frame_with_all_its_samples(client: plenalign.Client, tmp_path: Path) -> None:
    frame = client.images.frame()
    assert frame.media_type == "image/png"
    samples = frame.array()
    assert samples.shape == (560, 560)
    assert samples.dtype in ("uint8", "uint16")
    assert samples.max() > samples.min()
    assert frame.simulated is True
    assert frame.seq is not None
    assert frame.captured_at is not None
    assert abs(datetime.now(timezone.utc) - frame.captured_at) < timedelta(seconds=60)
    assert frame.exposure_ms is not None
    frame.save(tmp_path / "frame.png")
    assert (tmp_path / "frame.png").read_bytes() == frame.data
    assert "bytes" in repr(frame)


def test_a_snapshot_is_new(client: plenalign.Client) -> None:
    first = client.images.snapshot(reduce=2, quality=50)
    assert first.array().shape == (280, 280)
    second = client.images.snapshot(reduce=4)
    assert second.array().shape == (140, 140)
    assert first.seq is not None
    assert second.seq is not None
    assert second.seq > first.seq
    with pytest.raises(plenalign.InvalidError, match="1, 2 or 4"):
        client.images.snapshot(reduce=3)  # type: ignore[arg-type]
    with pytest.raises(plenalign.InvalidError, match="10 to 100"):
        client.images.snapshot(quality=5)


def test_views(homed: plenalign.Client) -> None:
    report = homed.images.view_report()
    assert report.simulated
    assert report.lenses is None
    with_lenses = homed.images.view_report(lenses=True)
    assert with_lenses.lenses is not None
    assert len(with_lenses.lenses) == with_lenses.micro_images
    straight = homed.images.view()
    assert straight.media_type == "image/jpeg"
    sideways = homed.images.view("central", angle=(0.4, -0.25), lossless=True)
    assert sideways.media_type == "image/png"
    assert list(sideways.array().shape[:2]) == report.view_px[::-1]
    with pytest.raises(ValueError, match="-1 to 1"):
        homed.images.view(angle=(2.0, 0.0))
    with pytest.raises(plenalign.InvalidError):
        homed.images.view("refocus", distance_mm=0.5)


def test_the_stream(client: plenalign.Client) -> None:
    stream = client.images.stream(reduce=4, max_rate_hz=10.0)
    pictures = [next(stream) for _ in range(4)]
    stream.close()  # type: ignore[attr-defined]
    assert all(picture.online and picture.media_type == "image/jpeg" for picture in pictures)
    numbers = [picture.seq for picture in pictures]
    assert None not in numbers
    assert numbers == sorted(set(numbers))  # type: ignore[type-var]
    assert pictures[0].array().shape == (140, 140)
    assert all(picture.dropped is not None for picture in pictures)


def test_a_stream_without_a_camera_says_so(client: plenalign.Client) -> None:
    client.set_faults(Faults(camera=CameraFaults(unplugged=True)))
    stream = client.images.stream(reduce=4)
    for picture in stream:
        if not picture.online:
            assert picture.seq is None
            assert picture.data.startswith(b"\xff\xd8")
            break
    with pytest.raises(plenalign.UnavailableError) as refused:
        client.images.snapshot()
    assert refused.value.kind == "no-frame"
    assert refused.value.retry_after_s is not None
    client.set_faults()
    assert any(picture.online for picture, _ in zip(stream, range(200), strict=False))


@pytest.mark.timeout(30)
@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
def test_a_stream_that_is_let_go_of_in_the_midst_of_a_request_does_not_hold_it_up(client: plenalign.Client) -> None:
    stream = client.images.stream(reduce=4)
    next(stream)
    pool = client._transport._client._transport._pool  # type: ignore[attr-defined]
    with pool._optional_thread_lock:
        del stream
    assert client.bench().simulated


@pytest.mark.parametrize("decimals", ["", ".5", ".123456", ".123456789"])
def test_moments_have_their_decimals(decimals: str) -> None:
    found = moment(f"2026-11-23T01:02:03{decimals}Z")
    assert found.tzinfo is not None
    assert (found.minute, found.second) == (2, 3)
    assert found.microsecond == int((re.sub(r"\D", "", decimals) + "000000")[:6])
