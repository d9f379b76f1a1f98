"""The frames there are: what each one is for, its camera, its boards, its sensor."""

from dataclasses import dataclass, field, replace

from camera import Board, Camera, Shell, gauss
from sensor import Sensor


@dataclass(frozen=True)
class Case:
    name: str
    why: str
    camera: Camera
    boards: tuple
    sensor: Sensor = field(default_factory=Sensor)
    seed: int = 1
    motion_px: float = 0.0  # change of spacing during the exposure, from half below to half above


def in_focus_delta_v(e, distance=800.0):
    """The Δv that has a board in water in focus (Eq. 8)."""
    camera = Camera(e=e)
    f = camera.main_lens_focal_length
    return gauss(f, camera.equivalent(distance)) - gauss(f, camera.design_distance)


def of_pitch(pitch_px, n, **settings):
    """A camera with micro-images of `pitch_px`; the microlenses keep the preset's shape."""
    pitch = pitch_px * 3.45e-3
    for _ in range(40):
        camera = Camera(mla_pitch=pitch, mla_focal_length=5 * pitch, angular_resolution=n, **settings)
        pitch *= pitch_px / camera.micro_image_pitch_px
    return camera


def small():
    for array, pitch, n in (
        ("hexagonal", 12, 2.2), ("square", 12, 2.2), ("hexagonal", 12, 3.13), ("square", 12, 4.0),
        ("hexagonal", 16, 2.5), ("square", 14, 3.0),
    ):  # fmt: skip
        camera = of_pitch(pitch, n, array=array, size=(280, 240), rotation=1.3, offset=(0.23, 0.41))
        for seed in (1, 2):
            board = Board(spacing_px=camera.target_px - 0.2 * seed, seed=seed)
            name = f"small_{array[:3]}_{pitch}_n{n}_{seed}"
            yield Case(name, "small micro-images", camera, (board,), Sensor(white_noise=1.0), seed=seed)


def pitches():
    sizes = {20: (240, 200), 30: (300, 270), 55: (400, 340), 75: (480, 400), 90: (540, 450)}
    index = 0
    for pitch, size in sizes.items():
        for array in ("square", "hexagonal"):
            for mode, n in (("galilean", 3.13), ("keplerian", 4.0)):
                index += 1
                e = 4.0 if index % 3 == 0 else None
                camera = of_pitch(
                    pitch, n, array=array, mode=mode, size=size, e=e, delta_v=0.0 if e is None else in_focus_delta_v(e),
                    rotation=(-6.2, 3.7, -1.9, 5.5, 0.6, 8.3, -3.4)[index % 7],
                    offset=(0.07 * index % 1, 0.19 * index % 1),
                )  # fmt: skip
                board = Board(spacing_px=camera.target_px - 0.012 * pitch, seed=index)
                why = f"pitch of {pitch} px" + (", through the shell" if e is not None else "")
                yield Case(
                    f"pitch_{pitch}_{array[:3]}_{mode[:3]}", why, camera, (board,), Sensor(noise=1.0), seed=index
                )


def fields():
    camera = Camera(size=(560, 300), rotation=0.4, offset=(0.2, 0.1))
    two = (Board(spacing_px=20.34, part=(0, 0.5)), Board(spacing_px=19.73, seed=2, part=(0.5, 1)))
    yield Case("two_boards", "two boards in one field", camera, two)
    step = (Board(spacing_px=19.73, part=(0, 0.8)), Board(spacing_px=19.83, seed=2, part=(0.8, 1)))
    yield Case("step_tenth", "a step of 0.1 px over a fifth of the field", camera, step, seed=2)
    step = (Board(spacing_px=19.83, seed=4, part=(0, 0.2)), Board(spacing_px=19.73, seed=3, part=(0.2, 1)))
    yield Case("step_tenth_left", "the same, nearer board on the left", camera, step, seed=3)
    for e in (0.0, 30.0):
        camera = Camera(e=e, delta_v=in_focus_delta_v(e), size=(480, 360), rotation=-0.7)
        yield Case(
            f"shell_flat_e{e:.0f}", "one flat board: no step to be seen", camera, (Board(distance=800.0),), seed=4
        )
    camera = Camera(e=0.0, delta_v=in_focus_delta_v(0.0), size=(480, 360), rotation=-0.7, array="hexagonal")
    yield Case(
        "shell_flat_hexagonal", "one flat board: no step to be seen", camera, (Board(distance=805.0, seed=2),), seed=5
    )


def text():
    camera = Camera(size=(360, 300), rotation=0.5)
    yield Case("text_near_focus", "printed text in air", camera, (Board(spacing_px=19.7, texture="text"),))
    camera = Camera(e=30.0, delta_v=2.2, size=(360, 300), rotation=0.5)
    yield Case("text_blurred", "printed text, 7 px out of focus", camera, (Board(distance=800.0, texture="text"),))


def triple():
    thirds, near = (0, 1 / 3, 2 / 3, 1), 167.17458588844983
    for name, delta_v, offsets, edges, tilt in (
        ("triple_dv0", 0.0, (-8, 0, 8), thirds, 0), ("triple_dv22", 2.2, (-8, 0, 8), thirds, 0),
        ("triple_reversed", 2.2, (8, 0, -8), thirds, 0), ("triple_middle_near", 2.2, (0, -8, 8), thirds, 0),
        ("triple_tilted", 2.2, (-8, 8, 0), thirds, 4), ("triple_narrow", 2.2, (-8, 0, 8), (0, 0.45, 0.6, 1), 0),
    ):  # fmt: skip
        camera = Camera(delta_v=delta_v, size=(600, 300), rotation=-0.3)
        boards = tuple(
            Board(distance=near + off, seed=i + 1, part=(edges[i], edges[i + 1]), tilt_x=tilt, tilt_y=-tilt / 2)
            for i, off in enumerate(offsets)
        )
        yield Case(name, "three boards side by side", camera, boards)


def pictures():
    camera = Camera(size=(360, 300), rotation=0.8, offset=(0.3, 0.6))
    for name in ("checkerboard", "charuco", "sine", "bars", "dots", "step", "flat"):
        yield Case(f"texture_{name}", f"a board with {name}", camera, (Board(spacing_px=19.6, texture=name),))


def blur():
    camera = Camera(size=(360, 300), rotation=-1.1, offset=(0.1, 0.7), samples=96)
    for off in (4, -4, -8, -12):
        near = "near" if off > 0 else "far"
        board = Board(spacing_px=camera.target_px + off, scale=1.3)
        yield Case(f"blur_{near}_{abs(off)}", f"{abs(off)} px out of focus, still", camera, (board,))
    camera = replace(camera, samples=48)
    for array in ("square", "hexagonal"):
        board = Board(spacing_px=19.7, seed=3)
        yield Case(
            f"moving_{array[:3]}", "moves during the exposure", replace(camera, array=array), (board,), motion_px=1.0
        )


def faults():
    base = Camera(size=(360, 300), rotation=0.6, offset=(0.45, 0.2))
    water = replace(base, e=5.0, delta_v=in_focus_delta_v(5.0))
    board = Board(spacing_px=19.65)
    shot = Sensor(noise=1.0, shot=5.0, black=12.0, white_noise=1.0)
    twelve, sixteen = Sensor(bits=12, noise=8.0, white_noise=2.0), Sensor(bits=16, noise=130.0, white_noise=32.0)
    open_array = replace(base, baffled=False, samples=24)
    for name, why, camera, boards, sensor in (
        ("tilt_board_10", "board turned", base, (replace(board, tilt_y=10.0),), Sensor()),
        ("tilt_board_25", "board turned", base, (replace(board, tilt_x=25.0, tilt_y=-8.0),), Sensor()),
        ("tilt_board_25_water", "board turned", water, (replace(board, tilt_y=25.0),), Sensor()),
        ("tilt_array", "array and sensor tilted", replace(base, array_tilt=(0.4, -0.3)), (board,), Sensor()),
        ("tilt_array_2", "array and sensor tilted", replace(base, array_tilt=(0.0, 2.0)), (board,), Sensor()),
        ("tilt_lens", "main lens tilted", replace(base, lens_tilt=(3.0, -2.0)), (board,), Sensor()),
        ("decentred_lens", "main lens beside the axis", replace(base, lens_decentre=(0.6, -0.4)), (board,), Sensor()),
        ("decentred_shell", "shell beside the axis", replace(water, shell_decentre=(3.0, -2.0)), (board,), Sensor()),
        ("noise_8", "read noise of 8", base, (board,), Sensor(noise=8.0, white_noise=2.0)),
        ("noise_shot", "photon noise, pedestal", base, (board,), shot),
        ("noise_columns", "columns' noise", base, (board,), Sensor(noise=1.0, column=3.0, row=1.0, white_noise=0.5)),
        ("dust", "dust, pixels' gains, falloff", base, (board,), Sensor(noise=1.0, fixed=0.01, dust=40, falloff=0.5)),
        ("contrast_2", "contrast of 2 %", base, (replace(board, low=0.49, high=0.51),), Sensor(noise=1.0)),
        ("contrast_10", "contrast of 10 %", base, (replace(board, low=0.45, high=0.55),), Sensor(noise=1.0)),
        ("saturated", "bright parts clipped, white frame not", base, (replace(board, low=0.2, high=1.7),), Sensor()),
        ("bayer", "a raw colour mosaic", base, (board,), Sensor(noise=1.0, bayer="RGGB")),
        ("unbaffled", "neighbours' light in each micro-image", open_array, (board,), Sensor()),
        ("stopped_down", "dark gaps between micro-images", replace(base, stop=0.75), (board,), Sensor()),
        ("bits_12", "12 bits in a file of 16", replace(base, size=(320, 280)), (board,), twelve),
        ("bits_16", "16 bits", replace(base, size=(260, 230)), (board,), sixteen),
    ):  # fmt: skip
        yield Case(name, why, camera, boards, sensor)


def out_of_range():
    camera = Camera(size=(330, 300), rotation=0.2)
    for spacing in (2.0, 38.0):
        yield Case(
            f"range_{spacing:.0f}", "spacing that no focus is near", camera, (Board(spacing_px=spacing, scale=1.5),)
        )
    camera = of_pitch(12, 2.2, array="hexagonal", size=(320, 280))
    yield Case("range_small_1", "spacing that no focus is near", camera, (Board(spacing_px=1.0, scale=1.5),))


# The wide field, of which the fixtures hold the truth of many cameras and one frame.
WIDE_SENSORS = ((4096, 3072), (6000, 4000))
WIDE_E = (0.0, 3.0, 10.0, 20.0, 30.0)
WIDE_DELTA_V = (0.0, 1.0, 1.7, 2.2, 2.3)
WIDE_SHELLS = (Shell(40.0, 32.0), Shell(59.0, 51.0), Shell(80.0, 72.0))


def wide(size=(4096, 3072), pixel_um=3.45):
    camera = Camera(e=30.0, delta_v=2.2045, size=size, pixel_um=pixel_um, samples=32)
    sensor = Sensor(noise=0.3, white=0.5)
    return Case(
        f"wide_{size[0]}", "a wide field through the shell", camera, (Board(distance=800.0, scale=2.0),), sensor
    )


def everything():
    for group in (small, pitches, fields, text, triple, pictures, blur, faults, out_of_range):
        yield from group()
