"""A plenoptic camera, its boards, and the scene that trace.c takes; with the paraxial formulas of the paper.

Lengths are mm and angles degrees unless a name says otherwise. Signs and axes are those at the head of trace.c.
"""

import ctypes
import dataclasses
import hashlib
import os
import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
FAR = 1e9  # an edge that is not there, mm


@dataclass(frozen=True)
class Shell:
    """A spherical shell about one centre: radii, index of the glass and of what is outside."""

    outer: float = 59.0
    inner: float = 51.0
    n_shell: float = 1.49
    n_out: float = 1.333


@dataclass(frozen=True)
class Board:
    """A flat board, square to the axis unless tilted, as far off as makes the paraxial spacing, or as is said."""

    spacing_px: float = 0.0  # the board goes where the paraxial spacing on the axis is this; 0: `distance` holds
    distance: float = 0.0  # in air from the main lens; through a shell from its outer vertex
    texture: str = "natural"
    seed: int = 1
    scale: float = 1.0  # size of the texture's features; 1 suits a pixel's footprint on the board
    low: float = 0.08  # radiance of the texture's 0 and 1; a white board has 1
    high: float = 0.92
    tilt_x: float = 0.0  # the board turned about x and then y through its point on the axis
    tilt_y: float = 0.0
    part: tuple = (0.0, 1.0)  # what it takes of the frame's width, as chief rays see it


@dataclass(frozen=True)
class Camera:
    """The camera's design (the reference preset's unless given), its setting, its faults, and its sensor."""

    main_lens_focal_length: float = 20.0
    mla_pitch: float = 0.1  # the made pitch of the microlenses
    mla_focal_length: float = 0.5
    angular_resolution: float = 3.13
    mode: str = "galilean"
    pixel_um: float = 3.45
    design_distance: float = 800.0  # in air; gives the image distance v and with it the place of the array
    delta_v: float = 0.0  # > 0: array and sensor away from the lens
    e: float | None = None  # shell's centre back to the lens, > 0: lens behind the centre; None: no shell, air
    shell: Shell = field(default_factory=Shell)
    array: str = "square"
    rotation: float = 0.0  # of the lattice, from +x towards +y
    offset: tuple = (0.0, 0.0)  # of a microlens's centre from the array's origin, in pitches
    size: tuple = (480, 400)  # pixels
    axis_px: tuple | None = None  # where the axis meets the sensor; None: the frame's centre
    stop: float = 1.0  # diameter of the aperture; 1 lets micro-images just touch
    fill: float = 1.0  # diameter of a microlens in pitches
    baffled: bool = True
    array_tilt: tuple = (0.0, 0.0)  # array and sensor as one, about x then y, through the axis
    lens_tilt: tuple = (0.0, 0.0)
    lens_decentre: tuple = (0.0, 0.0)
    shell_decentre: tuple = (0.0, 0.0)
    samples: int = 48  # rays a pixel

    # The paraxial model. a is signed: negative for a Keplerian camera, whose image lies before the array.
    @property
    def b(self):
        sign = -1 if self.mode == "galilean" else 1
        return self.mla_focal_length * (1 + sign / self.angular_resolution)

    @property
    def a(self):
        return self.angular_resolution * self.b * (1 if self.mode == "galilean" else -1)

    @property
    def v_design(self):
        return gauss(self.main_lens_focal_length, self.design_distance)

    @property
    def d(self):
        """Main lens to array."""
        return self.v_design + self.delta_v - self.a

    @property
    def micro_image_pitch_px(self):
        return self.mla_pitch * (self.d + self.b) / self.d / self.pixel_mm

    @property
    def pixel_mm(self):
        return self.pixel_um * 1e-3

    @property
    def stop_diameter(self):
        return self.stop * self.d * self.mla_pitch / self.b

    @property
    def target_px(self):
        return self.mla_pitch * (self.a - self.b) / self.a / self.pixel_mm

    def equivalent(self, distance):
        """Where the lens believes a board to be, from the lens."""
        if self.e is None:
            return distance
        return virtual_image(self.shell, distance) + self.shell.inner + self.e

    def distance_of(self, equivalent):
        """The board's distance for an equivalent distance: the inverse of `equivalent`."""
        if self.e is None:
            return equivalent
        s = self.shell
        image = equivalent - s.inner - self.e
        first = s.n_shell / (-1 / image - (1 - s.n_shell) / s.inner)  # l_O'A'
        return -s.n_out / (s.n_shell / (first + s.outer - s.inner) - (s.n_shell - s.n_out) / s.outer)

    def spacing_px(self, equivalent):
        a = gauss(self.main_lens_focal_length, equivalent) - self.d
        return self.mla_pitch * (a - self.b) / a / self.pixel_mm

    def equivalent_of_spacing(self, spacing_px):
        a = self.b * self.mla_pitch / (self.mla_pitch - spacing_px * self.pixel_mm)
        return gauss(self.main_lens_focal_length, a + self.d)

    def board_distance(self, board):
        if board.spacing_px:
            return self.distance_of(self.equivalent_of_spacing(board.spacing_px))
        return board.distance

    @property
    def directions(self):
        """Directions of neighbours, radians from +x towards +y, each pair of lenses once."""
        turn, count = (60, 3) if self.array == "hexagonal" else (90, 2)
        return np.radians(self.rotation + turn * np.arange(count))

    @property
    def axis(self):
        return self.axis_px or ((self.size[0] - 1) / 2, (self.size[1] - 1) / 2)

    def key(self):
        """A short name of all that a white frame depends on."""
        return hashlib.sha256(repr(dataclasses.asdict(self)).encode()).hexdigest()[:12]


def gauss(f, distance):
    return 1 / (1 / f - 1 / distance)


def virtual_image(shell, distance):
    """l_O'A'' of Eqs. 1 to 4: inner vertex to the image of a point at `distance` from the outer vertex.

    Written with reciprocals, which stay finite where l_OA' does not.
    """
    vergence = ((shell.n_shell - shell.n_out) / shell.outer - shell.n_out / distance) / shell.n_shell
    reduced = vergence / (1 - (shell.outer - shell.inner) * vergence)  # 1 / l_O'A'
    return -1 / ((1 - shell.n_shell) / shell.inner + shell.n_shell * reduced)


def turn(tilt_x, tilt_y):
    """The matrix of a turn about x and then y; columns are the turned axes."""
    ax, ay = np.radians([tilt_x, tilt_y])
    about_x = np.array([[1, 0, 0], [0, np.cos(ax), -np.sin(ax)], [0, np.sin(ax), np.cos(ax)]])
    about_y = np.array([[np.cos(ay), 0, np.sin(ay)], [0, 1, 0], [-np.sin(ay), 0, np.cos(ay)]])
    return about_y @ about_x


# The structs of trace.c.
class CBoard(ctypes.Structure):
    _fields_ = [
        *[(name, ctypes.c_double * 3) for name in ("point", "along_x", "along_y", "normal")],
        *[(name, ctypes.c_double) for name in ("x_min", "x_max", "y_min", "y_max", "texel", "shift_x", "shift_y")],
        *[(name, ctypes.c_double) for name in ("low", "high")],
        ("texture", ctypes.c_void_p),
        *[(name, ctypes.c_int) for name in ("width", "height")],
    ]


class CScene(ctypes.Structure):
    _fields_ = [
        *[(n, ctypes.c_double) for n in ("b", "f_mla", "f", "pixel", "axis_x", "axis_y", "stop", "microlens")],
        *[(n, ctypes.c_double * 2) for n in ("first", "second", "origin")],
        ("array_turn", ctypes.c_double * 9), ("array_at", ctypes.c_double * 3),
        ("lens_turn", ctypes.c_double * 9), ("lens_at", ctypes.c_double * 3),
        ("shell_at", ctypes.c_double * 3),
        *[(n, ctypes.c_double) for n in ("inner", "outer", "n_shell", "n_out", "background")],
        *[(n, ctypes.c_int) for n in ("baffled", "boards")],
        ("board", CBoard * 8),
    ]  # fmt: skip


def tracer():
    """trace.c, compiled once a process."""
    if not hasattr(tracer, "library"):
        with tempfile.TemporaryDirectory() as folder:
            library = Path(folder) / "trace.so"
            compiler = [os.environ.get("CC", "cc"), "-O3", "-ffp-contract=off", "-shared", "-fPIC"]
            subprocess.run([*compiler, "-o", library, HERE / "trace.c", "-lm"], check=True)
            tracer.library = ctypes.CDLL(str(library))
    return tracer.library


def pointer(array):
    return array.ctypes.data_as(ctypes.c_void_p)


class Scene:
    """A camera before its boards, ready for trace.c. `textures` are arrays of 0 to 1, or None for white."""

    def __init__(self, camera, boards, textures=None):
        self.camera, self.boards = camera, boards
        s = self.c = CScene()
        s.b, s.f_mla, s.f, s.pixel = camera.b, camera.mla_focal_length, camera.main_lens_focal_length, camera.pixel_mm
        s.axis_x, s.axis_y = camera.axis
        s.stop, s.microlens = camera.stop_diameter / 2, camera.fill * camera.mla_pitch / 2
        along = np.radians(camera.rotation)
        other = along + np.radians(60 if camera.array == "hexagonal" else 90)
        self.first = camera.mla_pitch * np.array([np.cos(along), np.sin(along)])
        self.second = camera.mla_pitch * np.array([np.cos(other), np.sin(other)])
        self.origin = camera.offset[0] * self.first + camera.offset[1] * self.second
        s.first[:], s.second[:], s.origin[:] = self.first, self.second, self.origin
        self.array_turn, self.array_at = turn(*camera.array_tilt), np.array([0, 0, camera.d])
        self.lens_at = np.array([*camera.lens_decentre, 0.0])
        s.array_turn[:], s.array_at[:] = self.array_turn.ravel(), self.array_at
        s.lens_turn[:], s.lens_at[:] = turn(*camera.lens_tilt).ravel(), self.lens_at
        s.n_out = s.n_shell = 1.0
        vertex = 0.0
        if camera.e is not None:
            s.inner, s.outer = camera.shell.inner, camera.shell.outer
            s.n_shell, s.n_out = camera.shell.n_shell, camera.shell.n_out
            s.shell_at[:] = [*camera.shell_decentre, -camera.e]
            vertex = -camera.e - camera.shell.outer
        s.baffled, s.boards = int(camera.baffled), len(boards)
        self.textures = [None if t is None else np.ascontiguousarray(t, np.float32) for t in textures or [None] * 8]
        for board, c, texture in zip(boards, s.board, self.textures):
            axes = turn(board.tilt_x, board.tilt_y)
            c.along_x[:], c.along_y[:], c.normal[:] = axes[:, 0], axes[:, 1], axes[:, 2]
            c.point[:] = [0, 0, vertex - camera.board_distance(board)]
            c.x_min, c.x_max, c.y_min, c.y_max = -FAR, FAR, -FAR, FAR
            c.low, c.high = (board.low, board.high) if texture is not None else (0, 1)
            if texture is not None:
                c.texture, (c.height, c.width) = texture.ctypes.data, texture.shape
        for index, (board, c) in enumerate(zip(boards, s.board)):
            c.texel = 0.5 * board.scale * self.footprint(index)
            # The texture's middle on the axis, or beside it, as the seed has it.
            c.shift_x = c.width / 2 + 37.3 * (board.seed - 1)
            c.shift_y = c.height / 2 + 71.9 * (board.seed - 1)
            edges = (np.array(board.part) - 0.5) * camera.size[0] * camera.pixel_mm
            ends = self.chief(index, *self.seen_through(np.array([[x, 0] for x in edges])))[:, 0]
            low, high = board.part[0] > 0, board.part[1] < 1
            # The picture is upside down: a sensor's left is a board's right.
            ends, (low, high) = (ends, (low, high)) if ends[0] < ends[1] else (ends[::-1], (high, low))
            c.x_min, c.x_max = ends[0] if low else -FAR, ends[1] if high else FAR

    # Points of sensor and array are in the array's frame, mm.
    @property
    def lens_centre(self):
        return self.array_turn.T @ (self.lens_at - self.array_at)

    def seen_through(self, points):
        """For sensor points, the array's points on their chief rays, with the points themselves."""
        centre, b = self.lens_centre, self.camera.b
        return points + b / (b - centre[2]) * (centre[:2] - points), points

    def micro_image(self, centres):
        """Where the chief ray of a microlens, from the main lens's centre, meets the sensor."""
        m = self.lens_centre
        return centres + (centres - m[:2]) * self.camera.b / -m[2]

    def to_pixels(self, points):
        return points / self.camera.pixel_mm + np.array(self.camera.axis)

    def chief(self, board, centres, points):
        """Where rays from `points` through the centres of microlenses meet a board's plane."""
        centres, points = (np.ascontiguousarray(x, float) for x in (centres, points))
        out = np.empty_like(points)
        tracer().chief(
            ctypes.byref(self.c),
            board,
            ctypes.c_long(points.size // 2),
            pointer(centres),
            pointer(points),
            pointer(out),
        )
        return out

    def seen(self, board, centres, points, rays=256):
        """The same on the mean over the rays that pass the aperture, from all of a pixel and all of a microlens."""
        centres, points, samples = (np.ascontiguousarray(x, float) for x in (centres, points, sample_points(rays)))
        out = np.empty_like(points)
        tracer().seen(
            ctypes.byref(self.c),
            board,
            ctypes.c_long(points.size // 2),
            pointer(centres),
            pointer(points),
            rays,
            pointer(samples),
            pointer(out),
        )
        return out

    def direction(self, centres, points):
        centres, points = (np.ascontiguousarray(x, float) for x in (centres, points))
        out = np.empty((len(points), 3))
        tracer().direction(
            ctypes.byref(self.c), ctypes.c_long(len(points)), pointer(centres), pointer(points), pointer(out)
        )
        return out

    def footprint(self, board):
        """A pixel on the board, seen through the microlens on the axis, mm."""
        pixel = self.camera.pixel_mm
        ends = self.chief(board, np.zeros((2, 2)), np.array([[-pixel / 2, 0], [pixel / 2, 0]]))
        return abs(ends[1, 0] - ends[0, 0])

    def frame(self):
        """The frame without noise, 1 being white and unvignetted, as height x width."""
        width, height = self.camera.size
        out = np.empty((height, width), np.float32)
        samples = sample_points(self.camera.samples)
        tracer().render(ctypes.byref(self.c), width, height, len(samples), pointer(samples), pointer(out))
        return out


def sample_points(count):
    """Places in the pixel and on the microlens, -1 to 1: a Kronecker sequence and its mirror image.

    With each place goes the opposite one, so that the samples' mean is the centre: none shifts the picture.
    """
    golden = 1.1673039782614187  # the root of x^5 = x + 1, for four dimensions
    unit = (0.5 + np.arange(1, count // 2 + 1)[:, None] * golden ** -np.arange(1.0, 5.0)) % 1
    radius, angle = np.sqrt(unit[:, 2]), 2 * np.pi * unit[:, 3]
    half = np.column_stack([2 * unit[:, 0] - 1, 2 * unit[:, 1] - 1, radius * np.cos(angle), radius * np.sin(angle)])
    return np.ascontiguousarray(np.vstack([half, -half]))
