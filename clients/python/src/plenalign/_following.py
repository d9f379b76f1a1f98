"""What a viewer has to keep in mind between two connections, and what the messages are."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from enum import Enum
from typing import TYPE_CHECKING, Any, TypeAlias
from uuid import UUID

import msgspec

from ._transport import decode
from .address import Address
from .errors import PlenalignError, UnexpectedAnswerError, problem_error
from .models import (
    BenchMessage,
    GapMessage,
    JobMessage,
    MeasurementMessage,
    PicturesRequest,
    ProblemMessage,
    ReadingsRequest,
    SeenRequest,
    ServerMessage,
    Show,
    SnapshotMessage,
    TickMessage,
    ViewerMessage,
    Viewport,
)

if TYPE_CHECKING:
    from ._pb import frame_pb2

SILENCE_S = 10.0
"""The daemon gives a sign of life every second: after so long without one it is lost."""
LONGEST_MESSAGE = 256 * 1024 * 1024
CONNECT_S = 5.0
_TYPES = frozenset({"snapshot", "gap", "bench", "job", "measurement", "tick", "problem"})
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_CHANGES = (SnapshotMessage, BenchMessage, JobMessage, MeasurementMessage)


@dataclass(frozen=True)
class Picture:
    """A live picture, and when and where it was taken."""

    jpeg: bytes
    """The picture, a JPEG; empty where it comes without loss."""
    png: bytes
    """The picture without loss, a greyscale PNG, where a viewport asked for that; else empty. Samples of 9 to 15 bits
    are the high bits of 16: shifted down by `16 - sample_bits` they are the camera's."""
    sample_bits: int
    """Significant bits of the raw frame's samples."""
    show: Show | None
    """What it shows; none where this package does not know."""
    seq: int
    """Sequence number from the camera."""
    captured_at: datetime
    """End of the exposure."""
    captured_monotonic_us: int
    """The same on the daemon's machine's monotonic clock, µs."""
    exposure_us: int
    """Length of the exposure, µs."""
    exposure_assumed: bool
    """Whether that is assumed."""
    focus_mm: float | None
    """Readback of the focus axis, mm; none while unknown."""
    e_mm: float | None
    """Readback of the e axis, mm; none while unknown."""
    settled: bool
    """Whether both axes were at rest during the exposure."""
    preview: bool
    """Whether it is a coarse picture for viewing only."""
    simulated: bool
    """Whether it was simulated."""
    replayed: bool
    """Whether it was recorded earlier and is played from a file."""
    age_ms: float
    """Age when it was sent, ms."""
    frames_skipped: int
    """Frames that this viewer was not sent until now."""
    alike: int
    """How many pictures in a row are of frames that are the same to the last pixel, this one counted: more than 1 where
    the camera gives an old picture again as if it were new."""
    raw_size: tuple[int, int]
    """Columns and rows of the raw frame."""
    reduce: int
    """Raw pixels to a picture pixel, each way; 0 where a viewport was asked for."""
    viewport: Viewport | None
    """What of the raw frame it shows, and at how many pixels; none where it shows something else."""
    near_mm: float | None
    """Distance that yellow stands for in a picture of the depth, mm; none where it is not known."""
    far_mm: float | None
    """The same of dark violet."""


class CombinedSince(Enum):
    """What a combination of frames began with, where the one before ended."""

    START = 1
    """The first frame that was read."""
    AXIS = 2
    """An axis moved."""
    PICTURE = 3
    """The picture moved, or was taken otherwise."""
    TREND = 4
    """The spacing leapt, or showed a trend."""
    LOST = 5
    """The spacing was lost."""


@dataclass(frozen=True)
class Reading:
    """The spacing in one frame, as the meter reads it."""

    seq: int
    """Sequence number of the frame."""
    captured_at: datetime
    """End of the exposure."""
    captured_monotonic_us: int
    """The same on the daemon's machine's monotonic clock, µs."""
    age_ms: float
    """Age of the frame when this was sent, ms."""
    focus_mm: float | None
    """Readback of the focus axis, mm; none while unknown."""
    e_mm: float | None
    """Readback of the e axis, mm; none while unknown."""
    settled: bool
    """Whether both axes were at rest during the exposure."""
    preview: bool
    """Whether the frame is a coarse picture for viewing only."""
    simulated: bool
    """Whether the frame was simulated."""
    replayed: bool
    """Whether the frame was recorded earlier and is played from a file."""
    lost: bool
    """Whether the spacing could not be followed to this frame, and is searched for."""
    why: str | None
    """Why there is no spacing; of one in doubt, why no frame could be measured in whole to end that; else none."""
    spacing_px: float | None
    """The spacing on the axis, px; none where there is none, and so are those that follow up to the target."""
    spacing_sigma_px: float | None
    """Its standard uncertainty, px."""
    spacing_sigma_random_px: float | None
    """Its standard uncertainty from pixel noise alone, px."""
    tilt_x_px: float | None
    """Rise of the spacing along x, px per half frame width."""
    tilt_y_px: float | None
    """Rise of the spacing along y, px per half frame width."""
    curvature_px: float | None
    """Rise of the spacing with the squared distance from the axis, px per half frame width squared."""
    spacing_target_px: float
    """The spacing wanted, px."""
    spacing_tolerance_px: float
    """By how much it may be off that where a job accepts it, px."""
    in_focus: bool
    """Whether there is a spacing, of one board as far as is known, whose mean is within the blur limit of that."""
    doubted: bool
    """Whether it steps over the field as between two boards, and no whole measurement says yet if there are two."""
    frames_left_out: int
    """Frames that the camera took since somebody began to read, and that were not measured."""
    combined_spacing_px: float | None
    """Mean over the frames up to this one while nothing moved, px: what to go by; none where there is no spacing."""
    combined_sigma_px: float | None
    """Its standard uncertainty, px."""
    combined_frames: int | None
    """How many frames that is."""
    combined_span_s: float | None
    """From the first of them to this one, s."""
    combined_since: CombinedSince | None
    """What ended the combination before; none where the daemon says what this client does not know."""


@dataclass(frozen=True)
class SpacingMap:
    """The spacing micro-image by micro-image; the lists run together."""

    frame_seq: int
    """Sequence number of the frame measured."""
    micro_image_pitch_px: float
    """Pitch of the micro-images, px."""
    spacing_target_px: float
    """The spacing wanted, px."""
    x_px: tuple[float, ...]
    """Columns of the centres, px of the raw frame."""
    y_px: tuple[float, ...]
    """Rows of the centres, px."""
    spacing_px: tuple[float, ...]
    """Spacing between a micro-image's image points and its neighbours', px."""
    sigma_px: tuple[float, ...]
    """Standard uncertainty of that, px; infinite where blank."""
    matched: tuple[bool, ...]
    """Whether it can be used."""


Message: TypeAlias = (
    SnapshotMessage
    | GapMessage
    | BenchMessage
    | JobMessage
    | MeasurementMessage
    | TickMessage
    | ProblemMessage
    | Picture
    | Reading
    | SpacingMap
)
"""What comes while one watches."""


class _Type(msgspec.Struct):
    type: str = ""


class Following:
    """What was seen last, so that a new connection goes on there."""

    def __init__(self, address: Address, pictures: PicturesRequest | None, readings: ReadingsRequest | None) -> None:
        self._address = address
        self._pictures = pictures
        self._readings = readings
        self._after: tuple[int, UUID] | None = None
        if self.greetings():
            _messages()

    @property
    def url(self) -> str:
        """Where to connect."""
        if self._after is None:
            return self._address.socket
        seq, boot_id = self._after
        return f"{self._address.socket}?after={seq}&boot_id={boot_id}"

    def greetings(self) -> list[str]:
        """What is sent over a new connection."""
        return [_text(asked) for asked in (self._pictures, self._readings) if asked is not None]

    def read(self, message: str | bytes) -> tuple[Message | None, list[str]]:
        """A message, where it is one that is known, and what is to be sent back."""
        if isinstance(message, bytes):
            viewed = _viewed(message)
            windowed = self._pictures is not None and bool(self._pictures.window)
            seen = isinstance(viewed, Picture) and windowed
            return viewed, [_text(SeenRequest(seq=viewed.seq))] if seen and isinstance(viewed, Picture) else []
        base = self._address.base
        if decode(message, _Type, base).type not in _TYPES:
            return None, []
        # A union is no class to the type checker.
        kind: Any = ServerMessage
        known: Message = decode(message, kind, base)
        if isinstance(known, _CHANGES):
            self._after = (known.seq, known.boot_id)
        return known, []


def _text(message: ViewerMessage) -> str:
    return msgspec.json.encode(message).decode()


def _messages() -> Any:
    try:
        from ._pb import frame_pb2
    except ImportError as error:
        raise ImportError(
            "live pictures and readings need Google's protobuf: pip install 'plenalign[live]'", name=error.name
        ) from error
    return frame_pb2


def _viewed(data: bytes) -> Picture | Reading | SpacingMap | None:
    """A binary message; none where it is of a kind that is not known."""
    from google.protobuf.message import DecodeError

    pb = _messages()
    try:
        viewed: frame_pb2.Viewed = pb.Viewed.FromString(data)
    except DecodeError as error:
        raise UnexpectedAnswerError(f"a binary message cannot be understood: {error}") from None
    which = viewed.WhichOneof("what")
    if which == "frame":
        return _picture(viewed.frame)
    if which == "reading":
        return _reading(viewed.reading, pb)
    return _map(viewed.spacing_map, pb.LENS_STATE_MATCHED) if which == "spacing_map" else None


def _picture(frame: frame_pb2.Frame) -> Picture:
    shows = {0: Show.RAW, 1: Show.RAW, 2: Show.CENTRAL, 3: Show.ALL_IN_FOCUS, 4: Show.DEPTH}
    return Picture(
        jpeg=frame.jpeg,
        png=frame.png,
        sample_bits=frame.sample_bits,
        show=shows.get(int(frame.picture)),
        seq=frame.seq,
        captured_at=_EPOCH + timedelta(microseconds=frame.captured_unix_us),
        captured_monotonic_us=frame.captured_monotonic_us,
        exposure_us=frame.exposure_us,
        exposure_assumed=frame.exposure_assumed,
        focus_mm=frame.focus_mm if frame.HasField("focus_mm") else None,
        e_mm=frame.e_mm if frame.HasField("e_mm") else None,
        settled=frame.settled,
        preview=frame.preview,
        simulated=frame.simulated,
        replayed=frame.replayed,
        age_ms=frame.age_ms,
        frames_skipped=frame.frames_skipped,
        alike=max(1, frame.alike),
        raw_size=(frame.width_px, frame.height_px),
        reduce=frame.reduce,
        viewport=_viewport(frame.viewport) if frame.HasField("viewport") else None,
        near_mm=frame.near_mm if frame.HasField("near_mm") else None,
        far_mm=frame.far_mm if frame.HasField("far_mm") else None,
    )


def _viewport(shown: frame_pb2.Viewport) -> Viewport:
    return Viewport(
        x_px=shown.x_px,
        y_px=shown.y_px,
        width_px=shown.width_px,
        height_px=shown.height_px,
        picture_width_px=shown.picture_width_px,
        picture_height_px=shown.picture_height_px,
        lossless=shown.lossless,
    )


def _reading(reading: frame_pb2.Reading, pb: Any) -> Reading:
    measured = reading.state == pb.READING_STATE_MEASURED
    since = {since.value: since for since in CombinedSince}

    def value(number: float) -> float | None:
        return number if measured else None

    return Reading(
        seq=reading.seq,
        captured_at=_EPOCH + timedelta(microseconds=reading.captured_unix_us),
        captured_monotonic_us=reading.captured_monotonic_us,
        age_ms=reading.age_ms,
        focus_mm=reading.focus_mm if reading.HasField("focus_mm") else None,
        e_mm=reading.e_mm if reading.HasField("e_mm") else None,
        settled=reading.settled,
        preview=reading.preview,
        simulated=reading.simulated,
        replayed=reading.replayed,
        lost=reading.state == pb.READING_STATE_LOST,
        why=reading.why or None,
        spacing_px=value(reading.spacing_px),
        spacing_sigma_px=value(reading.spacing_sigma_px),
        spacing_sigma_random_px=value(reading.spacing_sigma_random_px),
        tilt_x_px=value(reading.tilt_x_px),
        tilt_y_px=value(reading.tilt_y_px),
        curvature_px=value(reading.curvature_px),
        spacing_target_px=reading.spacing_target_px,
        spacing_tolerance_px=reading.spacing_tolerance_px,
        in_focus=reading.in_focus,
        doubted=reading.doubted,
        frames_left_out=reading.frames_left_out,
        combined_spacing_px=value(reading.combined_spacing_px),
        combined_sigma_px=value(reading.combined_sigma_px),
        combined_frames=reading.combined_frames if measured else None,
        combined_span_s=value(reading.combined_span_s),
        combined_since=since.get(reading.combined_since),
    )


def _map(spacing: frame_pb2.SpacingMap, matched: int) -> SpacingMap:
    return SpacingMap(
        frame_seq=spacing.frame_seq,
        micro_image_pitch_px=spacing.micro_image_pitch_px,
        spacing_target_px=spacing.spacing_target_px,
        x_px=tuple(spacing.x_px),
        y_px=tuple(spacing.y_px),
        spacing_px=tuple(spacing.spacing_px),
        sigma_px=tuple(spacing.sigma_px),
        matched=tuple(state == matched for state in spacing.state),
    )


def refused(status: int, body: bytes, base: str) -> PlenalignError:
    """Why the daemon opens no WebSocket."""
    try:
        problem = msgspec.json.decode(body, type=dict[str, Any])
    except msgspec.DecodeError:
        problem = {}
    if isinstance(problem.get("type"), str):
        return problem_error({"status": status, **problem})
    return UnexpectedAnswerError(f"{base} answers {status} where a WebSocket should be: no plenalign, or a proxy")


def cut_off(code: int, reason: str) -> bool:
    """Whether the daemon closed for a reason that connecting anew does not mend."""
    return code == 1008 and "token" in reason
