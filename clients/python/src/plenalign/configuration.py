"""The configuration. A key that is left out has its default.

Written from the contract by `tools/generate.py`: change that, not this.
"""

from __future__ import annotations

from enum import Enum
from typing import TypeAlias

from msgspec import UNSET, Struct, UnsetType


class Config(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Everything the daemon is told."""

    alpaca: AlpacaConfig | UnsetType = UNSET
    """The facade for ASCOM Alpaca clients."""
    assembly: AssemblyConfig | UnsetType = UNSET
    """How the camera is put together, and to which tolerances."""
    bench: BenchConfig | UnsetType = UNSET
    """Stages, camera and limits."""
    boards: BoardsConfig | UnsetType = UNSET
    """Which boards there are in air."""
    foxglove: FoxgloveConfig | UnsetType = UNSET
    """The live bridge for Foxglove and Lichtblick."""
    history: HistoryConfig | UnsetType = UNSET
    """How long the history keeps what."""
    main_lens: MainLensConfig | UnsetType = UNSET
    """The main lens."""
    mla: MlaConfig | UnsetType = UNSET
    """The microlens array."""
    mqtt: MqttConfig | UnsetType = UNSET
    """The broker that events and measurements are published to."""
    object: ObjectConfig | UnsetType = UNSET
    """The object distances."""
    record: RecordConfig | UnsetType = UNSET
    """What is recorded of jobs, and where."""
    sensor: SensorConfig | UnsetType = UNSET
    """The sensor."""
    server: ServerConfig | UnsetType = UNSET
    """Who may ask the daemon, and how many at once."""
    shell: ShellConfig | UnsetType = UNSET
    """The spherical shell."""
    uncertainty: UncertaintyConfig | UnsetType = UNSET
    """How well what is configured above is known."""
    water: WaterConfig | UnsetType = UNSET
    """The water."""


class AlpacaConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[alpaca]`"""

    discovery: bool | UnsetType = UNSET
    """Whether clients that look for Alpaca devices by UDP on port 32227 are told of this one."""
    lease_ttl_s: float | UnsetType = UNSET
    """How long a client keeps the control lease without a request, s."""
    listen: str | UnsetType = UNSET
    """Address and port on which Alpaca is spoken; empty for not at all. Beyond loopback only with `--insecure`:
    Alpaca knows no tokens and no TLS.
    """


class ArrayKind(str, Enum):
    """How the microlenses are arranged."""

    SQUARE = "square"
    """On a square lattice."""
    HEXAGONAL = "hexagonal"
    """On a hexagonal lattice; its pitch is the distance of nearest neighbours."""


class AssemblyConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[assembly]`"""

    blur_limit_px: float | UnsetType = UNSET
    """δ: diameter of the blur disc still called sharp, px."""
    clearance_mm: float | UnsetType = UNSET
    """How much greater l_bound is than the e at which the lens touches the shell, mm: of `l_bound_mm` so much is
    clearance, and so much is added to what is measured, or three times its uncertainty where that is more.
    """
    delta_v_tolerance_mm: float | None = None
    """Δv_TOL, mm; left out, what changes the spacing by 0.045 px, rounded to 1, 2 or 5 times a power of ten."""
    e_tolerance_mm: float | None = None
    """Tolerance of e, mm; left out, what changes the spacing by 0.016 px, rounded likewise, 1 at most."""
    initial_e_mm: float | UnsetType = UNSET
    """e at which the shell is mounted, mm."""
    l_bound: LBoundSource | UnsetType = UNSET
    """Whether `l_bound_mm` holds or is measured."""
    l_bound_mm: float | UnsetType = UNSET
    """l_bound, the least e the lens's barrel allows with `clearance_mm` left, mm."""
    shell_step: ShellStep | UnsetType = UNSET
    """What the shell step may change."""
    spacing_target: SpacingTarget | UnsetType = UNSET
    """Which spacing the shell step aims at."""


class Auth(str, Enum):
    """When a token is demanded."""

    AUTO = "auto"
    """On loopback only once there is one; elsewhere always."""
    REQUIRED = "required"
    """Always."""


class AxisConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[bench.focus]`, `[bench.e]`: one axis. All positions are in the axis's own coordinate, mm."""

    acceleration_mm_per_s2: float | UnsetType = UNSET
    """Acceleration, mm/s²."""
    accept_wider_firmware_limits: bool | UnsetType = UNSET
    """Whether limits of the controller's own that are wider than these are accepted."""
    approach: Side | UnsetType = UNSET
    """The side from which a target is approached."""
    axis: str | UnsetType = UNSET
    """Axis letter or number on that controller."""
    backlash_mm: float | UnsetType = UNSET
    """Lost motion on reversal, mm, at most. A final approach starts this much and more beside the target."""
    controller: str | UnsetType = UNSET
    """Name of the controller under `[bench.controllers]`."""
    high_limit_mm: float | UnsetType = UNSET
    """Greatest position, mm."""
    home_position_mm: float | UnsetType = UNSET
    """Position after homing and pulling off the switch, mm."""
    home_side: Side | UnsetType = UNSET
    """The end where the home switch is."""
    low_limit_mm: float | UnsetType = UNSET
    """Least position, mm."""
    max_step_mm: float | UnsetType = UNSET
    """Greatest single move, mm."""
    motor_inverted: bool | UnsetType = UNSET
    """Whether the controller is set to turn the motor the other way round (Grbl: the axis's bit of `$3`; TMCL: axis
    parameter 251): a controller that is set otherwise moves nothing.
    """
    reversed: bool | UnsetType = UNSET
    """Whether the controller's positive direction is the coordinate's negative one."""
    scale_uncertainty: float | UnsetType = UNSET
    """Standard relative uncertainty of the scale before the picture has confirmed it."""
    settle_ms: int | UnsetType = UNSET
    """Rest after a stop before a frame counts as taken at rest, ms."""
    speed_mm_per_s: float | UnsetType = UNSET
    """Greatest speed, mm/s."""
    steps_per_mm: float | UnsetType = UNSET
    """The controller's units of position a millimetre (Grbl, Zaber, TMCL: motor steps or microsteps; PI: 1 where it
    counts in mm; Thorlabs: counts of the encoder or microsteps): compared with the controller's own setting,
    where it has one.
    """
    zero_uncertainty_mm: float | UnsetType = UNSET
    """Standard uncertainty of the coordinate's zero after homing, mm."""


class BenchConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[bench]`"""

    camera: CameraConfig | UnsetType = UNSET
    """The camera."""
    controllers: dict[str, ControllerConfig] | UnsetType = UNSET
    """Stage controllers by name (hardware only)."""
    driver: BenchDriver | UnsetType = UNSET
    """Simulated or hardware."""
    e: AxisConfig | UnsetType = UNSET
    """The e axis. Its coordinate is e: positive away from the shell."""
    focus: AxisConfig | UnsetType = UNSET
    """The focus axis. Its coordinate is Δv: 0 at the air design's image distance, positive away from the lens."""
    simulation: SimulationConfig | UnsetType = UNSET
    """The simulated bench's truth (simulated only)."""


class BenchDriver(str, Enum):
    """Whether the bench is real."""

    SIMULATED = "simulated"
    """Twins of stages and camera; loud about it everywhere, and never a fallback for missing hardware."""
    HARDWARE = "hardware"
    """Stages over serial and a camera over V4L2."""


class BoardTexture(str, Enum):
    """What is on a board: how well a spacing can be measured by it."""

    NATURAL = "natural"
    """Random, with the amplitude spectrum of natural scenes."""
    CHARUCO = "charuco"
    """A chessboard with marker-like squares."""
    PRINT = "print"
    """Black print on white."""


class BoardsConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[boards]`"""

    farthest_mm: float | UnsetType = UNSET
    """How far from the lens a board in air may stand, mm."""
    greatest_depth_mm: float | UnsetType = UNSET
    """From the nearest to the furthest level of a triple-level board, mm, at most."""
    in_air: BoardsInAir | UnsetType = UNSET
    """Which boards stand before the lens in air."""
    level_step_mm: float | None = None
    """Distance between the levels of the triple-level board that there is, mm; left out, one is made as the plan
    wants it.
    """
    side_mm: float | None = None
    """Shortest side of the boards, mm; left out, they fill the field wherever they stand."""
    tank_mm: float | None = None
    """From the shell's outer vertex to the tank's far wall, mm; left out, the board in water has all the room it
    needs.
    """
    texture: BoardTexture | UnsetType = UNSET
    """What is on them, which the plan's expected uncertainties go by."""


class BoardsInAir(str, Enum):
    """Which boards stand before the lens in air."""

    AUTO = "auto"
    """Whichever of the others suits the camera, by the plan."""
    TRIPLE_LEVEL = "triple_level"
    """One board of three levels side by side."""
    FLAT_IN_TURN = "flat_in_turn"
    """One flat board, put to three places in turn."""


class BubblesConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[bench.simulation.bubbles]`: bubbles of air in the water, drops of water in air, between camera and board.
    Those that would touch the board or lie behind it are not there; before a diffuser none is.
    """

    count: int | UnsetType = UNSET
    """How many, over the whole field."""
    distance_mm: list[float] | UnsetType = UNSET
    """Least and greatest distance, mm: in water from the shell's outer vertex, in air from the main lens."""
    highlight: float | UnsetType = UNSET
    """Radiance of the lamp that each mirrors, over that of a white board."""
    radius_mm: list[float] | UnsetType = UNSET
    """Least and greatest radius, mm."""


class CameraConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[bench.camera]`"""

    controls: dict[str, ControlValue] | UnsetType = UNSET
    """Controls set before frames are taken, by the driver's or the camera's names for them."""
    crop_left_px: int | None = None
    """Left column of the region read out, px from the left of what the driver can crop from; without it and
    `crop_top_px` nothing is cropped.
    """
    crop_top_px: int | None = None
    """Top row of the region read out, px."""
    device: str | UnsetType = UNSET
    """Which device. With `v4l2` a device file, best by its `/dev/v4l/by-id` name; `card:NAME`, by the name that its
    driver gives it; or `usb:SERIAL`, by its USB serial number. With `genicam` `serial:NUMBER`; `name:NAME`, by
    the name that a user gave it; its IPv4 address; or `usb:VENDOR:PRODUCT`, by the numbers of a camera on USB.
    """
    driver: CameraDriver | UnsetType = UNSET
    """Driver. On a simulated bench `v4l2` and `genicam` stand for the simulated camera."""
    files: str | UnsetType = UNSET
    """The frames to play: a folder, or a pattern such as `/data/run-7/*.png` (files only)."""
    format: str | UnsetType = UNSET
    """Pixel format, by its V4L2 name, or PFNC's (genicam)."""
    frame_rate_hz: float | UnsetType = UNSET
    """Frames a second asked for, or played."""
    interfaces: list[str] | UnsetType = UNSET
    """Network interfaces on which cameras are looked for, such as `eth1`; on no other. Those on USB are found
    without (genicam only).
    """
    packet_bytes: int | None = None
    """Bytes of a packet with its headers, at most; left out: as many as the network carries (genicam only)."""
    packet_delay_us: float | None = None
    """The camera's pause between two packets, µs; left out: as it is set (genicam only)."""
    pipeline_delay_ms: int | UnsetType = UNSET
    """Time a picture spends between exposure and the driver's timestamp, ms."""
    repeat: bool | UnsetType = UNSET
    """Whether they are played again and again, and not once (files only)."""
    timeout_ms: int | UnsetType = UNSET
    """Longest wait for a frame before the camera counts as lost, ms."""
    timestamp_means: TimestampMeans | UnsetType = UNSET
    """What the camera's timestamps are of (genicam only)."""


class CameraDriver(str, Enum):
    """Where frames come from."""

    V4L2 = "v4l2"
    """Video4Linux2 (on a simulated bench: its own camera)."""
    GENICAM = "genicam"
    """A GenICam camera over GigE Vision (on a simulated bench: its own camera)."""
    FILES = "files"
    """Frames kept in files, played again."""


class CfaPattern(str, Enum):
    """A Bayer pattern, named by its first two rows from the frame's upper left."""

    RGGB = "rggb"
    """Red at (0, 0), blue at (1, 1)."""
    BGGR = "bggr"
    """Blue at (0, 0), red at (1, 1)."""
    GRBG = "grbg"
    """Red at (1, 0), blue at (0, 1)."""
    GBRG = "gbrg"
    """Blue at (1, 0), red at (0, 1)."""


class ControllerConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[bench.controllers.NAME]`"""

    address: int | UnsetType = UNSET
    """Address of the device on its line, where the protocol has addresses."""
    baud: int | None = None
    """Baud rate; the protocol's usual one where it is not given."""
    driver: ControllerDriver
    """Protocol."""
    identity: str | None = None
    """What the controller's identity must contain, beyond being of the right kind: another one is refused."""
    port: str
    """Serial port: its `/dev/serial/by-id` name or another path, or `usb:` and a USB serial number."""


class ControllerDriver(str, Enum):
    """Which protocol a stage controller speaks."""

    GRBL = "grbl"
    """Grbl 1.1, grblHAL and FluidNC."""
    ZABER = "zaber"
    """Zaber's ASCII protocol."""
    PI = "pi"
    """PI's General Command Set 2."""
    TMCL = "tmcl"
    """Trinamic's TMCL."""
    THORLABS = "thorlabs"
    """Thorlabs' APT protocol."""


class DustConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[bench.simulation.dust]`: round specks on the sensor or its cover glass."""

    height_um: float | UnsetType = UNSET
    """How far before the sensor they lie, µm: 0 on it; less than b."""
    opacity: list[float] | UnsetType = UNSET
    """Least and greatest share of the light that a speck takes, 0 to 1."""
    radius_um: list[float] | UnsetType = UNSET
    """Least and greatest radius, µm."""
    specks: int | UnsetType = UNSET
    """How many, over the whole frame."""


class FoxgloveConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[foxglove]`"""

    listen: str | UnsetType = UNSET
    """Where the bridge listens: an address of loopback with its port; empty for no bridge."""
    origins: list[str] | UnsetType = UNSET
    """Origins of pages that may look on, as `https://app.foxglove.dev`, beside those served by this machine itself."""


class HistoryConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[history]`"""

    keep_audit_days: int | None = None
    """Days that entries of the audit log are kept; without it, for ever."""
    keep_days: int | None = None
    """Days that jobs are kept after their end, and moves and measurements by hand; without it, for ever."""
    keep_mb: int | None = None
    """What the file may grow to before the oldest jobs, moves and measurements are deleted, MB; without it, to any
    size.
    """


class LBoundSource(str, Enum):
    """Where l_bound comes from."""

    CONFIGURED = "configured"
    """From `l_bound_mm`."""
    MEASURE = "measure"
    """Measured by the job (Eqs. 9–12), before the air step."""


class MainLensConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[main_lens]`"""

    focal_length_mm: float | UnsetType = UNSET
    """f, mm."""
    principal_from_mount_mm: float | None = None
    """From the mount's face, which a ruler can touch, to the principal plane, mm, positive towards the object."""
    principal_from_mount_sigma_mm: float | None = None
    """Standard uncertainty of `principal_from_mount_mm`, mm."""


class MicrolensesConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[bench.simulation.microlenses]`: how the microlenses differ from each other."""

    dead_share: float | UnsetType = UNSET
    """Share of the microlenses that let no light through, 0 to 1."""
    dirty_share: float | UnsetType = UNSET
    """Share of the microlenses that are dirty, 0 to 1."""
    dirty_transmission: list[float] | UnsetType = UNSET
    """Least and greatest transmission of a dirty microlens: two are drawn, one for either side of its aperture, and
    it changes evenly between them.
    """
    focal_factors: list[float] | UnsetType = UNSET
    """Focal lengths of the types of microlenses, over f_MLA; empty: all are f_MLA. A square array has two,
    chequered: the type is (i + j) mod 2; a hexagonal one three, no two alike side by side: (i − j) mod 3. i
    counts along the array's x axis, j along its second axis (60° from it in a hexagonal array), from the
    microlens nearest to the axis before the array is shifted. All share one b.
    """


class MlaConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[mla]`"""

    angular_resolution: float | UnsetType = UNSET
    """N = a / b."""
    array: ArrayKind | UnsetType = UNSET
    """Square or hexagonal."""
    focal_length_mm: float | UnsetType = UNSET
    """f_MLA, mm."""
    mode: MlaMode | UnsetType = UNSET
    """Galilean or Keplerian."""
    pitch_mm: float | UnsetType = UNSET
    """D_MLA: made pitch of the microlenses, mm."""


class MlaMode(str, Enum):
    """On which side of the MLA the main lens's image lies."""

    GALILEAN = "galilean"
    """Behind the MLA, towards the sensor: a > 0, spacing below the pitch."""
    KEPLERIAN = "keplerian"
    """Before the MLA: a < 0, spacing above the pitch."""


class MosaicConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[bench.simulation.mosaic]`: what the colour filters of a sensor with `sensor.mosaic` let through, and the
    boards' colours, which a monochrome sensor sees grey.
    """

    colour: float | UnsetType = UNSET
    """How far a channel's reflectance falls below the grey texture's at most, 0 to 1: smooth patches from the seed,
    for each channel its own.
    """
    sensitivities: list[float] | UnsetType = UNSET
    """What red, green and blue pixels make of white light, over what a monochrome pixel does."""


class MotionConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[bench.simulation.motion]`: what moves while the shutter is open. Each movement is even and centred on the
    frame's nominal pose.
    """

    board_um: list[float] | UnsetType = UNSET
    """Travel of the board along its own x and y in one exposure, µm."""
    delta_v_um: float | UnsetType = UNSET
    """Travel of MLA and sensor along Δv in one exposure, µm."""
    e_um: float | UnsetType = UNSET
    """Travel of the lens along e in one exposure, µm."""
    steps: int | UnsetType = UNSET
    """Moments at which the exposure is sampled; 1 takes the picture at one moment, and nothing blurs. With more,
    the travel of the bench's axes during a frame blurs it too. A frame takes so many times longer to render.
    """


class MqttConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[mqtt]`"""

    bench: str | UnsetType = UNSET
    """This bench's name in topics; empty for the machine's name."""
    broker: str | UnsetType = UNSET
    """The broker, as `mqtts://broker.lab:8883`, or `mqtt://127.0.0.1:1883` without TLS; empty for none."""
    client_id: str | UnsetType = UNSET
    """How this daemon names itself to the broker; empty for `plenalign-GROUP-BENCH`."""
    group: str | UnsetType = UNSET
    """The benches that belong together: the second part of every topic."""
    keep_alive_s: float | UnsetType = UNSET
    """A connection on which nothing was heard for half as long again is given up, s."""
    measurements_per_s: float | UnsetType = UNSET
    """Measurements published a second, at most; 0 for none."""
    password_file: str | UnsetType = UNSET
    """File with the password, and nothing else, of that user; empty for none."""
    positions_per_s: float | UnsetType = UNSET
    """Positions of each axis published a second, at most; 0 for none."""
    tls: MqttTlsConfig | UnsetType = UNSET
    """By what the broker is known, and this daemon to it."""
    topic_prefix: str | UnsetType = UNSET
    """What every topic begins with."""
    user: str | UnsetType = UNSET
    """User name at the broker; empty for none."""


class MqttTlsConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[mqtt.tls]`"""

    ca: str | UnsetType = UNSET
    """PEM file with the authorities that may vouch for the broker; empty for those that the system trusts."""
    certificate: str | UnsetType = UNSET
    """PEM file with this daemon's certificate and those that lead to its root; empty for none."""
    key: str | UnsetType = UNSET
    """PEM file with its key; empty for none."""


class ObjectConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[object]`"""

    air_distance_mm: float | UnsetType = UNSET
    """d_OBJ of the air design, from the main lens's principal point, mm."""
    distance_mm: float | UnsetType = UNSET
    """d_OBJ in water, from the shell's outer vertex O, mm."""


class RecordConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[record]`"""

    folder: str | UnsetType = UNSET
    """Folder of the recordings; empty for `recordings` in the state folder."""
    jobs: RecordJobs | UnsetType = UNSET
    """Which jobs are recorded."""
    keep_free_mb: int | UnsetType = UNSET
    """Room on the disk that is left for others, MB."""
    max_file_mb: int | UnsetType = UNSET
    """Longest recording, MB."""


class RecordJobs(str, Enum):
    """Which jobs are recorded."""

    ASKED = "asked"
    """Those whose request asks for it."""
    ALL = "all"
    """All but those whose request says no."""


class ReelConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[bench.simulation.reel]`: previews from light that was traced before, so that they keep pace with an axis in
    motion.
    """

    poses: int | UnsetType = UNSET
    """Poses whose light is kept; each takes four bytes a pixel."""
    step_um: float | UnsetType = UNSET
    """The true Δv that a preview shows is the nearest multiple of this, µm, and nothing blurs; 0: every pose is
    traced.
    """


class SensorConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[sensor]`"""

    height_px: int | UnsetType = UNSET
    """Rows of a raw frame."""
    mosaic: CfaPattern | None = None
    """Bayer pattern of its colour filters; absent: a monochrome sensor."""
    pixel_um: float | UnsetType = UNSET
    """Side of a pixel, µm."""
    width_px: int | UnsetType = UNSET
    """Columns of a raw frame."""


class ServerConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[server]`"""

    auth: Auth | UnsetType = UNSET
    """When a token is demanded."""
    idle_timeout_s: float | UnsetType = UNSET
    """A connection on which no request has come for so long is closed, s."""
    max_connections: int | UnsetType = UNSET
    """Connections served at once."""
    max_connections_per_address: int | UnsetType = UNSET
    """Of these, at most so many from one address."""
    max_viewports: int | UnsetType = UNSET
    """Different parts of the raw frame, or sizes or qualities of them, that are sent of each frame."""
    mdns: bool | UnsetType = UNSET
    """Whether the daemon is announced on the local network (mDNS, `_plenalign._tcp`); never on loopback."""
    names: list[str] | UnsetType = UNSET
    """Names by which the daemon may be addressed, beside its addresses."""
    requests_per_s: float | UnsetType = UNSET
    """Requests a second of one token or address, in the long run; four times as many at once."""
    tls: TlsConfig | UnsetType = UNSET
    """Certificate and key."""
    trusted_proxies: list[str] | UnsetType = UNSET
    """Proxies that may say whom they ask for: addresses or networks."""


class ShellConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[shell]`"""

    inner_radius_mm: float | UnsetType = UNSET
    """l_O'C, mm."""
    outer_radius_mm: float | UnsetType = UNSET
    """l_OC, mm."""
    refractive_index: float | UnsetType = UNSET
    """Refractive index of the shell, relative to air."""


class ShellStep(str, Enum):
    """What the shell step may change to meet Eq. 16."""

    TRANSLATE_E_THEN_TRIM = "translate_e_then_trim"
    """Translate e; where the criterion lies beyond the wall, hold e at its optimum and trim Δv (Eq. 8, e fixed)."""
    TRANSLATE_E = "translate_e"
    """Translate e only, as the paper does; ends "not converged" at the wall."""
    HOLD_E_TRIM = "hold_e_trim"
    """Move e to its optimum by its readback and trim Δv only."""


class Side(str, Enum):
    """An end of an axis's travel."""

    LOW = "low"
    """Towards smaller coordinates."""
    HIGH = "high"
    """Towards larger coordinates."""


class SimulationConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[bench.simulation]`: how the simulated bench differs from what is configured, and how it looks. The daemon's
    control loops never read this section.
    """

    array_rotation_deg: float | None = None
    """Rotation of the array, from +x towards +y, degrees; absent: drawn from the seed within ±1°."""
    bits: int | UnsetType = UNSET
    """Depth of a frame, 8 to 16 bits; white stays at the same share of the range."""
    board_placement_error_mm: float | UnsetType = UNSET
    """True board distance less the one asked for, mm."""
    board_tilt_mrad: list[float] | UnsetType = UNSET
    """Tilt of the board about y and x, mrad."""
    bubbles: BubblesConfig | UnsetType = UNSET
    """Bubbles before the camera."""
    contact_e_mm: float | UnsetType = UNSET
    """True e at which the lens touches the shell, mm."""
    cross_talk: bool | UnsetType = UNSET
    """Whether microlenses let neighbours' light through (an array without baffles)."""
    distortion_k1: float | UnsetType = UNSET
    """Brown's k1 of the main lens: a chief ray's slope on the image side is its slope t in air on the object side
    times 1 + k1 t² (an OpenCV k1: slopes are heights over the focal length). Positive is pincushion, negative
    barrel. It moves and stretches what is seen, not the white frame's grid.
    """
    dust: DustConfig | UnsetType = UNSET
    """Dust on the sensor or its cover glass."""
    e_backlash_mm: float | UnsetType = UNSET
    """Lost motion of the e axis on reversal, mm."""
    e_scale_error: float | UnsetType = UNSET
    """True travel over commanded travel, less 1, of the e axis."""
    e_sign_flip: bool | UnsetType = UNSET
    """Whether the e axis moves the wrong way."""
    e_zero_offset_mm: float | UnsetType = UNSET
    """True e less the e axis's reading at its home position, mm."""
    electrons_per_level: float | UnsetType = UNSET
    """Photon noise: electrons that make a grey level of an 8-bit frame; 0 for none."""
    exit_pupil_walk_mm: float | UnsetType = UNSET
    """Aberration of the exit pupil: how far its centre moves along the axis, towards the board, for the field whose
    slope on the object side is 0.1, mm; it grows with the slope's square. It moves the micro-images of the outer
    field: positive towards the axis.
    """
    focal_length_error: float | UnsetType = UNSET
    """True focal length less the configured, relative."""
    focus_backlash_mm: float | UnsetType = UNSET
    """Lost motion of the focus axis on reversal, mm."""
    focus_scale_error: float | UnsetType = UNSET
    """True travel over commanded travel, less 1, of the focus axis."""
    focus_sign_flip: bool | UnsetType = UNSET
    """Whether the focus axis moves the wrong way."""
    friction_step_mm: float | UnsetType = UNSET
    """Moves of either axis shorter than this stick, mm."""
    lens_tilt_mrad: list[float] | UnsetType = UNSET
    """Tilt of the main lens about y and x, mrad."""
    lens_to_mla_error_mm: float | UnsetType = UNSET
    """True d less the design's d when the focus axis reads 0, mm."""
    level_errors_mm: list[float] | UnsetType = UNSET
    """The same of the nearest, middle and farthest level of a triple-level board in air, besides, mm; of a flat
    board in air the first each first time that it is put up, the second each second, the third each third.
    """
    microlenses: MicrolensesConfig | UnsetType = UNSET
    """How the microlenses differ from each other."""
    mla_tilt_mrad: list[float] | UnsetType = UNSET
    """Tilt of the MLA about the sensor's y and x axes, mrad: d grows along +x and +y."""
    mosaic: MosaicConfig | UnsetType = UNSET
    """The sensor's colour filters and the board's colours."""
    motion: MotionConfig | UnsetType = UNSET
    """What moves while the shutter is open."""
    operator_confirms: bool | UnsetType = UNSET
    """Whether the simulated operator carries out and confirms the job's steps by itself."""
    preview_rate_hz: float | UnsetType = UNSET
    """Frames a second of the live preview."""
    preview_rays: int | UnsetType = UNSET
    """Rays a pixel of the live preview."""
    rays: int | UnsetType = UNSET
    """Rays a pixel of a measured frame."""
    read_noise_levels: float | UnsetType = UNSET
    """Read noise, grey levels of an 8-bit frame, standard deviation."""
    reel: ReelConfig | UnsetType = UNSET
    """How previews keep pace with an axis in motion."""
    seed: int | UnsetType = UNSET
    """Seed of noise, texture, and the array's rotation and offset."""
    shell_decentre_mm: list[float] | UnsetType = UNSET
    """Decentre of the shell's centre from the lens's axis, mm."""
    texture: Texture | UnsetType = UNSET
    """Texture of the boards."""
    water_board_error_mm: float | UnsetType = UNSET
    """The same of the board in water, besides, mm."""


class SpacingTarget(str, Enum):
    """Which spacing counts as in focus behind the shell."""

    PARAXIAL = "paraxial"
    """Eq. 16, which holds for rays near the axis."""
    EXACT = "exact"
    """What the estimator measures when Eq. 16 holds near the axis: exact rays through the shell, averaged over the
    estimator's window.
    """


class Texture(str, Enum):
    """What is on a board."""

    CHARUCO = "charuco"
    """A chessboard with marker-like squares."""
    NATURAL = "natural"
    """Random, with the amplitude spectrum of natural scenes."""
    GUPPY = "guppy"
    """A guppy: bright patches on a pale body over gravel."""
    OSCAR = "oscar"
    """An Oscar: dark body with bright blotches over plants."""


class TimestampMeans(str, Enum):
    """The moment that a GenICam camera's timestamps are of, which differs by vendor."""

    EXPOSURE_START = "exposure_start"
    """The exposure's start."""
    EXPOSURE_END = "exposure_end"
    """The exposure's end."""
    READOUT = "readout"
    """Some moment from the exposure's start to the end of read-out: the earliest exposure that fits is assumed."""
    ARRIVAL = "arrival"
    """Nothing of use: the time of a frame's arrival stands in for them."""


class TlsConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[server.tls]`"""

    certificate: str | UnsetType = UNSET
    """PEM file with the certificate and those that lead to its root; empty for none."""
    key: str | UnsetType = UNSET
    """PEM file with its key; empty for none."""


class UncertaintyConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[uncertainty]`: standard uncertainties of configured values, 0 for one that is exact. What the axes' are
    uncertain by is in their own sections.
    """

    board_in_water_mm: float | UnsetType = UNSET
    """Of the board's distance in water, mm."""
    board_steps_mm: float | UnsetType = UNSET
    """Of each board's step from there, mm."""
    board_tilt_deg: float | UnsetType = UNSET
    """Of the angle by which a board is not square to the axis, each way, degrees."""
    boards_in_air_mm: float | UnsetType = UNSET
    """Of the distance that all boards in air share, mm, besides that of the principal plane."""
    exit_pupil_mm: float | UnsetType = UNSET
    """Of where the main lens's exit pupil is, mm: it makes the micro-images' pitch, and is taken to be at M."""
    focal_length: float | UnsetType = UNSET
    """Of f, as a share of it."""
    mla_focal_length: float | UnsetType = UNSET
    """Of f_MLA, as a share of it."""
    mla_pitch: float | UnsetType = UNSET
    """Of D_MLA, as a share of it."""
    mla_to_sensor: float | UnsetType = UNSET
    """Of b, as a share of it."""
    shell_aberrations: float | UnsetType = UNSET
    """Of what the shell's aberrations add to the spacing over the estimator's window, as a share of it."""
    shell_decentre_mm: float | UnsetType = UNSET
    """Of where the shell's centre is beside the lens's axis, each way, mm."""
    shell_index: float | UnsetType = UNSET
    """Of the shell's index."""
    shell_radii_mm: float | UnsetType = UNSET
    """Of the shell's radii, each, mm."""
    water_index: float | UnsetType = UNSET
    """Of the water's index, with the light's wavelength."""


class WaterConfig(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`[water]`: either a refractive index, or what it follows from."""

    refractive_index: float | None = None
    """Refractive index, relative to air."""
    salinity_permille: float | None = None
    """Salinity, ‰."""
    temperature_c: float | None = None
    """Temperature, °C."""
    wavelength_nm: float | None = None
    """Wavelength in vacuum, nm."""


ControlValue: TypeAlias = bool | int | float | str
