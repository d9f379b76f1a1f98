"""Pictures: the newest frame, what it shows, and the live stream."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any, Literal

from . import _operations as op
from ._files import Path_, write
from ._transport import LONG_S, Answer, Transport
from .errors import ConnectionLostError, UnexpectedAnswerError
from .models import ViewReport

if TYPE_CHECKING:
    import numpy
    import numpy.typing

Seen = Literal["central", "all_in_focus", "refocus", "depth"]
"""What a view shows."""
_BOUNDARY = b"--plenalign-frame"
_LONGEST_HEAD = 16 * 1024
_LONGEST_PICTURE = 256 * 1024 * 1024


@dataclass(frozen=True)
class Image:
    """A picture and when and where it was taken. What is not known, or of no frame, is none."""

    data: bytes
    """The file: a PNG or a JPEG."""
    media_type: str
    """Such as `image/png`."""
    online: bool = True
    """Whether it is of a frame; if not, it says why there is none."""
    seq: int | None = None
    """Sequence number from the camera."""
    captured_at: datetime | None = None
    """End of the exposure."""
    captured_monotonic_ms: float | None = None
    """The same on the daemon's machine's monotonic clock, which no setting of the clock disturbs, ms."""
    exposure_ms: float | None = None
    """Length of the exposure, ms."""
    exposure_assumed: bool | None = None
    """Whether that is assumed, not the driver's word."""
    age_ms: float | None = None
    """Age of the frame when it was sent, ms."""
    focus_mm: float | None = None
    """Readback of the focus axis, mm."""
    e_mm: float | None = None
    """Readback of the e axis, mm."""
    settled: bool | None = None
    """Whether both axes were at rest during the exposure."""
    preview: bool | None = None
    """Whether it is a coarse picture for viewing only."""
    simulated: bool | None = None
    """Whether it was simulated."""
    replayed: bool | None = None
    """Whether it was recorded earlier and is played from a file."""
    dropped: int | None = None
    """In a stream: frames that this viewer was not sent until now."""

    def __repr__(self) -> str:
        """Without the picture itself."""
        return f"Image({self.media_type}, {len(self.data)} bytes, seq={self.seq}, online={self.online})"

    def array(self) -> numpy.typing.NDArray[Any]:
        """The picture's samples: rows, columns and, where there is colour, red, green, blue; 8 or 16 bits each."""
        try:
            import numpy
            from PIL import Image as Pillow
        except ImportError as error:
            raise ImportError(
                "pictures as arrays need NumPy and Pillow: pip install 'plenalign[images]'", name=error.name
            ) from error
        try:
            with Pillow.open(io.BytesIO(self.data)) as picture:
                samples = numpy.asarray(picture)
        except OSError as error:
            raise UnexpectedAnswerError(f"the picture cannot be read: {error}") from error
        # A PNG of 16 bits may come as wider integers.
        return samples.astype(numpy.uint16) if samples.dtype.kind == "i" else samples

    def save(self, path: Path_) -> None:
        """Writes the file, as a whole or not at all."""
        write(path, self.data)


class Images:
    """Pictures of the bench's camera."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def frame(self) -> Image:
        """The newest frame with the camera's own samples: a PNG of 8 or 16 bits."""
        return _image(self._transport.ask(op.GET_FRAME_PNG, timeout_s=LONG_S))

    def snapshot(self, *, reduce: Literal[1, 2, 4] | None = None, quality: int | None = None) -> Image:
        """A frame taken after this was asked for, as a greyscale JPEG."""
        asked = {"reduce": reduce, "quality": quality}
        return _image(self._transport.ask(op.GET_SNAPSHOT, query=asked, timeout_s=LONG_S))

    def view(
        self,
        kind: Seen = "central",
        *,
        angle: tuple[float, float] | None = None,
        distance_mm: float | None = None,
        quality: int | None = None,
        lossless: bool = False,
    ) -> Image:
        """What the newest frame sees: from the middle or from an angle, all sharp, sharp at a distance, or how far.

        `angle` is right and down, 1 at the aperture's edge, to four decimals.
        """
        direction = None if angle is None else ",".join(_decimal(part) for part in angle)
        asked = {"kind": kind, "angle": direction, "distance_mm": distance_mm, "quality": quality}
        operation = op.GET_VIEW_PNG if lossless else op.GET_VIEW_JPEG
        return _image(self._transport.ask(operation, query=asked, timeout_s=LONG_S))

    def view_report(self, *, lenses: bool = False) -> ViewReport:
        """The figures of the newest frame's views; `lenses` for those of every micro-image."""
        return self._transport.ask(op.GET_VIEW, query={"lenses": lenses}, timeout_s=LONG_S).as_(ViewReport)

    def stream(
        self,
        *,
        reduce: Literal[1, 2, 4] | None = None,
        quality: int | None = None,
        max_rate_hz: float | None = None,
        silence_s: float = 15.0,
    ) -> Iterator[Image]:
        """The live picture, as JPEGs, until it is closed; the newest frame wins.

        Where there is no frame, a picture says why. Nothing for `silence_s` raises `ConnectionLostError`, and so does
        the stream's end.
        """
        asked = {"reduce": reduce, "quality": quality, "max_rate_hz": max_rate_hz}
        # Connections of its own: a stream that its user lets go of ends when it is collected, which may be in the midst
        # of another request, and would wait for ever for what that one has locked.
        with (
            Transport(self._transport.address, self._transport.timeout_s) as alone,
            alone.open(op.GET_STREAM, query=asked, timeout_s=silence_s) as response,
        ):
            yield from _parts(response.iter_raw(), silence_s)
        raise ConnectionLostError("the daemon has ended the stream: it shuts down, or the token is good no more")


def _decimal(part: float) -> str:
    if not -1.0 <= part <= 1.0:
        raise ValueError(f"angle: {part} is not within -1 to 1")
    text = f"{part:.4f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _parts(pieces: Iterator[bytes], silence_s: float) -> Iterator[Image]:
    """The pictures in a multipart stream."""
    kept = bytearray()
    since = time.monotonic()
    for piece in pieces:
        kept += piece
        while (part := _part(kept)) is not None:
            since = time.monotonic()
            yield part
            since = time.monotonic()
        if time.monotonic() - since > silence_s:
            raise ConnectionLostError(f"the stream brought no whole picture for {silence_s} s")


def _part(kept: bytearray) -> Image | None:
    """Takes the first whole part out of what has come."""
    start = kept.find(_BOUNDARY)
    end = kept.find(b"\r\n\r\n", max(start, 0))
    if end < 0 or start < 0:
        if len(kept) > _LONGEST_HEAD:
            raise UnexpectedAnswerError("what comes is no stream of this version of plenalign")
        return None
    lines = kept[start + len(_BOUNDARY) : end].decode("latin-1").split("\r\n")
    head = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in lines) if name}
    try:
        length = int(head["content-length"])
    except (KeyError, ValueError):
        length = -1
    if not 0 <= length <= _LONGEST_PICTURE:
        raise UnexpectedAnswerError("a part of the stream does not say how long it is")
    begin = end + 4
    if len(kept) < begin + length:
        return None
    data = bytes(kept[begin : begin + length])
    del kept[: begin + length]
    return _from(head, data)


def _image(answer: Answer) -> Image:
    return _from(answer.headers, answer.body)


def _from(head: Mapping[str, str], data: bytes) -> Image:
    """A picture from its headers."""

    def said(name: str) -> str | None:
        return head.get(f"plenalign-{name}")

    def number(name: str) -> float | None:
        value = said(name)
        return None if value is None else float(value)

    def truth(name: str) -> bool | None:
        value = said(name)
        return None if value is None else value == "true"

    seq, at, dropped = said("frame-seq"), said("captured-at"), said("dropped")
    try:
        return Image(
            data=data,
            media_type=head.get("content-type", "application/octet-stream"),
            online=truth("online") is not False,
            seq=None if seq is None else int(seq),
            captured_at=None if at is None else moment(at),
            captured_monotonic_ms=number("captured-monotonic-ms"),
            exposure_ms=number("exposure-ms"),
            exposure_assumed=truth("exposure-assumed"),
            age_ms=number("frame-age-ms"),
            focus_mm=number("focus-mm"),
            e_mm=number("e-mm"),
            settled=truth("settled"),
            preview=truth("preview"),
            simulated=truth("simulated"),
            replayed=truth("replayed"),
            dropped=None if dropped is None else int(dropped),
        )
    except ValueError as error:
        raise UnexpectedAnswerError(f"a picture's headers cannot be understood: {error}") from None


def moment(text: str) -> datetime:
    """A moment as RFC 3339 has it, to the microsecond."""
    # Before Python 3.11 neither `Z` nor more than six decimals are understood.
    head, dot, decimals = text.removesuffix("Z").partition(".")
    return datetime.fromisoformat(f"{head}{dot}{decimals[:6].ljust(6, '0') if dot else ''}+00:00")
