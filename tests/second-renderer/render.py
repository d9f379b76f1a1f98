"""Renders the fixtures: frames, white frames, and the truth about them.

render.py OUT [NAME...]   the named frames, all of them where no name is given, with truth.json
render.py OUT --fields    wide.json: fields of exact spacings of many cameras over large sensors
render.py OUT --wide SIZE [PIXEL_UM]   a wide frame, SIZE such as 4096x3072, with its truth.json
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

import cases
import exact
import textures
from camera import Board, Camera, Scene
from sensor import expose

NOTE = (
    "Frames of the second renderer, which traces rays exactly and shares nothing with the program. Pixel centres at "
    "integers, x right, y down; angles from +x towards +y. spacing_on_axis_px is paraxial; the other spacings are "
    "traced: see README.md beside the renderer."
)
RADII = (0.0, 4.0, 6.0, 9.0, 11.5)
EXPOSURE_STEPS = 9


def textures_of(boards, size=1024):
    return [None if b.texture == "white" else textures.draw(b.texture, b.seed, size) for b in boards]


def exposures(case):
    """The cameras that an exposure passes through, one if nothing moves."""
    camera, board = case.camera, case.boards[0]
    if not case.motion_px:
        return [camera]
    equivalent, still = camera.equivalent(camera.board_distance(board)), 1e-4
    slope = (
        replace(camera, delta_v=camera.delta_v + still).spacing_px(equivalent) - camera.spacing_px(equivalent)
    ) / still
    steps = (np.arange(EXPOSURE_STEPS) + 0.5) / EXPOSURE_STEPS - 0.5
    return [replace(camera, delta_v=camera.delta_v + case.motion_px * step / slope) for step in steps]


def held(case):
    """The boards where they are: at distances, which do not move with the camera."""
    return tuple(replace(b, spacing_px=0.0, distance=case.camera.board_distance(b)) for b in case.boards)


def ideal(case, size=1024):
    boards = held(case)
    drawn = textures_of(boards, size)
    return np.mean([Scene(camera, boards, drawn).frame() for camera in exposures(case)], 0)


def white(camera):
    return Scene(camera, (Board(distance=800.0, texture="white"),)).frame()


def rounded(value, digits=5):
    return np.round(np.asarray(value, float), digits).tolist()


def field_of(scene, board, columns, rows, window):
    """Spacings on a coarse grid over the sensor: columns and rows are px from the axis."""
    x, y = np.meshgrid(columns, rows)
    parts = exact.harmonics(scene, board, np.stack([x.ravel(), y.ravel()], -1), window).reshape(*x.shape, 3)
    return {name: rounded(parts[..., i], 4) for i, name in enumerate(("mean", "cos2", "sin2"))}


def truth(case):
    camera, boards = case.camera, held(case)
    scene = Scene(camera, boards)
    c = case.sensor
    result = {
        "why": case.why,
        "main_lens_focal_length_mm": camera.main_lens_focal_length,
        "mla_pitch_mm": camera.mla_pitch,
        "mla_focal_length_mm": camera.mla_focal_length,
        "angular_resolution": camera.angular_resolution,
        "mode": camera.mode,
        "pixel_um": camera.pixel_um,
        "size_px": list(camera.size),
        "lens_to_mla_mm": camera.d,
        "mla_to_sensor_mm": camera.b,
        "design_distance_mm": camera.design_distance,
        "delta_v_mm": camera.delta_v,
        "aperture_mm": camera.stop_diameter,
        "e_mm": camera.e,
        "shell": None if camera.e is None else vars(camera.shell),
        "array": camera.array,
        "baffled": camera.baffled,
        "array_tilt_deg": list(camera.array_tilt),
        "lens_tilt_deg": list(camera.lens_tilt),
        "lens_decentre_mm": list(camera.lens_decentre),
        "shell_decentre_mm": list(camera.shell_decentre),
        **grid(scene),
        "noise_sigma_grey_levels": c.noise,
        "sensor": vars(c),
        "motion_px": case.motion_px,
        "target_spacing_px": camera.target_px,
    }
    positions = [(0.5 + np.arange(5) - 2.5) / 5 * (side - camera.micro_image_pitch_px) for side in camera.size]
    radii = [r for r in RADII if r < 0.45 * camera.micro_image_pitch_px]
    told = []
    for index, board in enumerate(boards):
        equivalent = camera.equivalent(board.distance)
        middle = ((sum(board.part) / 2 - 0.5) * camera.size[0], 0.0)
        paraxial = camera.spacing_px(equivalent)
        window = exact.window(camera, paraxial)
        width = camera.size[0] - 1
        columns = (
            positions[0]
            if len(boards) == 1
            else [(s * board.part[1] + (1 - s) * board.part[0] - 0.5) * width for s in (0.25, 0.75)]
        )
        told.append({
            "distance_mm": board.distance,
            "equivalent_distance_mm": equivalent,
            "texture": board.texture,
            "tilt_deg": [board.tilt_x, board.tilt_y],
            "columns_px": [board.part[0] * camera.size[0] - 0.5, board.part[1] * camera.size[0] - 0.5],
            "spacing_px": paraxial,
            "spacing_exact_px": round(exact.on_axis(scene, index, np.zeros((1, 2))), 6),
            "spacing_exact_by_radius_px": {str(r): round(exact.on_axis(scene, index, exact.disc(r)), 6) for r in radii},
            "spacing_exact_window_px": round(exact.on_axis(scene, index, window), 6),
            "spacing_seen_window_px": round(exact.on_axis(scene, index, window, look=scene.seen), 6),
            "spacing_exact_at_middle_px": round(exact.on_axis(scene, index, window, middle), 6),
            "field": {
                "x_px": rounded(np.add(columns, camera.axis[0]), 2),
                "y_px": rounded(np.add(positions[1], camera.axis[1]), 2),
                "pointwise": field_of(scene, index, columns, positions[1], np.zeros((1, 2))),
                "window": field_of(scene, index, columns, positions[1], window),
            },
        })  # fmt: skip
    first = told[0]
    if len(told) == 1:
        result |= {
            "distance_mm": first["distance_mm"],
            "equivalent_distance_mm": first["equivalent_distance_mm"],
            "spacing_on_axis_px": first["spacing_px"],
            "spacing_exact_on_axis_px": first["spacing_exact_px"],
            "spacing_exact_window_px": first["spacing_exact_window_px"],
            "spacing_seen_window_px": first["spacing_seen_window_px"],
        }
    return result | {"boards": told}


def grid(scene):
    """The lattice of micro-images at the frame's centre, from the chief rays of its microlenses."""
    camera = scene.camera
    centre = np.array([(side - 1) / 2 for side in camera.size])
    place = scene.seen_through((centre - camera.axis)[None] * camera.pixel_mm)[0][0]
    lattice = np.stack([scene.first, scene.second], -1)
    lens = scene.origin + lattice @ np.rint(np.linalg.solve(lattice, place - scene.origin))
    here, *ends = scene.to_pixels(scene.micro_image(np.array([lens, lens + scene.first, lens + scene.second])))
    first, second = (end - here for end in ends)
    return {
        "micro_image_pitch_px": float(np.mean([np.hypot(*first), np.hypot(*second)])),
        "rotation_deg": float(np.degrees(np.arctan2(first[1], first[0]))),
        "a_micro_image_centre_px": here.tolist(),
        "micro_image_basis_px": [first.tolist(), second.tolist()],
    }


def fields():
    """wide.json: a quadrant of the field, which the other three mirror, for every camera of the wide lists."""
    frames = []
    for size in cases.WIDE_SENSORS:
        for shell in cases.WIDE_SHELLS:
            for e in cases.WIDE_E:
                for delta_v in cases.WIDE_DELTA_V:
                    camera = Camera(e=e, delta_v=delta_v, shell=shell, size=size)
                    scene = Scene(camera, (Board(distance=800.0),))
                    paraxial = camera.spacing_px(camera.equivalent(800.0))
                    columns, rows = np.linspace(0, size[0] / 2, 7), np.linspace(0, size[1] / 2, 5)
                    coarse = exact.disc(0.3 * camera.micro_image_pitch_px, 2.0)
                    frames.append({
                        "size_px": list(size), "shell": vars(shell), "e_mm": e, "delta_v_mm": delta_v,
                        "spacing_on_axis_px": paraxial,
                        "spacing_exact_window_px": round(exact.on_axis(scene, 0, exact.window(camera, paraxial)), 5),
                        "x_from_axis_px": rounded(columns, 1), "y_from_axis_px": rounded(rows, 1),
                        "pointwise": field_of(scene, 0, columns, rows, np.zeros((1, 2))),
                        "window": field_of(scene, 0, columns, rows, coarse),
                    })  # fmt: skip
    return {
        "note": NOTE + " The reference preset's camera, a board at 800 mm in water; x, y >= 0 of the axis.",
        "cameras": frames,
    }


def without_nan(value):
    """JSON has no NaN: null stands where there is no such spacing."""
    if isinstance(value, dict):
        return {k: without_nan(v) for k, v in value.items()}
    if isinstance(value, list):
        return [without_nan(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def save_json(path, told):
    """One line a member: to be read and compared."""
    told = without_nan(told)
    group = next(name for name in ("frames", "cameras") if name in told)
    lines = []
    if group == "frames":
        for name, frame in sorted(told[group].items()):
            members = ",\n".join(f"   {json.dumps(k)}: {json.dumps(v)}" for k, v in frame.items())
            lines.append(f"  {json.dumps(name)}: {{\n{members}\n  }}")
        body = "{\n" + ",\n".join(lines) + "\n }"
    else:
        body = "[\n" + ",\n".join("  " + json.dumps(camera) for camera in told[group]) + "\n ]"
    path.write_text(
        f'{{\n "note": {json.dumps(told["note"])},\n "licence": "MIT OR Apache-2.0",\n "{group}": {body}\n}}\n'
    )


def save_frame(path, grey):
    Image.fromarray(grey).save(path, optimize=True)


def white_key(case):
    """What a white frame depends on: the camera, and all of the sensor but the noise of a single frame."""
    return case.camera.key(), replace(case.sensor, noise=0.0, column=0.0, row=0.0)


def render(out, wanted, size=1024):
    """Renders cases into `out`, and adds them to what its truth.json has."""
    path = out / "truth.json"
    told = json.loads(path.read_text()) if path.exists() else {"frames": {}}
    told["note"] = NOTE
    # Frames of the same camera and sensor share a white frame, named after the first of them.
    owners = {}
    for case in [*cases.everything(), *wanted]:
        owners.setdefault(white_key(case), case.name)
    for case in wanted:
        save_frame(out / f"{case.name}.png", expose(case.sensor, ideal(case, size), case.seed))
        name = f"{owners[white_key(case)]}_white"
        if not (out / f"{name}.png").exists() or owners[white_key(case)] == case.name:
            save_frame(out / f"{name}.png", expose(case.sensor, white(case.camera), 1, white=True))
        told["frames"][case.name] = {"frame": f"{case.name}.png", "white": f"{name}.png"} | truth(case)
        save_json(path, told)
        print(case.name, flush=True)


def main():
    out, *rest = Path(sys.argv[1]), *sys.argv[2:]
    out.mkdir(parents=True, exist_ok=True)
    if rest[:1] == ["--fields"]:
        save_json(out / "wide.json", fields())
    elif rest[:1] == ["--wide"]:
        size = tuple(int(n) for n in rest[1].split("x"))
        render(out, [cases.wide(size, float(rest[2]) if rest[2:] else 3.45)], 2048)
    else:
        every = {case.name: case for case in cases.everything()}
        render(out, [every[name] for name in rest] or list(every.values()))


if __name__ == "__main__":
    main()
