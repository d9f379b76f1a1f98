"""What the daemon is asked and answers.

Written from the contract by `tools/generate.py`: change that, not this.
"""

from __future__ import annotations

from datetime import datetime
from enum import Enum
from typing import Any, TypeAlias
from uuid import UUID

from msgspec import UNSET, Struct, UnsetType, field

from . import configuration


class AirDesignView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The air design, from which the solutions depart."""

    aperture_mm: float
    """Aperture diameter, mm."""
    fov_deg: float
    """Field of view over the sensor's width, degrees."""
    half_width_mm: float
    """Half the width of board seen at the object distance in air, mm."""
    image_distance_mm: float
    """v, mm."""
    object_distance_mm: float
    """Object distance in air, mm from the lens."""


class Audit(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Who did what, and from where."""

    at: datetime
    """When, RFC 3339."""
    detail: dict[str, Any]
    """The particulars."""
    from_: str | None = field(name="from", default=None)
    """Address that it was asked from."""
    what: str
    """What was done, e.g. `job.create`."""
    who: str
    """Name of whoever did it."""


class AuditList(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A page of the audit log."""

    entries: list[Audit]
    """Who did what, newest first."""
    next: str | None = None
    """What to give as `cursor` for the next, older page; `null` on the last one."""


class AxisFaults(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What goes wrong with an axis."""

    backlash_growth_mm: float | UnsetType = UNSET
    """By how much the play grows at every reversal, mm."""
    backlash_mm: float | UnsetType = UNSET
    """Play on reversal, beside the configured one, mm."""
    limit_switch: bool | UnsetType = UNSET
    """Its switches are closed, wherever it stands."""
    slip_share: float | UnsetType = UNSET
    """Share of every way that the screw slips."""
    stalled: bool | UnsetType = UNSET
    """The motor stands still whatever steps it is given; the controller does not know."""
    stops_late_ms: int | UnsetType = UNSET
    """How long the carriage creeps after the motor, ms: the controller says "stopped" and it is not true."""


class AxisName(str, Enum):
    """Which of the bench's two axes."""

    FOCUS = "focus"
    E = "e"


class AxisView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One axis as a caller sees it."""

    axis: AxisName
    """Which axis."""
    connected: bool
    """Whether the controller answers."""
    disagreements: list[str]
    """What differs between controller and configuration."""
    driver: str
    """Driver's name."""
    failure: str | None = None
    """Why the last move or homing by hand did not end as commanded; absent once another is commanded, and where a
    stop was why, once that is reset.
    """
    fault: str | None = None
    """Why it cannot move now."""
    high_limit_mm: float
    """Greatest position allowed, mm."""
    homed: bool
    """Whether the position is known."""
    identity: str
    """What the controller says it is."""
    jog_speed_mm_per_s: float
    """Greatest speed at which it jogs, mm/s: a jog that is asked to go faster goes at this."""
    limit_switch: bool
    """Whether a limit switch is pressed, where the controller cannot tell which of the two it is (Grbl): its
    operator looks, and has the axis moved off it (`leave-switch`).
    """
    location: str
    """Where it is."""
    low_limit_mm: float
    """Least position allowed now, mm: the limit of travel, or the e wall."""
    moving: bool
    """Whether the axis moves."""
    position_mm: float | None = None
    """Position read back, mm; absent while unknown."""


class BenchView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The state of the whole bench."""

    air_step_holds: bool | UnsetType = UNSET
    """Whether a shell step can go on from the newest air step: the camera has kept its focus since, and there is a
    white frame of it as it is set.
    """
    axes: list[AxisView]
    """Focus axis and e axis."""
    camera: CameraView
    """The camera."""
    confirm_key_begins: str | None = None
    """How the newest confirm key of the job under way begins: one that begins otherwise confirms nothing any more.
    Absent while there is none.
    """
    contradicted: str | None = None
    """Why the picture through the shell is not what the configuration says, as a job has found: no move is to be
    made on the strength of it. Absent while none has, and once something else is set up.
    """
    design_origin: str
    """Where the design's numbers come from."""
    e_untold: bool
    """Whether it is so far from where it is configured because no shell step has told the axis's zero and scale."""
    e_wall_mm: float
    """The e wall, mm of the e axis's reading. With the shell on, or not known to be off, it is where three standard
    uncertainties of the axis's zero and scale are left between the lens and the shell: by the configuration, or
    as a shell step has told them.
    """
    history_fault: str | None = None
    """Why the history cannot be written, which keeps every axis still; absent while it can."""
    in_view: InView | UnsetType = UNSET
    """What stands before the lens."""
    job: UUID | None = None
    """The job under way, by its id."""
    lease: LeaseView | None = None
    """Who may move the axes; absent while nobody has taken the control lease."""
    set_up_at: datetime | UnsetType = UNSET
    """Since when shell and what stands before the lens are as they are, RFC 3339: a frame taken before shows
    another scene.
    """
    shell: ShellState
    """Whether the shell is on."""
    simulated: bool
    """Whether the bench is simulated."""
    stop: StopView
    """The stop's latch."""


class Budget(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What an alignment is good to, with all that it takes for granted."""

    conclusion: str
    """Both verdicts in a sentence, with the part that most is lost by where one cannot be told."""
    contradictions: list[str]
    """What was configured and what was measured that do not go together, a sentence each."""
    correlation: list[list[float]]
    """Correlation of Δv, e and the spacing's distance from focus."""
    delta_v: Verdict
    """Δv against `assembly.delta_v_tolerance_mm`."""
    delta_v_mm: float
    """Δv, mm: d + N b less the air design's v."""
    delta_v_sigma_mm: float
    """Its standard uncertainty, mm."""
    e: Verdict
    """e against `assembly.e_tolerance_mm`."""
    e_mm: float
    """e, mm: from the shell's centre back to the lens's principal point."""
    e_sigma_mm: float
    """Its standard uncertainty, mm."""
    in_focus: Verdict
    """Whether the object is in focus: its blur against `assembly.blur_limit_px`."""
    off_focus_px: float
    """The spacing near the axis less that at which the microlenses focus, px: its size is the blur's diameter."""
    off_focus_sigma_px: float
    """Its standard uncertainty, px."""
    parts: list[BudgetPart]
    """The parts, the one that costs most of its tolerance first."""


class BudgetPart(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What one part of the budget does."""

    delta_v_mm: float
    """What Δv is uncertain by because of it, mm."""
    e_mm: float
    """The same of e, mm."""
    key: str | None = None
    """The key that says how well it is known; `null` for a measurement."""
    name: str
    """What it is."""
    off_focus_px: float
    """The same of the spacing's distance from the one in focus, px."""
    remedy: str
    """What would make it smaller."""


class CameraFaults(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What goes wrong with the camera."""

    frozen: bool | UnsetType = UNSET
    """Its driver gives the same picture again and again, as if it were new."""
    picture: PictureFault | UnsetType = UNSET
    """What is wrong with its pictures."""
    unplugged: bool | UnsetType = UNSET
    """The camera is unplugged."""


class CameraFound(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A camera that is connected."""

    card: str
    """What its driver calls it; of a GenICam camera, its maker and model."""
    formats: list[str]
    """The formats it offers that this program reads."""
    names: list[str]
    """What `bench.camera.device` can be to mean it, the steadiest name first."""
    path: str
    """Its device file; of a camera on the network, its address."""
    standard: str
    """What its frames come by: `Video4Linux2`, `GigE Vision` or `USB3 Vision`."""
    unusable: str | None = None
    """Why no frames can be had of it; null where they can."""


class CameraView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The camera as a caller sees it."""

    driver: str
    """Driver's name."""
    fault: str | None = None
    """Why not."""
    frame_age_ms: float | None = None
    """Age of the newest frame when this was said, ms."""
    frame_seq: int | None = None
    """Sequence number of the newest frame."""
    frames_damaged: int
    """Frames that came damaged so far: none of them is shown or measured."""
    frames_lost: int
    """Frames lost so far, damaged ones included."""
    identity: str
    """What the device says it is."""
    notes: list[str]
    """What is to be known about its frames, one sentence each: a clock that lies, pixels saturated."""
    online: bool
    """Whether frames arrive."""
    replay: bool
    """Whether recorded frames are played from files: nothing that is seen is happening now."""
    unfit: str | None = None
    """Why none of its frames is measured, however many arrive: no job but homing begins."""


class ClarityThen(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """How clear the picture was."""

    at: datetime
    """When the frame was taken, RFC 3339."""
    eog: float | None = None
    """Energy of gradient of the central view, mean per pixel; absent where no view could be made."""


class ConfigCheck(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What is wrong with a configuration."""

    notices: list[str]
    """What is allowed and yet worth a word."""
    problems: list[ConfigFault]
    """Everything that is wrong."""
    valid: bool
    """Whether it could be written."""


class ConfigFault(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Something that is wrong with a configuration."""

    key: str
    """The key, dotted from the root."""
    message: str
    """What is wrong, and what would be right."""


class ConfigRequest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A configuration to be written."""

    config: configuration.Config
    """Every key of the file with its value, as `stored` has it; a key left out gets its default."""


class ConfigTried(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What may be a configuration."""

    config: Any
    """Anything: the answer says what is wrong with it."""


class ConfigView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The configuration in force and where it came from."""

    config: Any
    """The configuration in force: every key of the file with its value, defaults filled in, secrets redacted."""
    fault: str | None = None
    """Why the file cannot be read now, in words; absent where it can, or there is none."""
    file: str | None = None
    """The file read, if any."""
    locked: list[str]
    """Keys, with all below them, that are changed only on the machine itself."""
    origin: str
    """Where the design's numbers come from."""
    restart_required: list[str]
    """Keys of the file that take effect when the daemon starts again."""
    stored: Any = None
    """What the file holds now, likewise: the base of a change. Absent where there is no file that can be read."""


class ConfigWritten(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What has been written."""

    changed: list[str]
    """The keys that have changed in the file."""
    notices: list[str]
    """What is allowed and yet worth a word."""
    restart_required: list[str]
    """Keys of the file that take effect when the daemon starts again; nothing takes effect before."""


class ConfirmKeyGrant(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A job's confirm key, just made. Told here once."""

    confirm_key: str
    """The key."""
    job: UUID
    """The job's id."""


class ConfirmRequest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A confirmation of an operator step."""

    step: int
    """Number of the step that has been carried out: a late confirmation of an earlier step is refused."""


class ControlName(str, Enum):
    """Which of a camera's controls."""

    EXPOSURE = "exposure"
    GAIN = "gain"


class ControlRequest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a control of the camera is to be."""

    value: float
    """The value, in the control's unit. The camera is set to the nearest that it takes, which the answer has."""


class ControlUnit(str, Enum):
    """What a control's numbers are."""

    MS = "ms"
    FACTOR = "factor"
    DB = "db"
    DRIVER = "driver"


class CurvePoint(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A place of a curve."""

    position_mm: float
    """Position of the axis, mm."""
    value: float
    """The curve there, in the unit of what it goes through."""


class DepthFigures(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What is known about all micro-images together."""

    array: str
    """`square` or `hexagonal`."""
    distance_mm: Spread | None = None
    """Distances along the axis, mm; absent without a pose."""
    frame_px: list[int]
    """Columns and rows of the frame."""
    inferred: int
    """Of them with a spacing from those around them."""
    measured: int
    """Of them with a spacing from their own texture."""
    micro_image_pitch_px: float
    """Distance of neighbouring micro-images, px."""
    micro_images: int
    """Micro-images wholly within the frame."""
    patch_px: Spread | None = None
    """Sizes of the patches that a view takes, px."""
    spacing_px: Spread | None = None
    """Spacings, px; absent where none is known."""
    ssim_mean: float
    """Structural similarity of the micro-images' patches with the matching content of their neighbours, mean, −1 to
    1.
    """
    unknown: int
    """Of them about which nothing can be known."""
    virtual_depth: Spread | None = None
    """Virtual depths a/b."""


class DepthOfFieldView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Object distances in water between which the picture is sharp."""

    far_mm: float | None = None
    """Furthest, mm from the shell's outer vertex; null for infinity."""
    near_mm: float
    """Nearest, mm from the shell's outer vertex."""


class DepthState(str, Enum):
    """Where a micro-image's spacing comes from."""

    MEASURED = "measured"
    INFERRED = "inferred"
    UNKNOWN = "unknown"


class DesignView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Everything that the configured design comes to."""

    air: AirDesignView
    """The air design."""
    blur_limit_px: float
    """Diameter of the blur disc still called sharp, px."""
    clarity: SolutionView
    """Clarity optimisation: Δv for the initial e (Eq. 8)."""
    depth_of_field: DepthOfFieldView | None = None
    """Depth of field at the joint solution; null where nothing is sharp."""
    depth_resolution_mm: list[float]
    """Depth for half a pixel of parallax of the air design in air, mm: between adjacent lenses, and between lenses
    three pitches apart, as the paper's figure is.
    """
    depth_resolution_water_mm: list[float]
    """The same in water at the joint solution, mm."""
    direct: DirectView
    """The shell added directly."""
    e_max_mm: float
    """Greatest e that keeps the shell's rim out of the picture's corners, mm."""
    e_tolerance: Interval
    """e values between which the blur stays within the limit at the joint solution, Δv held."""
    fov_optimal_e_mm: float
    """FOV optimisation (Eq. 13): the e that keeps the field of view, mm."""
    joint: SolutionView
    """Joint optimisation: e of the FOV optimisation and the Δv that belongs to it."""
    mla: MlaView
    """The microlens array."""
    notices: list[str]
    """What is allowed and yet worth a word, one sentence each."""
    origin: str
    """Where the design's numbers come from."""
    spacing_target_px: float
    """Spacing in focus (Eq. 16), px."""
    water_refractive_index: float
    """Refractive index of the water, relative to air."""


class DevicesFound(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What is connected to the daemon's machine."""

    cameras: list[CameraFound]
    """Cameras, as `plenalign camera list` has them."""
    notes: list[str] | UnsetType = UNSET
    """What could not be looked at, and why, one sentence each: an interface of `bench.camera.interfaces` that is
    not there, or more cameras than are read at once.
    """
    serial_ports: list[PortFound]
    """Serial ports."""


class DirectView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The air design with the shell added at the initial e and nothing optimised."""

    e_mm: float
    """e, mm."""
    fov_water_deg: float | None = None
    """Field of view in water over the sensor's width, degrees; null where the shell's rim cuts it."""
    half_width_mm: float | None = None
    """Half the width of board seen at the object distance in water, mm; null as for `fov_water_deg`."""


class DiskFaults(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What goes wrong with the disk that the history is written to."""

    delay_ms: int | UnsetType = UNSET
    """How much longer than it should everything takes that is written, ms of real time."""
    full: bool | UnsetType = UNSET
    """Nothing more can be written."""


class DraftBase(str, Enum):
    """What a draft's keys are laid over."""

    IN_FORCE = "in_force"
    PRESET = "preset"


class DraftRequest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A draft of a camera: sections of the configuration with the keys that are to be otherwise. `water`, where it
    is there, stands alone, its keys being alternatives.
    """

    assembly: configuration.AssemblyConfig | UnsetType = UNSET
    """How the camera is put together, and to which tolerances."""
    base: DraftBase | UnsetType = UNSET
    """What they are laid over."""
    boards: configuration.BoardsConfig | UnsetType = UNSET
    """Which boards there are in air."""
    main_lens: configuration.MainLensConfig | UnsetType = UNSET
    """The main lens."""
    mla: configuration.MlaConfig | UnsetType = UNSET
    """The microlens array."""
    object: configuration.ObjectConfig | UnsetType = UNSET
    """The object distances."""
    sensor: configuration.SensorConfig | UnsetType = UNSET
    """The sensor."""
    shell: configuration.ShellConfig | UnsetType = UNSET
    """The spherical shell."""
    water: configuration.WaterConfig | UnsetType = UNSET
    """The water."""


class DraftStateName(str, Enum):
    """Which of a camera's states."""

    REFERENCE = "reference"
    DIRECT = "direct"
    CLARITY = "clarity"
    JOINT = "joint"


class DraftStateView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A camera's state and what it comes to."""

    aperture_mm: float
    """Aperture diameter, mm."""
    aperture_ring_f_number: float
    """The number on the lens's ring: focal length over aperture diameter."""
    blur_px: float
    """Diameter of the blur disc of the object at its distance, px."""
    board_width_mm: float | None = None
    """Width of board seen at the object distance, mm; null likewise."""
    delta_v_mm: float
    """Δv, mm: positive where MLA and sensor move away from the lens."""
    depth_of_field: DepthOfFieldView | None = None
    """Between which distances it is sharp; null where nothing is."""
    e_mm: float | None = None
    """e, mm: positive where the lens is behind the shell's centre; null in air."""
    e_tolerance: Interval | None = None
    """Values of e between which the object stays sharp, Δv held; null in air, and where no e makes it sharp."""
    fov_deg: float | None = None
    """Field of view over the sensor's width, degrees, in air for the air design and in water for the rest; null
    where the shell's rim cuts it.
    """
    image_distance_mm: float | None = None
    """Where the object is focused, mm from the main lens; null where nowhere."""
    lens_to_mla_mm: float
    """From the main lens to the MLA, mm."""
    rays: list[RayView]
    """Rays of three points of the object, three each, as far as light comes that way."""
    reoptimise: ReoptimiseView | None = None
    """When Δv has to be re-optimised; null where nothing is sharp."""
    state: DraftStateName
    """Which state."""


class DraftView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a draft comes to."""

    config: dict[str, Any]
    """The camera's sections of the configuration with every value, those left out filled in."""
    design: DesignView
    """The design's figures."""
    obstacles: list[ObstacleView]
    """Why this bench could not align this camera; empty where it could."""
    over_distance: OverDistanceView
    """Blur over the object distance."""
    over_e: OverEView
    """Δv and field of view over e."""
    states: list[DraftStateView]
    """The camera's states: air design, shell added directly, clarity, joint."""


class EndedHow(str, Enum):
    """How a token has ended."""

    REVOKED = "revoked"
    EXPIRED = "expired"


class EndedView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Why a token, or a session that was opened with it, opens nothing any more."""

    at: datetime
    """When, RFC 3339."""
    by: str | None = None
    """Who revoked it; `null` where it was done on the daemon's machine, and where it has expired."""
    how: EndedHow
    """How it has ended."""
    name: str
    """Name of the token."""


class ExpectedBudget(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What is to be expected with all that is taken for granted."""

    delta_v_sigma_mm: float
    """Standard uncertainty of Δv, mm."""
    e_held_off_mm: float
    """By how much e stays further from the shell than it is aimed at, mm: three of its standard uncertainties lie
    between the lens and where it touches, which is l_bound less `assembly.clearance_mm`.
    """
    e_sigma_mm: float
    """The same of e, mm."""


class FaultEvent(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Something that goes wrong for a while."""

    at_s: float
    """When it begins, s after the plan was put in force."""
    faults: Faults
    """What goes wrong; what is not named is left as it is."""
    lasts_s: float | None = None
    """How long it lasts, s; without, to the end."""


class FaultPlan(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What is to go wrong with a simulated bench, and when. Counted from the moment at which the plan is put in
    force, in the bench's own time.
    """

    events: list[FaultEvent]
    """What happens, in any order. Where events overlap, everything that any of them names goes wrong; of two that
    name the same, the later one counts.
    """


class Faults(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Everything that goes wrong with a simulated bench at a time. By default nothing; what is not named goes
    right.
    """

    camera: CameraFaults | UnsetType = UNSET
    """The camera."""
    disk: DiskFaults | UnsetType = UNSET
    """The disk that the history is written to."""
    e: AxisFaults | UnsetType = UNSET
    """The e axis."""
    focus: AxisFaults | UnsetType = UNSET
    """The focus axis."""
    scene: SceneFaults | UnsetType = UNSET
    """What stands before the camera."""
    serial: SerialFaults | UnsetType = UNSET
    """The stages' controller, and the wire to it."""


class FittedPlace(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A place of the swept axis, by a curve fitted to what was seen."""

    curve: list[CurvePoint]
    """The curve, over those."""
    points: int
    """Points that the curve goes through."""
    position_mm: float
    """Position of the axis, mm."""
    sigma_mm: float
    """Its standard uncertainty, by the points' own or by their scatter about the curve, whichever is greater, mm; a
    peak's with what the curve's shape may be other than a peak's.
    """


class Health(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Whether the daemon answers."""

    boot_id: UUID
    """Identity of this run of the program."""
    simulated: bool
    """Whether the bench is simulated."""
    status: str
    """Always `ok`: what does not answer says nothing."""
    version: str
    """Version of the program."""


class HistogramView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """How many pixels of a raw frame have which grey level: all of them, at the sensor's full depth; of a mosaic
    all colours together.
    """

    bits: int
    """Significant bits of a sample."""
    black_share: float
    """Share of the pixels at level 0: darker they cannot be."""
    captured_at: datetime
    """End of its exposure, RFC 3339."""
    clipped_from: int
    """From which level on a pixel is clipped: within 2 % of white, which is the greatest level, or 235 of video
    levels.
    """
    clipped_share: float
    """Share of the pixels that are clipped: they may have got more light than they can tell."""
    counts: list[int]
    """Pixels in each range, darkest first."""
    frame_age_ms: float
    """Age of the frame when this was said, ms."""
    frame_seq: int
    """Sequence number of the frame."""
    levels_per_range: int
    """Grey levels in each range but the last, which may have fewer."""
    overexposed: bool
    """Whether that is too much: more than hot pixels and mirrored lamps make up."""
    replayed: bool
    """Whether the frame was recorded earlier and is played from a file."""
    simulated: bool
    """Whether the frame was simulated."""


class InView(str, Enum):
    """What stands before the lens, as far as the program knows."""

    UNKNOWN = "unknown"
    FLAT_BOARD = "flat_board"
    STEPPED_BOARD = "stepped_board"
    BOARD_ELSEWHERE = "board_elsewhere"
    OTHER = "other"


class Interval(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Near and far end of an interval; `null` for infinity."""

    high_mm: float | None = None
    """Upper end, mm."""
    low_mm: float | None = None
    """Lower end, mm."""


class Iteration(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One iteration: where the axes were, what was measured, what was decided."""

    at: datetime
    """When, RFC 3339."""
    axis: AxisName | None = None
    """Axis moved, if any."""
    decision: str
    """What was decided, in a sentence."""
    delta_v_mm: float | None = None
    """Δv (air step: measured as v_ADJ − v; shell step: as the air step left it and trims changed it), mm."""
    delta_v_sigma_mm: float | None = None
    """Its standard uncertainty, mm."""
    delta_v_target_mm: float | None = None
    """Δv wanted, mm (air step)."""
    discarded: bool | UnsetType = UNSET
    """Whether it counts no more: a step that had begun before was asked for again after it."""
    e_estimate_mm: float | None = None
    """e as the picture has it (shell step), mm."""
    e_estimate_sigma_mm: float | None = None
    """Its standard uncertainty, mm."""
    e_mm: float | None = None
    """Readback of the e axis, mm; `null` while unknown."""
    eog: float | None = None
    """EOG of the central view (Eq. 20), mean per pixel; `null` where no view was made."""
    focus_mm: float | None = None
    """Readback of the focus axis, mm; `null` while unknown."""
    kind: IterationKind
    """Why it moved, or did not."""
    number: int
    """Counted from 1 over the job."""
    spacing: SpacingReading
    """The spacing measured: on the flat board, or on the middle level of the triple-level board."""
    spacing_predicted_px: float | None = None
    """The spacing predicted for this pose before the move, px."""
    spacing_target_px: float
    """The spacing wanted, px."""
    stage: Stage
    """Part of the alignment."""


class IterationKind(str, Enum):
    """Why an iteration moved, or did not."""

    START = "start"
    PROBE = "probe"
    MOVE = "move"
    VERIFY = "verify"
    SAMPLE = "sample"


class JobExport(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Everything that is kept of a job."""

    exported_at: datetime
    """When this document was made, RFC 3339."""
    format: str
    """Always `plenalign-job`."""
    job: JobSnapshot
    """The job."""
    measurements: list[MeasurementView]
    """What was measured, in order."""
    moves: list[Move]
    """What was moved, in order."""
    operator_steps: list[AskedStep]
    """What the operator was asked to do, in order."""
    pictures: list[PictureExport]
    """The pictures kept with it."""
    request: dict[str, Any]
    """What was asked for."""
    run: RunView | None = None
    """The run of the program that it belongs to, with its configuration."""
    simulated: bool
    """Whether the bench was simulated: then nothing in here was measured on a real camera."""
    version: int
    """Version of this document's layout."""


class JobIterations(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A job's iterations."""

    iterations: list[Iteration]
    """What was measured and decided, in order."""


class JobKind(str, Enum):
    """What a job is to do."""

    JOINT_ALIGNMENT = "joint_alignment"
    AIR_ONLY = "air_only"
    SHELL_ONLY = "shell_only"
    CLARITY_ONLY = "clarity_only"
    L_BOUND_MEASUREMENT = "l_bound_measurement"
    FOCUS_SWEEP = "focus_sweep"
    SPACING_WATCH = "spacing_watch"
    CALIBRATION = "calibration"
    HOMING = "homing"


class JobList(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A page of the jobs."""

    history_fault: str | None = None
    """Why the jobs of earlier runs are missing; `null` where they are not."""
    jobs: list[JobItem]
    """The jobs, newest first."""
    next: str | None = None
    """What to give as `cursor` for the next, older page; `null` on the last one."""


class JobLog(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A job's log."""

    lines: list[LogLine]
    """What happened, in order."""


class JobMeasurements(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A job's measurements."""

    measurements: list[MeasurementView]
    """What was measured, in order."""


class JobMoves(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A job's moves."""

    moves: list[Move]
    """What was moved, in order."""


class JointAlignmentJob(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="joint_alignment"):
    """`joint_alignment`: What a caller asks for with a job. What a kind does not take is refused."""

    note: str | None = None
    """What it is for, in the caller's words."""
    record: bool | None = None
    """Whether it is recorded; as `record.jobs` of the configuration has it where it is not given."""


class AirOnlyJob(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="air_only"):
    """`air_only`: What a caller asks for with a job. What a kind does not take is refused."""

    note: str | None = None
    """What it is for, in the caller's words."""
    record: bool | None = None
    """Whether it is recorded; as `record.jobs` of the configuration has it where it is not given."""


class ShellOnlyJob(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="shell_only"):
    """`shell_only`: What a caller asks for with a job. What a kind does not take is refused."""

    note: str | None = None
    """What it is for, in the caller's words."""
    record: bool | None = None
    """Whether it is recorded; as `record.jobs` of the configuration has it where it is not given."""


class ClarityOnlyJob(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="clarity_only"):
    """`clarity_only`: What a caller asks for with a job. What a kind does not take is refused."""

    e_mm: float | None = None
    """The e to hold, mm (clarity only); the configured initial e where it is not given."""
    note: str | None = None
    """What it is for, in the caller's words."""
    record: bool | None = None
    """Whether it is recorded; as `record.jobs` of the configuration has it where it is not given."""


class LBoundMeasurementJob(
    Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="l_bound_measurement"
):
    """`l_bound_measurement`: What a caller asks for with a job. What a kind does not take is refused."""

    note: str | None = None
    """What it is for, in the caller's words."""
    record: bool | None = None
    """Whether it is recorded; as `record.jobs` of the configuration has it where it is not given."""


class FocusSweepJob(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="focus_sweep"):
    """`focus_sweep`: What a caller asks for with a job. What a kind does not take is refused."""

    axis: AxisName
    """The axis to move (focus sweep)."""
    distance_mm: float | None = None
    """Distance of the board's middle from the lens's principal point in air, mm (calibration, focus sweep); where
    the joint solution has it unless given.
    """
    from_mm: float
    """Where the sweep begins, mm (focus sweep)."""
    note: str | None = None
    """What it is for, in the caller's words."""
    record: bool | None = None
    """Whether it is recorded; as `record.jobs` of the configuration has it where it is not given."""
    steps: int | None = None
    """Positions measured, both ends included (focus sweep); 11 where it is not given."""
    to_mm: float
    """Where it ends, mm (focus sweep)."""


class SpacingWatchJob(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="spacing_watch"):
    """`spacing_watch`: What a caller asks for with a job. What a kind does not take is refused."""

    duration_s: float
    """For how long, s (spacing watch)."""
    interval_s: float | None = None
    """Between two measurements, s (spacing watch); 1 where it is not given, and longer where more than 500
    measurements would be made.
    """
    note: str | None = None
    """What it is for, in the caller's words."""
    record: bool | None = None
    """Whether it is recorded; as `record.jobs` of the configuration has it where it is not given."""


class CalibrationJob(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="calibration"):
    """`calibration`: What a caller asks for with a job. What a kind does not take is refused."""

    distance_mm: float | None = None
    """Distance of the board's middle from the lens's principal point in air, mm (calibration, focus sweep); where
    the joint solution has it unless given.
    """
    note: str | None = None
    """What it is for, in the caller's words."""
    record: bool | None = None
    """Whether it is recorded; as `record.jobs` of the configuration has it where it is not given."""


class HomingJob(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="homing"):
    """`homing`: What a caller asks for with a job. What a kind does not take is refused."""

    axes: list[AxisName] | None = None
    """The axes to home (homing); both where it is not given."""
    note: str | None = None
    """What it is for, in the caller's words."""
    record: bool | None = None
    """Whether it is recorded; as `record.jobs` of the configuration has it where it is not given."""


class JobSnapshot(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Everything about a job at one moment."""

    created_at: datetime
    """When it was accepted, RFC 3339."""
    ended_at: datetime | None = None
    """When it ended, RFC 3339."""
    generation: int
    """Grows with every change of this snapshot."""
    id: UUID
    """Identity, a UUID of version 7."""
    iterations: list[Iteration]
    """What was measured, in order."""
    kind: JobKind
    """What it does."""
    log: list[LogLine]
    """What happened, in order."""
    operator_step: OperatorStep | None = None
    """What the operator is asked to do now."""
    outcome: Outcome | None = None
    """What a job that is no alignment came to, once it has."""
    owner: str | UnsetType = UNSET
    """Who started it: the owner of the control lease that it holds until its end. Empty where the version that ran
    it knew no owners.
    """
    progress: Progress
    """How far it is."""
    reason: str | None = None
    """Why it ended as it did, in words, once it has."""
    recording: Recording | None = None
    """Its recording; `null` where it is not recorded."""
    report: Report | None = None
    """The report of an alignment, once it has ended."""
    request: JobRequest
    """As it was asked for."""
    simulated: bool
    """Whether the bench is simulated."""
    stage: Stage
    """Part of the alignment it is in."""
    state: JobState
    """Where it is in its life."""
    steps: list[JobStep] | UnsetType = UNSET
    """Its steps: done, under way, and still to come where that can be told."""


class JobState(str, Enum):
    """Where a job is in its life."""

    PENDING = "pending"
    RUNNING = "running"
    WAITING_FOR_OPERATOR = "waiting_for_operator"
    CANCELLING = "cancelling"
    CONVERGED = "converged"
    SUCCEEDED = "succeeded"
    NOT_CONVERGED = "not_converged"
    CANCELLED = "cancelled"
    FAILED = "failed"
    INTERRUPTED = "interrupted"


class JobStep(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A step of a job: something is set up, and the bench works with it until the next is asked for."""

    because: str | None = None
    """Why the job itself asks for that step again, in words."""
    began_at: datetime | None = None
    """When it began, RFC 3339; `null` where it is still to come."""
    bench_s: float | None = None
    """How long the bench worked on it, s; `null` until it is over."""
    name: str
    """`preparation` (devices are read, and axes homed where it is needed), `homing`, `measuring`, or the name of
    the operator's step that it begins with, e.g. `white_frame`.
    """
    number: int | None = None
    """Number of the operator's step that it begins with; `null` where it begins with none, or is still to come."""
    operator_s: float | None = None
    """How long the operator took for it, s; `null` until it is over."""
    repeats: int | None = None
    """Number of the earlier step that it takes the place of."""
    setup: Setup | None = None
    """What is set up; `null` where nothing is."""
    state: StepState
    """Where it is."""
    value: str | None = None
    """The value to be set, with its unit; `null` where there is none."""


class JobSummary(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A job in a list."""

    created_at: datetime
    """When it was accepted, RFC 3339."""
    ended_at: datetime | None = None
    """When it ended, RFC 3339."""
    generation: int
    """Grows with every change of the job."""
    id: UUID
    """Identity, a UUID of version 7."""
    iterations: int
    """How many iterations it has."""
    kind: JobKind
    """What it does."""
    note: str | None = None
    """What it is for, in its caller's words; `null` where nothing was said."""
    owner: str | UnsetType = UNSET
    """Who started it; empty where the version that ran it knew no owners."""
    progress: Progress
    """How far it is."""
    reason: str | None = None
    """Why it ended as it did, in words, once it has."""
    recording: Recording | None = None
    """Its recording; `null` where it is not recorded."""
    simulated: bool
    """Whether the bench is simulated."""
    stage: Stage
    """Part of the alignment it is in."""
    state: JobState
    """Where it is in its life."""


class JogRequest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A jog of one axis."""

    press: str | None = None
    """A name of the caller's own for this press of the button, another one for each: one that a stop, another press
    or its own end has ended is refused from then on, so that no word that comes late, and no button held down
    all the while, moves the axis again.
    """
    speed_mm_per_s: float | None = None
    """How fast, mm/s; the axis's greatest speed where it is not given."""
    towards: Side
    """Which way: towards smaller or larger positions."""


class LeaseAsked(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Who asks for the control lease."""

    note: str | None = None
    """What for."""
    owner: str
    """Who: shown to everybody who asks for it meanwhile."""
    ttl_s: float | None = None
    """Time to live from a heartbeat, s; 30 where it is not given."""


class LeaseGrant(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A lease just granted."""

    key: str
    """What shows that a request comes from the holder. Said once, to the holder alone."""
    lease: LeaseView
    """The lease."""


class LeaseState(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Who has the control lease."""

    lease: LeaseView | None = None
    """The lease; `null` while nobody has it."""


class LeaseView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A lease as anybody may see it."""

    expires_at: datetime | None = None
    """When it runs out unless it is renewed, RFC 3339; absent while a job or a connection holds it."""
    id: UUID
    """Identity of this lease."""
    job: UUID | None = None
    """The job that holds it until its end."""
    note: str | None = None
    """What for, in the owner's words."""
    owner: str
    """Who holds it."""
    since: datetime
    """Since when, RFC 3339."""
    ttl_s: float
    """Time to live from a heartbeat, s."""


class LeaveSwitchRequest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Which limit switch of an axis is pressed."""

    pressed: Side
    """The end of travel whose switch is pressed, as seen on the bench: the axis moves away from it."""


class LensFigures(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What is known about one micro-image."""

    centre_px: list[float]
    """Centre, px of the raw frame."""
    distance_mm: float | None = None
    """Distance along the axis, mm; `null` where unknown, or without a pose."""
    index: list[int]
    """Lattice indices."""
    sigma_px: float | None = None
    """Its standard uncertainty, px; `null` where unknown."""
    spacing_px: float
    """Spacing, px; where unknown a guess."""
    ssim: float
    """Structural similarity with the matching content of its neighbours, −1 to 1."""
    state: DepthState
    """Where the spacing comes from."""
    virtual_depth: float | None = None
    """a/b; `null` where unknown."""


class LightControl(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A control of a camera."""

    automatic: bool
    """Whether the camera adjusts it by itself."""
    default: float
    """What it is without anybody's doing."""
    key: str
    """What the camera calls it: its key in `[bench.camera.controls]`."""
    locked: str | None = None
    """Why it cannot be set; null where it can."""
    maximum: float
    """Greatest value."""
    minimum: float
    """Least value."""
    name: ControlName
    """Which it is."""
    step: float
    """Between values, counted from the least."""
    unit: ControlUnit
    """What value and limits are."""
    value: float | None = None
    """The value now; null where it cannot be read."""


class LightView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What the camera's pictures are exposed by."""

    controls: list[LightControl]
    """Exposure and gain, as far as the camera has them; empty where it has neither."""
    job: UUID | None = None
    """The job that keeps them from being set until its end; null where none does."""
    white_frame: bool
    """Whether a white frame was taken with the camera set as it is: what is measured rests on it, and a change of a
    control drops it.
    """


class LogLine(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A line of a job's log."""

    at: datetime
    """When, RFC 3339."""
    message: str
    """What happened."""


class Measure(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The figure that a job brings to its target."""

    name: str
    """`delta_v_mm` or `spacing_px`; at the end of a calibration `delta_v_mm`, of a sweep `best_focus_mm` (a reading
    of the focus axis) or `best_focus_e_mm` (one of the e axis), and of a measurement of l_bound `l_bound_mm`.
    """
    sigma: float
    """The standard uncertainty of that."""
    target: float | None = None
    """What it is to be; `null` where nothing is aimed for."""
    value: float
    """Its newest value."""


class MeasurementAsked(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Which frame is to be measured."""

    max_age_ms: int | None = None
    """How long ago the frame's exposure may have begun, ms; where it is not given, it begins after the request."""
    settled: bool | UnsetType = UNSET
    """Whether the frame has to be exposed wholly while both axes stood settled. Where it was not, the answer is 409
    with the problem `spans-motion`; with `false` it is measured all the same and `spans_motion` says so.
    """


class MeasurementList(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A page of the measurements that belong to no job."""

    measurements: list[SingleMeasurement]
    """What was measured, newest first."""
    next: str | None = None
    """What to give as `cursor` for the next, older page; `null` on the last one."""


class MeasurementView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The newest measurement of the live picture or of a job."""

    captured_at: datetime
    """When the frame was taken, RFC 3339."""
    e_mm: float | None = None
    """Readback of the e axis, mm."""
    eog: float | None = None
    """Energy of gradient of the central view, mean per pixel."""
    eog_sum: float | None = None
    """Energy of gradient of the central view, sum over its pixels (Eq. 20): it grows with the picture."""
    focus_mm: float | None = None
    """Readback of the focus axis, mm."""
    frame_seq: int
    """Sequence number of the frame measured."""
    in_focus: bool
    """|spacing − target| within the blur limit, of one board."""
    micro_image_pitch_px: float
    """Pitch of the micro-images found, px."""
    micro_image_pitch_sigma_px: float | None = None
    """Its standard uncertainty, px; null in measurements of versions that did not tell it."""
    settled: bool
    """Whether both axes were settled during the whole exposure."""
    spacing: SpacingReading
    """The spacing."""
    spacing_target_px: float
    """The spacing wanted, px."""
    spacing_target_source: TargetSource | UnsetType = UNSET
    """What says so; a measurement of a version that did not tell has Eq. 16's."""
    spacing_tolerance_px: float | None = None
    """By how much the spacing may be off that where a job accepts it, px; null in measurements of versions that did
    not tell it.
    """
    ssim: float | None = None
    """Structural similarity of the micro-images' patches with the matching content of their neighbours, mean, −1 to
    1.
    """
    two_boards: TwoBoardsView | None = None
    """The two boards that the frame shows, where it does: the spacing then is neither's."""


class Medium(str, Enum):
    """What is before the camera."""

    AIR = "air"
    WATER = "water"


class MlaView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The microlens array at the design point."""

    a_mm: float
    """a, mm, reported positive in both modes."""
    b_mm: float
    """b, mm."""
    f_number: float
    """b over the pitch."""


class Move(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A motion of one axis."""

    axis: str
    """Which axis."""
    end_mm: float | None = None
    """Readback at its end, mm; `null` where unknown."""
    ended_at: datetime | None = None
    """When it was over, RFC 3339; `null` until then, and where the program ended first."""
    from_mm: float | None = None
    """Where it began, mm; `null` while unknown."""
    id: UUID
    """Identity."""
    job: UUID | None = None
    """The job that commanded it; `null` for a motion by hand."""
    outcome: str | None = None
    """`done`, or why it did not end as commanded; `interrupted` where the program ended first; `null` until then."""
    started_at: datetime
    """When it was commanded, RFC 3339."""
    to_mm: float | None = None
    """Where it was to end, mm; `null` for a motion without a target."""
    what: str
    """`move`, `home`, `jog`, `release` or `leave switch`."""


class MoveRequest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A move of one axis."""

    position_mm: float
    """Where to, in the axis's own coordinate, mm."""


class Obstacle(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A key of the configuration, or what was asked for, that keeps an alignment from its end."""

    key: str
    """The key, dotted, or the request's `e_mm`."""
    needed: str
    """What it would have to be, in words."""
    value: str
    """Its value now, in words."""
    why: str
    """Why, in a sentence."""


class ObstacleView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Something that keeps a draft from being the bench's camera."""

    key: str
    """The key of the configuration, dotted from the root."""
    message: str
    """What is in the way."""


class OperatorStep(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What the operator is asked to do."""

    because: str | None = None
    """Why the job itself asks for that step again, in words: what came of it could not be used."""
    instruction: str
    """What to do, in full sentences with the number that matters."""
    name: str
    """Short name, e.g. `white_frame`."""
    number: int
    """Number of the step within its job, to be named when confirming."""
    repeatable: list[int] | UnsetType = UNSET
    """Numbers of the earlier steps that can be asked for again in place of confirming this one."""
    repeats: int | None = None
    """Number of the earlier step that it takes the place of, where that was asked for again."""
    value: str | None = None
    """The number that matters, with its unit, large on the page; e.g. `159.2, 167.2, 175.2 mm`."""


class HomingOutcome(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="homing"):
    """Where the axes stand after homing."""

    e_mm: float | None = None
    """Readback of the e axis, mm; `null` while unknown."""
    focus_mm: float | None = None
    """Readback of the focus axis, mm; `null` while unknown."""


class CalibrationOutcome(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="calibration"):
    """The camera as a triple-level board has it."""

    delta_v_mm: float
    """Δv, mm: d + N b less the air design's v."""
    distances_mm: list[float]
    """Distances of the board's levels from the lens's principal point, mm."""
    image_distance_mm: float
    """d + N b, mm."""
    image_distance_sigma_mm: float
    """Its standard uncertainty, mm."""
    lens_to_mla_mm: float
    """d, mm."""
    mla_to_sensor_mm: float
    """b, mm."""


class LBoundOutcome(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="l_bound"):
    """The least e that the lens's barrel allows."""

    e_wall_mm: float
    """The e wall that follows, mm."""
    l_bound_mm: float
    """l_bound, clearance included, mm."""
    sigma_mm: float
    """Standard uncertainty of the e at which the lens touches, with all that is taken for granted, mm."""


class FocusSweepOutcome(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="focus_sweep"):
    """The spacing against an axis's position."""

    axis: AxisName
    """The axis swept."""
    best_focus: FittedPlace | None = None
    """Best focus: where a curve through all spacings, px, meets the target; `null` where it does not, or there are
    too few.
    """
    crossing_mm: float | None = None
    """Where the spacing meets its target, between two neighbours, mm; `null` where it does not."""
    crossing_sigma_mm: float | None = None
    """Its standard uncertainty by the spacings' own and by how they bend between the two, mm."""
    eog_peak: FittedPlace | None = None
    """Where a curve about the greatest EOGs is greatest; `null` where they have no peak. It is not where the
    spacing meets its target: how sharp a view looks depends on how it is put together, too.
    """
    measured: int
    """Positions at which a spacing was measured: the job's iterations have them."""
    positions: int
    """Positions asked for."""
    slope_px_per_mm: float | None = None
    """The spacing's change at best focus, px per mm: the curve's, or that between the two neighbours where there is
    no curve; `null` where there is neither.
    """


class SpacingWatchOutcome(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="spacing_watch"):
    """The spacing over time."""

    drift_px_per_h: float
    """That line's slope, px per hour."""
    drift_sigma_px_per_h: float | None = None
    """Its standard uncertainty by the scatter about the line, px per hour; `null` where too little was measured to
    tell.
    """
    greatest_px: float
    """Greatest spacing, px."""
    least_px: float
    """Least spacing, px."""
    mean_px: float
    """Their mean, px."""
    measured: int
    """Measurements made: the job's iterations have them."""
    scatter_px: float
    """Their scatter about a straight line over time, px."""
    unmeasured: int | UnsetType = UNSET
    """How often there was nothing that could be measured: the job's log says why."""


class OverDistanceView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The blur over the object distance: of the air design in air from the lens, of the rest in water from the
    shell.
    """

    clarity_px: list[float | None]
    """Of the clarity solution, px."""
    direct_px: list[float | None]
    """Of the shell added directly, px."""
    distance_mm: list[float]
    """Object distance, mm."""
    joint_px: list[float | None]
    """Of the joint solution, px."""
    reference_px: list[float | None]
    """Diameter of the blur disc of the air design, px; null where nothing is imaged, here and below."""


class OverEView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Figures over e, with Δv re-optimised at each."""

    delta_v_mm: list[float | None]
    """Δv in focus, mm; null where nothing is imaged."""
    e_mm: list[float]
    """e, mm."""
    fov_deg: list[float | None]
    """Field of view in water over the sensor's width, degrees; null where the shell's rim cuts it."""


class PictureExport(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A picture kept with a job."""

    at: datetime
    """When it was taken, RFC 3339."""
    data: str
    """The picture as a `data:` URI."""
    name: str
    """Which one: `before` the first move with the shell, or `after` the last."""


class PictureFault(str, Enum):
    """What is wrong with a camera's pictures."""

    NONE = "none"
    DARK = "dark"
    SATURATED = "saturated"
    BLURRED = "blurred"
    TORN = "torn"


class PlanInForce(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The plan of faults in force."""

    elapsed_s: float | None
    """For how long it has been in force, s."""
    plan: FaultPlan | None
    """The plan; `null` where none is."""


class PlanView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a joint alignment will do, worked out before anything moves."""

    aberrations_px: float
    """What the shell's aberrations add to the spacing in focus over the estimator's window, px."""
    assumed: str
    """What these assume, in words."""
    boards: list[PlannedBoard]
    """Those, from the nearest to the furthest."""
    boards_in_air: PlannedBoards
    """Which boards stand before the lens in air."""
    by_budget: ExpectedBudget | None = None
    """The same with all that is taken for granted; null where it cannot be worked out."""
    delta_v_mm: float
    """Δv aimed at, mm."""
    delta_v_sigma_mm: float
    """The same of Δv by the picture alone, mm."""
    delta_v_tolerance_mm: float
    """Tolerance of Δv, mm."""
    duration_s: float
    """How long it takes besides the operator, about, s: as the newest such jobs of this bench took, where it is for
    the configuration in force and there are any.
    """
    e_above_mm: float
    """By how much e may end above what is aimed at even so, mm: the e axis's reading does not pass the wall,
    however far its zero and scale are off. Δv is trimmed for the e that there is then, and the picture is as
    sharp.
    """
    e_mm: float
    """e aimed at, mm."""
    e_probe_mm: float
    """First move of the e axis, mm."""
    e_sigma_mm: float
    """The same of e by picture and axis, mm."""
    e_tolerance_mm: float
    """Tolerance of e, mm."""
    first_board_mm: float | None = None
    """Where the first board in air stands, mm: where the focus axis is after its homing, another may be in range."""
    focus_probe_mm: float
    """First move of the focus axis, mm."""
    mount_e_mm: float
    """e at which the shell is mounted, mm."""
    mount_spacing_px: float
    """Spacing through the shell there, px."""
    obstacles: list[Obstacle]
    """What does."""
    operator_steps: list[PlannedStep]
    """What the operator is asked to do."""
    origin: str
    """Where the design's numbers come from."""
    parts: list[PlannedJob]
    """What the kinds of job that are parts of an alignment, or its like, will ask and take."""
    possible: bool
    """Whether nothing stands in its way."""
    search_step_mm: float
    """From one place of the focus axis to the next, mm, where the picture is looked for that can be measured."""
    spacing_sigma_px: float
    """Standard uncertainty expected of a spacing, px."""
    spacing_target_px: float
    """Spacing aimed at in air, px."""
    spacing_tolerance_px: float
    """By how much the spacing may be off its target at the end, px."""


class PlannedBoard(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A board in air and what is to be seen of it at the solution's Δv."""

    distance_mm: float
    """From the main lens's principal point, mm."""
    spacing_px: float
    """Its spacing, px."""


class PlannedBoards(str, Enum):
    """Which boards a plan has in air."""

    TRIPLE_LEVEL = "triple_level"
    FLAT_IN_TURN = "flat_in_turn"


class PlannedJob(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a kind of job that goes by a plan will ask and take."""

    delta_v_mm: float
    """Δv aimed at, mm."""
    duration_s: float
    """How long it takes besides the operator, about, s: as the newest such jobs of this bench took, where it is for
    the configuration in force and there are any.
    """
    e_mm: float | None = None
    """e aimed at, mm; of a clarity job, the one that it holds where its request names none. Null where e is not
    aimed at.
    """
    kind: JobKind
    """Which kind."""
    obstacles: list[Obstacle]
    """What stands in its way; nothing does where it is empty."""
    operator_steps: list[PlannedStep]
    """What the operator is asked to do."""


class PlannedStep(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What the operator is asked to do, in the order of the job."""

    name: str
    """The step's name, as the job asks for it."""
    setup: Setup
    """What is set up."""
    value: str | None = None
    """The value to be set, with its unit; null where there is none."""


class PortFound(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A serial port that is there."""

    names: list[str]
    """What a controller's `port` can be to mean it, the steadiest name first."""
    path: str
    """Its device file."""
    product: str | None = None
    """What its USB device calls itself; null for what is no USB device."""


class PoseView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Where the camera was."""

    calibrated: bool
    """Whether Δv, d and b are those of an air step rather than of the design and the axis's zero."""
    delta_v_mm: float
    """Δv, mm: as the last air step calibrated it, or as the focus axis reads."""
    e_mm: float | None = None
    """e as the axis reads, mm; absent in air."""
    medium: Medium
    """What was before it. Distances count in water from the shell's outer vertex, in air from the main lens's
    principal point.
    """


class PositionsThen(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Where the axes stood."""

    at: datetime
    """When, RFC 3339."""
    e_mm: float | None = None
    """Readback of the e axis, mm; absent while unknown."""
    focus_mm: float | None = None
    """Readback of the focus axis, mm; absent while unknown."""


class Problem(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A problem as RFC 9457 has it, with members of its own beside the standard ones."""

    detail: str
    """What was wrong here, and what would be right."""
    status: int
    """The HTTP status."""
    title: str
    """The kind in words."""
    type: str
    """What kind of problem: `urn:plenalign:problem:` and a short name, stable."""


class Progress(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """How far a job is."""

    doing: str
    """What is being done, in words."""
    measure: Measure | None = None
    """The figure that is brought to its target; `null` before the first measurement."""
    of: int
    """Steps there will be, as far as can be told."""
    step: int
    """Steps done."""
    time_left_s: float | None = None
    """Time left when the step began, the operator's not counted, s: by how long this bench has taken for what was
    asked for. `null` where it has never done that, or has taken longer by now.
    """


class RayView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A ray: points from the sensor to the object, each as a distance along the axis from the main lens, positive
    towards the object, and one beside the axis, mm.
    """

    field: float
    """Where on the sensor its image lies: -1 and 1 are the edges, 0 the axis."""
    points_mm: list[list[float]]
    """The points."""


class Readiness(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """That the bench can be worked with."""

    ready: bool
    """Always true: what is not ready answers 503."""


class RecentView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The last two minutes, as far as somebody looked; oldest first."""

    clarities: list[ClarityThen]
    """In every frame measured in whole."""
    now: datetime
    """The daemon's clock when this was said, RFC 3339."""
    positions: list[PositionsThen]
    """Whenever the bench's state changed: between two, the axes stood where the former says, or moved to the
    latter.
    """
    spacings: list[SpacingThen]
    """In every frame read, at most four a second; where none was read, in those measured in whole. Of several
    levels, or two boards, there are none.
    """


class Recording(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A job's recording."""

    bytes: int | None = None
    """How long the file is, bytes; `null` until it is whole."""
    fault: str | None = None
    """Why it is not whole, in words."""
    file: str
    """The file's name in the folder of recordings; its path where it was asked for elsewhere."""
    state: RecordingState
    """How it fares."""


class RecordingState(str, Enum):
    """How a recording fares."""

    RECORDING = "recording"
    COMPLETE = "complete"
    FAILED = "failed"


class ReoptimiseView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """When Δv has to be re-optimised, e held: once the object is beyond an end of the depth of field."""

    far_delta_v_mm: float | None = None
    """Δv that focuses on the far end, mm; null where nothing is too far."""
    near_delta_v_mm: float | None = None
    """Δv that focuses on the near end, mm; null where nothing is too near."""


class RepeatRequest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A wish for an earlier operator step to be asked for again."""

    step: int
    """Number of the earlier step, one of `repeatable` of the step that the job waits for."""


class Report(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What an alignment came to."""

    aperture_mm: float
    """Aperture diameter to set, mm."""
    aperture_ring_f_number: float
    """The number on the lens's ring for it."""
    budget: Budget | None = None
    """What Δv, e and focus are good to; `null` where the camera was not looked at through the shell, and in a
    report of a version that did not tell.
    """
    delta_v_air_mm: float | None = None
    """Δv at the end of the air step, mm; `null` where it came to none."""
    delta_v_air_target_mm: float
    """Δv wanted in the air step, mm."""
    delta_v_mm: float | None = None
    """Δv as measured, mm; `null` where the focus axis has been moved since it was."""
    delta_v_sigma_mm: float | None = None
    """Its standard uncertainty, mm."""
    delta_v_target_mm: float
    """Δv wanted for the e reached, mm."""
    depth_of_field: Interval | None = None
    """Depth of field in water, from the shell's outer vertex; `null` where nothing is that sharp, or Δv or e was
    not measured.
    """
    design_origin: str
    """Where the design's numbers come from."""
    e_mm: float | None = None
    """e as the picture has it, mm; `null` where the axis has been moved since it was measured."""
    e_readback_mm: float | None = None
    """Readback of the e axis, mm."""
    e_scale: float | None = None
    """True travel over commanded travel as the picture has it, e axis; `null` where it was not seen to move."""
    e_sigma_mm: float | None = None
    """Its standard uncertainty, mm."""
    e_target_mm: float
    """e wanted, mm."""
    e_tolerance: Interval | None = None
    """e values between which the blur stays within the limit, Δv held; `null` where there are none, or Δv or e was
    not measured.
    """
    e_wall_mm: float
    """The e wall, mm."""
    eog_after: float | None = None
    """The same at the end."""
    eog_before: float | None = None
    """Energy of gradient of the central view before the first move with the shell, mean per pixel."""
    focus_readback_mm: float | None = None
    """Readback of the focus axis, mm."""
    focus_scale: float | None = None
    """True travel over commanded travel as the picture has it, focus axis; `null` where it was not seen to move."""
    fov_water_deg: float | None = None
    """Field of view in water over the sensor's width, degrees; `null` where the edge sees past the shell, or Δv or
    e was not measured.
    """
    image_distance_mm: float | None = None
    """v + Δv, mm."""
    l_bound_mm: float
    """l_bound used, mm."""
    l_bound_sigma_mm: float | None = None
    """Standard uncertainty of a measured l_bound with all that is taken for granted, mm."""
    moves_air: int
    """Moves in the air step, its probe not counted."""
    moves_shell: int
    """Moves in the shell step, its probe not counted."""
    notes: list[str]
    """What a reader should know before trusting the figures, one sentence each."""
    outcome: JobState
    """`converged`, `not_converged`, `cancelled` or `failed`."""
    reason: str
    """Why, in words."""
    shell_step_done: str
    """What the shell step changed to meet the criterion, in words."""
    spacing_px: float | None = None
    """Spacing at the end, px; `null` where an axis has been moved since it was measured."""
    spacing_sigma_px: float | None = None
    """Its standard uncertainty, px."""
    spacing_target_px: float
    """Spacing wanted, px: one of `spacing_targets`."""
    spacing_targets: SpacingTargets
    """What "in focus" is called by rays near the axis and by exact ones."""
    tilt_deg: list[float] | None = None
    """The same as an angle between lens and MLA if nothing else were tilted, degrees."""
    tilt_px: list[float] | None = None
    """Tilt along x and y at the end, px per half frame width; `null` over a board of several levels."""
    tilt_sigma_deg: float | None = None
    """The standard uncertainty of either angle, degrees."""
    time_spent: TimeSpent | None = None
    """Where the time went; `null` in a report of a version that did not tell."""
    truth: dict[str, Any] | None = None
    """The simulated truth, on a simulated bench."""


class ResetRequest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Why the stop is reset."""

    owner: str | None = None
    """Who resets it, where no token says so."""
    why: str
    """Why motion is to be possible again: shown to everybody, and kept."""


class RunView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The run of the program that a job belongs to."""

    bench: str
    """The bench's name."""
    configuration: str
    """The configuration in force, as TOML."""
    id: UUID
    """Identity."""
    started_at: datetime
    """When it began, RFC 3339."""
    version: str
    """The program's version."""


class SceneFaults(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What is wrong with what stands before the camera."""

    board_displaced_mm: float | UnsetType = UNSET
    """How much farther away the boards are than where they should be, mm."""
    board_turned_mrad: float | UnsetType = UNSET
    """By how much the boards are turned about their upright, mrad."""
    bubbles: int | UnsetType = UNSET
    """Bubbles in the field, instead of as many as are configured."""
    no_shell: bool | UnsetType = UNSET
    """There is no shell: a flat window stands in the place of its vertex."""
    second_board_mm: float | UnsetType = UNSET
    """How far before a flat board another stands that fills half of the field, mm; 0 where there is none."""
    shell_radius_mm: float | UnsetType = UNSET
    """By how much the shell's radii are larger than they should be, mm; its vertex is in its place."""
    tank_empty: bool | UnsetType = UNSET
    """The tank has no water in it: there is air beyond the shell."""


class Scope(str, Enum):
    """What somebody may do. Each scope holds those before it."""

    VIEW = "view"
    CONTROL = "control"
    ADMIN = "admin"


class SerialFaults(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What goes wrong between the program and the stages' controller."""

    delay_ms: int | UnsetType = UNSET
    """How late what the controller says arrives, ms."""
    garbled_one_in: int | UnsetType = UNSET
    """One byte in this many that the controller says arrives as another; 0 for none."""
    lost_one_in: int | UnsetType = UNSET
    """One byte in this many that the controller says is lost; 0 for none."""
    unplugged: bool | UnsetType = UNSET
    """The adapter is unplugged."""
    unpowered: bool | UnsetType = UNSET
    """The controller is without power, while its adapter stays. With the power back it knows no place any more."""


class SnapshotMessage(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="snapshot"):
    """Everything as it is now: the first message, and again for a viewer that could not follow."""

    bench: BenchView
    """State of the bench."""
    boot_id: UUID
    """Identity of this run of the program."""
    jobs: list[JobResource]
    """Jobs since the start, newest last."""
    measurement: MeasurementView | None = None
    """The newest measurement."""
    seq: int
    """Number of the newest change contained."""
    version: str
    """Version of the program."""


class GapMessage(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="gap"):
    """The changes that this viewer asked to follow on from are not kept, or are of another run: a snapshot follows."""

    after: int
    """The change that was to be followed on from."""
    after_boot_id: UUID
    """The run that it was of."""
    boot_id: UUID
    """Identity of this run of the program."""
    seq: int
    """Number of the newest change."""


class BenchMessage(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="bench"):
    """The bench changed."""

    bench: BenchView
    """State of the bench."""
    boot_id: UUID
    """Identity of this run of the program."""
    seq: int
    """Number of this change."""


class JobMessage(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="job"):
    """A job changed."""

    boot_id: UUID
    """Identity of this run of the program."""
    job: JobResource
    """The whole job."""
    seq: int
    """Number of this change."""


class MeasurementMessage(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="measurement"):
    """Something was measured."""

    boot_id: UUID
    """Identity of this run of the program."""
    measurement: MeasurementView
    """The measurement."""
    seq: int
    """Number of this change."""


class TickMessage(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="tick"):
    """Nothing need have changed: a sign of life, every second."""

    boot_id: UUID
    """Identity of this run of the program."""
    frame_age_ms: float | None = None
    """Age of the newest frame of a viewer that watches pictures, ms."""
    monotonic_us: int
    """The same moment on the daemon's machine's CLOCK_MONOTONIC, microseconds: no setting of the clock disturbs it."""
    now: datetime
    """The daemon's clock, RFC 3339."""
    seq: int
    """Number of the newest change."""


class ClockMessage(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="clock"):
    """What a viewer asked the daemon's clock for is answered with."""

    asked_ms: float
    """What the viewer had said of when it asked."""
    boot_id: UUID
    """Identity of this run of the program."""
    monotonic_us: int
    """The same moment on the daemon's machine's CLOCK_MONOTONIC, microseconds."""
    now: datetime
    """The daemon's clock when it heard that, RFC 3339."""
    seq: int
    """Number of the newest change."""


class ProblemMessage(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="problem"):
    """A message from this viewer could not be used."""

    boot_id: UUID
    """Identity of this run of the program."""
    problem: Problem
    """What was wrong with it."""
    seq: int
    """Number of the newest change."""


class SessionView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Who one is."""

    demanded: bool
    """Whether a token is demanded of everybody."""
    name: str
    """Name of the token one came in with; `local` where none is demanded."""
    scope: Scope
    """What one may do."""
    signed_in: bool
    """Whether this is a browser that has signed in, and can sign out."""


class DiffuserSetup(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="diffuser"):
    """A diffuser before the lens, for a white frame."""


class BoardsInAirSetup(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="boards_in_air"):
    """Diffuser off, shell off, in air: the triple-level board at these distances from the main lens's principal
    point, mm.
    """

    distances_mm: list[float]
    """Nearest, middle and farthest level; three times the same for a flat board."""


class BoardInWaterSetup(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="board_in_water"):
    """Shell mounted, tank filled, flat board at this distance from the shell's outer vertex, mm."""

    distance_mm: float
    """Distance in water, mm."""


class LeastESetup(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="least_e"):
    """The lens pushed by hand to the least e the shell allows, motors off; then the board as in `WaterBoard`."""

    distance_mm: float
    """Distance of the board in water, mm."""


class ShellOffSetup(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="shell_off"):
    """Shell taken off, tank away, motors on again."""


class ApertureSetup(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="aperture"):
    """The aperture set to a diameter, mm."""

    diameter_mm: float
    """Diameter, mm."""
    ring_f_number: float
    """The number on the lens's ring."""


class ShellRequest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The operator's statement about the shell."""

    state: ShellState
    """Whether the shell is on the camera."""


class ShellState(str, Enum):
    """Whether the shell is on the camera."""

    ON = "on"
    OFF = "off"
    UNKNOWN = "unknown"


class Show(str, Enum):
    """What the pictures of a viewer show."""

    RAW = "raw"
    CENTRAL = "central"
    ALL_IN_FOCUS = "all_in_focus"
    DEPTH = "depth"


class Side(str, Enum):
    """An end of an axis's travel."""

    LOW = "low"
    HIGH = "high"


class SignIn(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a browser signs in with."""

    key: str
    """A token, or the key of the one-time link."""


class SolutionView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A solution: Δv and e that put the object in focus, and what follows from them."""

    aperture_change_mm: float
    """Change of the aperture diameter against the air design, mm."""
    aperture_mm: float
    """Aperture diameter after the change, mm."""
    aperture_ring_f_number: float
    """The number on the lens's ring: focal length over aperture diameter."""
    delta_v_mm: float
    """Δv, mm: positive where MLA and sensor move away from the lens."""
    e_mm: float
    """e, mm: positive where the lens is behind the shell's centre."""
    equivalent_distance_mm: float
    """l_A''M, where the lens believes the object is, mm from the lens."""
    fov_inner_deg: float
    """Field of view inside the shell over the sensor's width, degrees."""
    fov_water_deg: float | None = None
    """Field of view in water over the sensor's width, degrees; null where the shell's rim cuts it."""
    half_width_mm: float | None = None
    """Half the width of board seen at the object distance in water, mm; null as for `fov_water_deg`."""
    image_distance_mm: float
    """v + Δv, mm."""
    main_lens_f_number: float
    """Working f-number: image distance over aperture diameter."""


class SpacingReading(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A spacing measured by a job's iteration."""

    curvature_px: float
    """Field curvature, px at half the frame's width from the centre."""
    frames: int
    """Frames combined."""
    pairs: int
    """Neighbour pairs used."""
    spacing_px: float
    """Spacing on axis, px."""
    spacing_sigma_px: float
    """Its standard uncertainty, px."""
    tilt_x_px: float
    """Tilt along x, px per half frame width."""
    tilt_y_px: float
    """Tilt along y, px per half frame width."""


class SpacingTargets(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The spacing of the board in focus behind the shell, at the e aimed for."""

    chief_ray_px: float | None = None
    """The one pair of chief rays astride the axis, exactly traced, px."""
    paraxial_px: float
    """Eq. 16, which holds for rays near the axis, px."""
    window_px: float | None = None
    """Exact rays averaged over the estimator's window, px; `null` before the first measurement."""


class SpacingThen(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What the spacing of one frame was."""

    at: datetime
    """When the frame was taken, RFC 3339."""
    spacing_px: float
    """The spacing, px."""
    spacing_sigma_px: float
    """Its standard uncertainty, px."""
    spacing_target_px: float
    """The spacing wanted, px."""


class Spread(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Least, quartiles and greatest of something."""

    greatest: float
    """The greatest."""
    least: float
    """The least."""
    lower_quartile: float
    """A quarter is below."""
    median: float
    """Half is below."""
    upper_quartile: float
    """A quarter is above."""


class Stage(str, Enum):
    """What part of an alignment a job is in."""

    PREPARATION = "preparation"
    L_BOUND = "l_bound"
    AIR = "air"
    SHELL = "shell"
    SURVEY = "survey"
    REPORT = "report"


class StepState(str, Enum):
    """Where a step is."""

    DONE = "done"
    NOW = "now"
    NEXT = "next"
    REPEATED = "repeated"


class StopDeliveries(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What became of a stop on each axis."""

    e: StopDelivery
    """The e axis."""
    focus: StopDelivery
    """The focus axis."""


class StopDelivery(str, Enum):
    """How sure it is that an axis was told to stop."""

    CONFIRMED = "confirmed"
    SENT = "sent"
    UNDELIVERABLE = "undeliverable"


class StopReport(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What became of a stop."""

    e: StopDelivery
    """The e axis."""
    focus: StopDelivery
    """The focus axis."""
    kept: bool
    """Whether the latch is on the disk already, so that it outlives a restart. Where it is not, writing it is tried
    again.
    """
    latency_ms: float | None = None
    """From the request until the last byte of the stop order was handed to the operating system, on every axis
    reached, ms; 0 where an earlier stop was being carried out already, absent where no axis was reached.
    """


class StopReset(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A reset of the stop."""

    at: datetime
    """When, RFC 3339."""
    by: str
    """Who reset it."""
    stopped_at: datetime | None = None
    """Since when it had been stopped, RFC 3339; absent where that could not be read."""
    stopped_by: str | None = None
    """Who had stopped; absent where that could not be read."""
    why: str
    """Why, in their words."""


class StopView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The stop's latch."""

    by: str | None = None
    """Who stopped; absent while nobody has."""
    delivery: StopDeliveries | None = None
    """What became of the newest stop on each axis, while it is latched; absent where it was another run's."""
    latched: bool
    """Whether motion is refused until the stop is reset."""
    reset: StopReset | None = None
    """The newest reset; absent while there was none."""
    since: datetime | None = None
    """Since when, RFC 3339."""
    unread: str | None = None
    """Why it is not known whether an earlier run left the stop latched: it counts as latched until it is read, or
    reset.
    """


class TargetSource(str, Enum):
    """What says which spacing is in focus."""

    PARAXIAL = "paraxial"
    DESIGN = "design"
    CALIBRATION = "calibration"


class Ticket(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A ticket."""

    href: str
    """The path with the ticket in its query: opened once, within the time it lasts."""
    lasts_s: int
    """How long it is good, s."""
    ticket: str
    """The ticket itself."""


class TicketRequest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a ticket is to open."""

    path: str
    """A path of this API that can be read, without a query."""


class TimeSpent(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Where a job's time went, from when it was accepted to its report, s. The parts add up to the whole."""

    frames_s: float
    """The camera had yet to give a frame that was exposed at rest."""
    measuring_s: float
    """Frames were measured."""
    motion_s: float
    """Axes were on their way."""
    operator_s: float
    """A person had been asked to do something, and had not confirmed it."""
    other_s: float
    """Whatever else."""
    settling_s: float
    """Axes stood, and what they carry had not settled."""
    total_s: float
    """The whole."""


class TokenList(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The tokens there are."""

    tokens: list[TokenView]
    """The tokens, newest last."""


class TokenRequest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A token to be made."""

    expires_at: datetime | None = None
    """When it is to end by itself; left out: not before it is revoked."""
    name: str
    """What its holder is to be called: 1 to 64 letters, digits, blanks and `.@_-`."""
    scope: Scope
    """What it is to allow."""


class TokenView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A token, without its secret."""

    created_at: datetime
    """When it was made."""
    expires_at: datetime | None = None
    """When it ends by itself."""
    href: str
    """Path of this token."""
    id: UUID
    """Names it for good."""
    last_used_at: datetime | None = None
    """When it was last used, to the minute."""
    name: str
    """What its holder is called."""
    scope: Scope
    """What it allows."""


class TwoBoardsView(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Two boards in one field."""

    difference_sigma_px: float
    """Standard uncertainty of their difference, px."""
    share: float
    """Share of the field that the second fills."""
    spacings_px: list[float]
    """Spacing on the axis as each has it, px: first that of the board that fills more of the field."""


class Verdict(str, Enum):
    """Whether a value is within its tolerance, as far as its uncertainty lets anybody tell."""

    WITHIN = "within"
    OUTSIDE = "outside"
    CANNOT_BE_TOLD = "cannot_be_told"


class PicturesRequest(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="pictures"):
    """Asks for pictures, or for none."""

    max_rate_hz: float | UnsetType = UNSET
    """At most so many pictures a second, 0.1 to 60."""
    on: bool
    """Whether to send pictures."""
    overlay: bool | UnsetType = UNSET
    """Whether to send the spacing over the field, too, at each new measurement."""
    quality: int | UnsetType = UNSET
    """Quality of the JPEG, 10 to 100."""
    reduce: int | UnsetType = UNSET
    """Raw pixels to a picture pixel, each way: 1, 2 or 4."""
    show: Show | UnsetType = UNSET
    """What the pictures show. All but the raw frame are as large as a view is: `reduce` and `viewport` are not for
    them.
    """
    viewport: Viewport | None = None
    """What part of the raw frame to show, and at how many pixels, in place of `reduce`."""
    window: int | UnsetType = UNSET
    """At most so many pictures on the way that the viewer has not said it has seen; 0 for no such bound."""


class ReadingsRequest(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="readings"):
    """Asks for what the meter reads, or for no more of it."""

    max_rate_hz: float | UnsetType = UNSET
    """At most so many a second, 0.1 to 120."""
    on: bool
    """Whether to send readings."""
    whole: bool | UnsetType = UNSET
    """Whether to have a frame measured in whole, too, now and then while no job measures, as for who watches
    pictures: it comes as `measurement`, and what is followed from frame to frame is checked by it.
    """


class HoldRequest(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="hold"):
    """Holds the control lease for as long as this connection lives, and 10 s longer."""

    lease: str
    """The lease's key."""


class ClockRequest(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="clock"):
    """Asks for the daemon's clock: by it and by when it asked, a viewer knows how old at most is what comes,
    however long that waits on its way.
    """

    asked_ms: float
    """When it asks, by its own clock, ms: given back as it is."""


class SeenRequest(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type", tag="seen"):
    """Says that a picture has been shown, where `window` bounds how many are on the way."""

    seq: int
    """The picture's sequence number."""


class Viewport(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A rectangle of the raw frame, and as how many pixels it is looked at."""

    height_px: int
    """Rows of the raw frame."""
    lossless: bool | UnsetType = UNSET
    """Whether to send the samples as they are, as a PNG: only where there is room for every pixel of the rectangle."""
    picture_height_px: int
    """Rows of the picture, likewise."""
    picture_width_px: int
    """Columns of the picture: what there is room for on a screen. It is never sent more than `width_px`."""
    width_px: int
    """Columns of the raw frame."""
    x_px: int
    """First column, px of the raw frame."""
    y_px: int
    """First row, px of the raw frame."""


class AskedStep(OperatorStep, frozen=True, kw_only=True, omit_defaults=True):
    """What an operator was asked to do, and when."""

    asked_at: datetime
    """When it was asked for, RFC 3339."""
    confirmed_at: datetime | None = None
    """When it was confirmed, RFC 3339; `null` until then."""


class AutoExposureView(LightView, frozen=True, kw_only=True, omit_defaults=True):
    """What came of a search for the exposure."""

    bright_level: float
    """Level of the bright pixels in the last of them, as a part of white: 99.5 % of all pixels are at or below it.
    From 0.7 to 0.9; where no step of the camera's controls comes there, from 0.5 to 0.7.
    """
    changed: bool
    """Whether anything was changed: a picture that is exposed as it should be is left as it is."""
    clipped_share: float
    """Share of its pixels that are clipped."""
    frames: int
    """Frames that it took."""


class JobItem(JobSummary, frozen=True, kw_only=True, omit_defaults=True):
    """A job in a list, and where it is found."""

    href: str
    """Path of this job."""


class JobResource(JobSnapshot, frozen=True, kw_only=True, omit_defaults=True):
    """A job and where it is found."""

    href: str
    """Path of this job."""


class NewToken(TokenView, frozen=True, kw_only=True, omit_defaults=True):
    """A token just made."""

    secret: str
    """The secret. It is shown here and never again."""


class SingleMeasurement(MeasurementView, frozen=True, kw_only=True, omit_defaults=True):
    """What was measured, and of which frame."""

    exposed_from: datetime
    """Begin of the exposure, RFC 3339; `captured_at` is its end."""
    exposure_assumed: bool
    """Whether the exposure's begin and end are assumed, not the driver's word."""
    replayed: bool
    """Whether the frame was recorded earlier and is played from a file."""
    simulated: bool
    """Whether the frame was simulated."""
    spans_motion: bool
    """Whether an axis moved, or had not settled, during the exposure: no loop uses such a measurement."""
    unsettled: list[AxisName]
    """The axes that did."""


class UnauthorisedProblem(Problem, frozen=True, kw_only=True, omit_defaults=True):
    """The problem of who is not let in."""

    ended: EndedView | None = None
    """Why what was shown opens nothing any more; left out where it is not known to have opened anything."""


class ViewReport(DepthFigures, frozen=True, kw_only=True, omit_defaults=True):
    """What is known about the newest frame's micro-images, its views and distances."""

    captured_at: datetime
    """When it was taken, RFC 3339."""
    eog_mean_per_pixel: float
    """The same a pixel."""
    eog_sum: float
    """Energy of gradient of the central view scaled to [0, 255] (Eq. 20), sum over its pixels."""
    frame_age_ms: float
    """Its age when this was said, ms."""
    frame_seq: int
    """Sequence number of the frame."""
    lenses: list[LensFigures] | None = None
    """The micro-images one by one, where they were asked for."""
    pose: PoseView | None = None
    """Where the camera was; absent where that is not known, and then there are no distances."""
    pose_unknown: str | None = None
    """What of the pose is not known, and what would make it known."""
    preview: bool
    """Whether this is a coarse picture for viewing only."""
    replayed: bool
    """Whether the frame was recorded earlier and is played from a file."""
    settled: bool
    """Whether both axes were at rest during the whole exposure."""
    simulated: bool
    """Whether the frame was simulated."""
    view_px: list[int]
    """Columns and rows of the central view."""
    white_frame: bool
    """Whether grid and vignetting come from a white frame; without, they come from the frame itself."""


class JobCreated(JobResource, frozen=True, kw_only=True, omit_defaults=True):
    """A job that has been asked for."""

    confirm_key: str | None = None
    """The job's confirm key, to be handed on to whoever is to confirm what it asks. It does nothing else, and ends
    with the job. Told here once; `null` where the job had been asked for before, and then `POST
    /api/v1/jobs/{id}/confirm-key` makes another.
    """


JobRequest: TypeAlias = (
    JointAlignmentJob
    | AirOnlyJob
    | ShellOnlyJob
    | ClarityOnlyJob
    | LBoundMeasurementJob
    | FocusSweepJob
    | SpacingWatchJob
    | CalibrationJob
    | HomingJob
)

Outcome: TypeAlias = HomingOutcome | CalibrationOutcome | LBoundOutcome | FocusSweepOutcome | SpacingWatchOutcome

ServerMessage: TypeAlias = (
    SnapshotMessage
    | GapMessage
    | BenchMessage
    | JobMessage
    | MeasurementMessage
    | TickMessage
    | ClockMessage
    | ProblemMessage
)

Setup: TypeAlias = DiffuserSetup | BoardsInAirSetup | BoardInWaterSetup | LeastESetup | ShellOffSetup | ApertureSetup

ViewerMessage: TypeAlias = PicturesRequest | ReadingsRequest | HoldRequest | ClockRequest | SeenRequest
