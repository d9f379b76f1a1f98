from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ReadingState(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    READING_STATE_UNSPECIFIED: _ClassVar[ReadingState]
    READING_STATE_MEASURED: _ClassVar[ReadingState]
    READING_STATE_LOST: _ClassVar[ReadingState]
    READING_STATE_REFUSED: _ClassVar[ReadingState]

class CombinedSince(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    COMBINED_SINCE_UNSPECIFIED: _ClassVar[CombinedSince]
    COMBINED_SINCE_START: _ClassVar[CombinedSince]
    COMBINED_SINCE_AXIS: _ClassVar[CombinedSince]
    COMBINED_SINCE_PICTURE: _ClassVar[CombinedSince]
    COMBINED_SINCE_TREND: _ClassVar[CombinedSince]
    COMBINED_SINCE_LOST: _ClassVar[CombinedSince]

class LensState(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    LENS_STATE_UNSPECIFIED: _ClassVar[LensState]
    LENS_STATE_MATCHED: _ClassVar[LensState]
    LENS_STATE_MISMATCHED: _ClassVar[LensState]
    LENS_STATE_BLANK: _ClassVar[LensState]

class Picture(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    PICTURE_UNSPECIFIED: _ClassVar[Picture]
    PICTURE_RAW: _ClassVar[Picture]
    PICTURE_CENTRAL: _ClassVar[Picture]
    PICTURE_ALL_IN_FOCUS: _ClassVar[Picture]
    PICTURE_DEPTH: _ClassVar[Picture]
READING_STATE_UNSPECIFIED: ReadingState
READING_STATE_MEASURED: ReadingState
READING_STATE_LOST: ReadingState
READING_STATE_REFUSED: ReadingState
COMBINED_SINCE_UNSPECIFIED: CombinedSince
COMBINED_SINCE_START: CombinedSince
COMBINED_SINCE_AXIS: CombinedSince
COMBINED_SINCE_PICTURE: CombinedSince
COMBINED_SINCE_TREND: CombinedSince
COMBINED_SINCE_LOST: CombinedSince
LENS_STATE_UNSPECIFIED: LensState
LENS_STATE_MATCHED: LensState
LENS_STATE_MISMATCHED: LensState
LENS_STATE_BLANK: LensState
PICTURE_UNSPECIFIED: Picture
PICTURE_RAW: Picture
PICTURE_CENTRAL: Picture
PICTURE_ALL_IN_FOCUS: Picture
PICTURE_DEPTH: Picture

class Viewed(_message.Message):
    __slots__ = ("frame", "spacing_map", "reading")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    SPACING_MAP_FIELD_NUMBER: _ClassVar[int]
    READING_FIELD_NUMBER: _ClassVar[int]
    frame: Frame
    spacing_map: SpacingMap
    reading: Reading
    def __init__(self, frame: _Optional[_Union[Frame, _Mapping]] = ..., spacing_map: _Optional[_Union[SpacingMap, _Mapping]] = ..., reading: _Optional[_Union[Reading, _Mapping]] = ...) -> None: ...

class Reading(_message.Message):
    __slots__ = ("seq", "captured_unix_us", "captured_monotonic_us", "age_ms", "focus_mm", "e_mm", "settled", "preview", "simulated", "replayed", "state", "why", "spacing_px", "spacing_sigma_px", "spacing_sigma_random_px", "tilt_x_px", "tilt_y_px", "curvature_px", "spacing_target_px", "in_focus", "frames_left_out", "combined_spacing_px", "combined_sigma_px", "combined_frames", "combined_span_s", "combined_since", "width_px", "spacing_tolerance_px", "doubted")
    SEQ_FIELD_NUMBER: _ClassVar[int]
    CAPTURED_UNIX_US_FIELD_NUMBER: _ClassVar[int]
    CAPTURED_MONOTONIC_US_FIELD_NUMBER: _ClassVar[int]
    AGE_MS_FIELD_NUMBER: _ClassVar[int]
    FOCUS_MM_FIELD_NUMBER: _ClassVar[int]
    E_MM_FIELD_NUMBER: _ClassVar[int]
    SETTLED_FIELD_NUMBER: _ClassVar[int]
    PREVIEW_FIELD_NUMBER: _ClassVar[int]
    SIMULATED_FIELD_NUMBER: _ClassVar[int]
    REPLAYED_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    WHY_FIELD_NUMBER: _ClassVar[int]
    SPACING_PX_FIELD_NUMBER: _ClassVar[int]
    SPACING_SIGMA_PX_FIELD_NUMBER: _ClassVar[int]
    SPACING_SIGMA_RANDOM_PX_FIELD_NUMBER: _ClassVar[int]
    TILT_X_PX_FIELD_NUMBER: _ClassVar[int]
    TILT_Y_PX_FIELD_NUMBER: _ClassVar[int]
    CURVATURE_PX_FIELD_NUMBER: _ClassVar[int]
    SPACING_TARGET_PX_FIELD_NUMBER: _ClassVar[int]
    IN_FOCUS_FIELD_NUMBER: _ClassVar[int]
    FRAMES_LEFT_OUT_FIELD_NUMBER: _ClassVar[int]
    COMBINED_SPACING_PX_FIELD_NUMBER: _ClassVar[int]
    COMBINED_SIGMA_PX_FIELD_NUMBER: _ClassVar[int]
    COMBINED_FRAMES_FIELD_NUMBER: _ClassVar[int]
    COMBINED_SPAN_S_FIELD_NUMBER: _ClassVar[int]
    COMBINED_SINCE_FIELD_NUMBER: _ClassVar[int]
    WIDTH_PX_FIELD_NUMBER: _ClassVar[int]
    SPACING_TOLERANCE_PX_FIELD_NUMBER: _ClassVar[int]
    DOUBTED_FIELD_NUMBER: _ClassVar[int]
    seq: int
    captured_unix_us: int
    captured_monotonic_us: int
    age_ms: float
    focus_mm: float
    e_mm: float
    settled: bool
    preview: bool
    simulated: bool
    replayed: bool
    state: ReadingState
    why: str
    spacing_px: float
    spacing_sigma_px: float
    spacing_sigma_random_px: float
    tilt_x_px: float
    tilt_y_px: float
    curvature_px: float
    spacing_target_px: float
    in_focus: bool
    frames_left_out: int
    combined_spacing_px: float
    combined_sigma_px: float
    combined_frames: int
    combined_span_s: float
    combined_since: CombinedSince
    width_px: int
    spacing_tolerance_px: float
    doubted: bool
    def __init__(self, seq: _Optional[int] = ..., captured_unix_us: _Optional[int] = ..., captured_monotonic_us: _Optional[int] = ..., age_ms: _Optional[float] = ..., focus_mm: _Optional[float] = ..., e_mm: _Optional[float] = ..., settled: _Optional[bool] = ..., preview: _Optional[bool] = ..., simulated: _Optional[bool] = ..., replayed: _Optional[bool] = ..., state: _Optional[_Union[ReadingState, str]] = ..., why: _Optional[str] = ..., spacing_px: _Optional[float] = ..., spacing_sigma_px: _Optional[float] = ..., spacing_sigma_random_px: _Optional[float] = ..., tilt_x_px: _Optional[float] = ..., tilt_y_px: _Optional[float] = ..., curvature_px: _Optional[float] = ..., spacing_target_px: _Optional[float] = ..., in_focus: _Optional[bool] = ..., frames_left_out: _Optional[int] = ..., combined_spacing_px: _Optional[float] = ..., combined_sigma_px: _Optional[float] = ..., combined_frames: _Optional[int] = ..., combined_span_s: _Optional[float] = ..., combined_since: _Optional[_Union[CombinedSince, str]] = ..., width_px: _Optional[int] = ..., spacing_tolerance_px: _Optional[float] = ..., doubted: _Optional[bool] = ...) -> None: ...

class SpacingMap(_message.Message):
    __slots__ = ("frame_seq", "micro_image_pitch_px", "spacing_target_px", "x_px", "y_px", "spacing_px", "sigma_px", "state")
    FRAME_SEQ_FIELD_NUMBER: _ClassVar[int]
    MICRO_IMAGE_PITCH_PX_FIELD_NUMBER: _ClassVar[int]
    SPACING_TARGET_PX_FIELD_NUMBER: _ClassVar[int]
    X_PX_FIELD_NUMBER: _ClassVar[int]
    Y_PX_FIELD_NUMBER: _ClassVar[int]
    SPACING_PX_FIELD_NUMBER: _ClassVar[int]
    SIGMA_PX_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    frame_seq: int
    micro_image_pitch_px: float
    spacing_target_px: float
    x_px: _containers.RepeatedScalarFieldContainer[float]
    y_px: _containers.RepeatedScalarFieldContainer[float]
    spacing_px: _containers.RepeatedScalarFieldContainer[float]
    sigma_px: _containers.RepeatedScalarFieldContainer[float]
    state: _containers.RepeatedScalarFieldContainer[LensState]
    def __init__(self, frame_seq: _Optional[int] = ..., micro_image_pitch_px: _Optional[float] = ..., spacing_target_px: _Optional[float] = ..., x_px: _Optional[_Iterable[float]] = ..., y_px: _Optional[_Iterable[float]] = ..., spacing_px: _Optional[_Iterable[float]] = ..., sigma_px: _Optional[_Iterable[float]] = ..., state: _Optional[_Iterable[_Union[LensState, str]]] = ...) -> None: ...

class Viewport(_message.Message):
    __slots__ = ("x_px", "y_px", "width_px", "height_px", "picture_width_px", "picture_height_px", "lossless")
    X_PX_FIELD_NUMBER: _ClassVar[int]
    Y_PX_FIELD_NUMBER: _ClassVar[int]
    WIDTH_PX_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_PX_FIELD_NUMBER: _ClassVar[int]
    PICTURE_WIDTH_PX_FIELD_NUMBER: _ClassVar[int]
    PICTURE_HEIGHT_PX_FIELD_NUMBER: _ClassVar[int]
    LOSSLESS_FIELD_NUMBER: _ClassVar[int]
    x_px: int
    y_px: int
    width_px: int
    height_px: int
    picture_width_px: int
    picture_height_px: int
    lossless: bool
    def __init__(self, x_px: _Optional[int] = ..., y_px: _Optional[int] = ..., width_px: _Optional[int] = ..., height_px: _Optional[int] = ..., picture_width_px: _Optional[int] = ..., picture_height_px: _Optional[int] = ..., lossless: _Optional[bool] = ...) -> None: ...

class Frame(_message.Message):
    __slots__ = ("jpeg", "seq", "captured_unix_us", "exposure_us", "exposure_assumed", "focus_mm", "e_mm", "settled", "preview", "simulated", "age_ms", "frames_skipped", "width_px", "height_px", "reduce", "replayed", "captured_monotonic_us", "picture", "viewport", "png", "sample_bits", "near_mm", "far_mm", "alike")
    JPEG_FIELD_NUMBER: _ClassVar[int]
    SEQ_FIELD_NUMBER: _ClassVar[int]
    CAPTURED_UNIX_US_FIELD_NUMBER: _ClassVar[int]
    EXPOSURE_US_FIELD_NUMBER: _ClassVar[int]
    EXPOSURE_ASSUMED_FIELD_NUMBER: _ClassVar[int]
    FOCUS_MM_FIELD_NUMBER: _ClassVar[int]
    E_MM_FIELD_NUMBER: _ClassVar[int]
    SETTLED_FIELD_NUMBER: _ClassVar[int]
    PREVIEW_FIELD_NUMBER: _ClassVar[int]
    SIMULATED_FIELD_NUMBER: _ClassVar[int]
    AGE_MS_FIELD_NUMBER: _ClassVar[int]
    FRAMES_SKIPPED_FIELD_NUMBER: _ClassVar[int]
    WIDTH_PX_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_PX_FIELD_NUMBER: _ClassVar[int]
    REDUCE_FIELD_NUMBER: _ClassVar[int]
    REPLAYED_FIELD_NUMBER: _ClassVar[int]
    CAPTURED_MONOTONIC_US_FIELD_NUMBER: _ClassVar[int]
    PICTURE_FIELD_NUMBER: _ClassVar[int]
    VIEWPORT_FIELD_NUMBER: _ClassVar[int]
    PNG_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_BITS_FIELD_NUMBER: _ClassVar[int]
    NEAR_MM_FIELD_NUMBER: _ClassVar[int]
    FAR_MM_FIELD_NUMBER: _ClassVar[int]
    ALIKE_FIELD_NUMBER: _ClassVar[int]
    jpeg: bytes
    seq: int
    captured_unix_us: int
    exposure_us: int
    exposure_assumed: bool
    focus_mm: float
    e_mm: float
    settled: bool
    preview: bool
    simulated: bool
    age_ms: float
    frames_skipped: int
    width_px: int
    height_px: int
    reduce: int
    replayed: bool
    captured_monotonic_us: int
    picture: Picture
    viewport: Viewport
    png: bytes
    sample_bits: int
    near_mm: float
    far_mm: float
    alike: int
    def __init__(self, jpeg: _Optional[bytes] = ..., seq: _Optional[int] = ..., captured_unix_us: _Optional[int] = ..., exposure_us: _Optional[int] = ..., exposure_assumed: _Optional[bool] = ..., focus_mm: _Optional[float] = ..., e_mm: _Optional[float] = ..., settled: _Optional[bool] = ..., preview: _Optional[bool] = ..., simulated: _Optional[bool] = ..., age_ms: _Optional[float] = ..., frames_skipped: _Optional[int] = ..., width_px: _Optional[int] = ..., height_px: _Optional[int] = ..., reduce: _Optional[int] = ..., replayed: _Optional[bool] = ..., captured_monotonic_us: _Optional[int] = ..., picture: _Optional[_Union[Picture, str]] = ..., viewport: _Optional[_Union[Viewport, _Mapping]] = ..., png: _Optional[bytes] = ..., sample_bits: _Optional[int] = ..., near_mm: _Optional[float] = ..., far_mm: _Optional[float] = ..., alike: _Optional[int] = ...) -> None: ...
