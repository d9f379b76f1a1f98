"""Holds the renderer against published numbers, against another renderer's frames, and against its own frames.

check.py [FIXTURES]   fails, with what does not agree, on the first check that is off
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

import cases
import exact
import render
from camera import Board, Camera, Scene, Shell

DATA = Path(__file__).parent.parent / "data"


def close(what, got, wanted, within):
    off = np.max(np.abs(np.asarray(got, float) - wanted))
    assert off <= within, f"{what}: {got} instead of {wanted}, off by {off:.3g}, allowed {within:g}"


def check_vectors():
    """Paraxial formulas, and the tracer close to the axis, against vectors.json."""
    for case in json.loads((DATA / "vectors.json").read_text())["cases"]:
        given, wanted = case["input"], case["expect"]
        camera = Camera(
            main_lens_focal_length=given["f"], mla_pitch=given["D_mla"], mla_focal_length=given["f_mla"],
            angular_resolution=given["N"], mode=given.get("mode", "galilean"), design_distance=given["d_obj_air"],
            shell=Shell(given["shell"]["Ro"], given["shell"]["Ri"], given["shell"]["ns"], given["shell"]["nw"]),
        )  # fmt: skip
        design = wanted["design"]
        close("a", abs(camera.a), design["a"], 1e-9)
        close("b", camera.b, design["b"], 1e-9)
        close("v", camera.v_design, design["v"], 1e-9)
        close("D_aper", camera.stop_diameter, design["clarity"]["D_aper"], 1e-9)
        close("l_target", camera.target_px * camera.pixel_mm, design["l_target"], 1e-9)
        for entry in wanted["equivalent_distance"]:
            there = replace(camera, e=entry["e"])
            close("l_A''M", there.equivalent(entry["d_obj"]), entry["l_eq"], 1e-8)
            close("its inverse", there.distance_of(entry["l_eq"]), entry["d_obj"], 1e-6)
        joint = replace(camera, delta_v=design["joint"]["delta_v"])
        for entry in wanted["spacing_vs_e"]:
            there = replace(joint, e=entry["e"])
            paraxial = there.spacing_px(there.equivalent(given["d_obj"])) * there.pixel_mm
            close("l_P0P1", paraxial, entry["spacing"], 1e-9)
            # The traced spacing of a camera with microlenses a hundred times smaller, seen by rays next to the axis.
            tiny = replace(there, mla_pitch=there.mla_pitch / 100, pixel_um=there.pixel_um / 100)
            scene = Scene(tiny, (Board(distance=given["d_obj"]),))
            traced = exact.on_axis(scene, 0, np.zeros((1, 2))) * there.pixel_mm
            close("traced l_P0P1 at the axis", traced, entry["spacing"], 2e-7)
        for entry in wanted["fov_water_rad"]:
            scene = Scene(replace(camera, e=entry["e"]), (Board(distance=given["d_obj"]),))
            half = np.tan(given["fov_inner"] / 2)
            lens = np.array([[half * camera.d, 0]])
            out = scene.direction(lens, scene.micro_image(lens))[0]
            close("field of view in water", 2 * np.arctan2(abs(out[0]), -out[2]), entry["fov"], 1e-9)


def check_published():
    """What the exact trace of the reference preset was found to be by other code: excess over paraxial, px."""
    for e, disc_means, edge, corner in (
        (0.0, (0.004, 0.006, 0.010, 0.017, 0.025), (0.097, 0.097), (0.19, 0.19)),
        (30.0, None, (0.15, 0.11), (0.29, 0.22)),
    ):
        camera = Camera(e=e, delta_v=cases.in_focus_delta_v(e))
        scene = Scene(camera, (Board(distance=800.0),))
        paraxial = camera.spacing_px(camera.equivalent(800.0))
        for radius, wanted in zip(render.RADII, disc_means or ()):
            close(f"mean within {radius} px", exact.on_axis(scene, 0, exact.disc(radius)) - paraxial, wanted, 0.0006)
        mm = 1 / camera.pixel_mm
        for place, wanted, toward in (((2 * mm, 0), edge, 0), ((2 * mm, 2 * mm), corner, 45)):
            for turned, value in zip((toward, toward + 90), wanted):
                got = exact.spacing(scene, 0, place, np.radians(turned), (0, 0))[0]
                close(f"e = {e} at {place}, {turned} degrees", got - paraxial, value, 0.006)


def check_referee():
    """The other renderer's frames: their truth from their cameras, and their pictures by correlation."""
    folder = DATA / "referee"
    for name, told in json.loads((folder / "truth.json").read_text())["frames"].items():
        frame, white = (np.asarray(Image.open(folder / f"{name}{end}.png"), float) for end in ("", "_white"))
        camera = Camera(
            main_lens_focal_length=told["main_lens_focal_length_mm"], mla_pitch=told["mla_pitch_mm"],
            mla_focal_length=told["mla_focal_length_mm"], angular_resolution=told["angular_resolution"],
            pixel_um=told["pixel_um"], delta_v=told["delta_v_mm"], e=told["e_mm"], array=told["array"],
            rotation=told["rotation_deg"], size=frame.shape[::-1],
        )  # fmt: skip
        close(f"{name}: d", camera.d, told["lens_to_mla_mm"], 1e-9)
        close(f"{name}: b", camera.b, told["mla_to_sensor_mm"], 1e-9)
        boards = told.get("boards") or [
            {
                "distance_mm": camera.distance_of(told["equivalent_distance_mm"]),
                "spacing_px": told["spacing_on_axis_px"],
            }
        ]
        for board in boards:
            close(
                f"{name}: spacing",
                camera.spacing_px(camera.equivalent(board["distance_mm"])),
                board["spacing_px"],
                1e-8,
            )
        lattice = lattice_offset(camera, told["a_micro_image_centre_px"])
        scene = Scene(replace(camera, offset=lattice), (Board(distance=boards[0]["distance_mm"]),))
        got = render.grid(scene)
        close(f"{name}: pitch", got["micro_image_pitch_px"], told["micro_image_pitch_px"], 1e-8)
        close(f"{name}: rotation", got["rotation_deg"], told["rotation_deg"], 1e-9)
        # Of three boards the first is on the sensor's right, for the picture is upside down.
        found, stated = brute_force(scene, 0, frame, white, (0.74, 1.0) if len(boards) > 1 else (0.0, 1.0))
        print(f"  {name}: correlation {found:.4f}, stated {stated:.4f}")
        close(f"{name}: spacing by correlation", found, stated, 0.03)


def lattice_offset(camera, centre_px):
    """The array's offset that puts a micro-image there."""
    scene = Scene(camera, ())
    lens = (np.array(centre_px) - camera.axis) * camera.pixel_mm * camera.d / (camera.d + camera.b)
    return tuple(np.linalg.solve(np.stack([scene.first, scene.second], -1), lens) % 1)


def bicubic(image, x, y):
    """Keys's cubic convolution at the places (x, y)."""
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    result = 0
    for j in range(-1, 3):
        for i in range(-1, 3):
            result = result + cubic(x - x0 - i) * cubic(y - y0 - j) * image[y0 + j, x0 + i]
    return result


def cubic(t):
    t = np.abs(t)
    return np.where(t < 1, (1.5 * t - 2.5) * t * t + 1, np.where(t < 2, ((-0.5 * t + 2.5) * t - 4) * t + 2, 0))


def brute_force(scene, board, frame, white, part=(0.0, 1.0), span=0.6):
    """The spacing by comparing neighbours' pictures at trial shifts, and the traced one for the same pairs.

    The traced spacing is that of all rays that pass the aperture, which is what a picture has.
    Differences are weighed by their noise: it is larger where less light arrives, which larger shifts lead away from.
    The traced spacings have the same weights.

    `part` is what the board takes of the frame's width.
    """
    camera = scene.camera
    picture = frame / np.maximum(white, 0.05 * white.max())
    lattice = np.stack([scene.first, scene.second], -1)
    reach = int(max(camera.size) / camera.micro_image_pitch_px) + 2
    i, j = np.meshgrid(*[np.arange(-reach, reach + 1)] * 2)
    lenses = scene.origin + np.stack([i.ravel(), j.ravel()], -1) @ lattice.T
    guess = camera.spacing_px(camera.equivalent(camera.board_distance(scene.boards[board])))
    window = exact.window(camera, guess)
    trials = guess + span * np.arange(-6, 7) / 6
    misses, stated, weights = np.zeros(len(trials)), [], []
    for direction in camera.directions:
        along = np.array([np.cos(direction), np.sin(direction)])
        middles = lenses + along * camera.mla_pitch / 2
        places = scene.to_pixels(scene.micro_image(middles))
        margin = camera.micro_image_pitch_px
        side = np.array(camera.size) - 1
        kept = np.all((places > margin) & (places < side - margin), -1)
        kept &= (places[:, 0] > part[0] * side[0]) & (places[:, 0] < part[1] * side[0])
        places = places[kept]
        turned = window @ np.array([[along[0], along[1]], [-along[1], along[0]]])
        points = (places[:, None] + turned).reshape(-1, 2)
        for k, trial in enumerate(trials):
            ends = [(points + sign * trial / 2 * along).T for sign in (-1, 1)]
            left, right = (bicubic(picture, *end) for end in ends)
            variance = sum(1 / np.maximum(bicubic(white, *end), 0.05 * white.max()) ** 2 for end in ends)
            misses[k] += ((left - right) ** 2 / variance).sum()
            if trial == guess:
                weights.append(1 / variance)
        # A few thousand of all points tell the mean.
        few = slice(None, None, len(points) // 3000 + 1)
        rows = np.repeat(places - camera.axis, len(window), 0)[few]
        stated.append(exact.spacing(scene, board, rows, direction, np.tile(turned, (len(places), 1))[few], scene.seen))
        weights[-1] = weights[-1][few]
    best = int(np.argmin(misses))
    assert 0 < best < len(trials) - 1, f"no minimum near {guess}"
    # The miss is a smooth function of the shift: a parabola through the five lowest trials.
    near = slice(max(best - 2, 0), best + 3)
    c2, c1, _ = np.polyfit(trials[near] - trials[best], misses[near], 2)
    return trials[best] - c1 / (2 * c2), float(np.average(np.concatenate(stated), weights=np.concatenate(weights)))


def check_own():
    """Noiseless frames with pixels half the size have the spacing that their truth states, to 0.01 px."""
    shell = {"e": 0.0, "delta_v": cases.in_focus_delta_v(0.0)}
    base = Camera(size=(440, 400), pixel_um=1.725, rotation=0.7, offset=(0.2, 0.35), samples=128)
    air, water = Board(spacing_px=39.6, scale=2.0), Board(distance=800.0, scale=2.0)
    hexagonal = replace(base, array="hexagonal")
    small = cases.of_pitch(12, 2.2, array="hexagonal", size=(360, 320), samples=128)
    large = cases.of_pitch(75, 3.13, array="hexagonal", size=(480, 440), samples=128)
    for name, camera, board in (
        ("square in air", base, air),
        ("hexagonal in air", hexagonal, replace(air, spacing_px=39.2)),
        ("square in water", replace(base, **shell), water),
        ("hexagonal in water, e = 30", replace(hexagonal, e=30.0, delta_v=1.745), water),
        ("keplerian", replace(base, mode="keplerian", angular_resolution=4.0), replace(air, spacing_px=71.9)),
        ("tilted board", base, replace(air, tilt_y=15.0)),
        ("tilted and decentred", replace(base, array_tilt=(0.4, -0.3), lens_decentre=(0.5, 0.2)), air),
        ("decentred shell", replace(base, shell_decentre=(3.0, -2.0), **shell), water),
        ("small", replace(small, pixel_um=1.725), replace(air, spacing_px=2 * small.target_px - 0.4)),
        ("large", large, replace(air, spacing_px=large.target_px - 0.9)),
        ("1 px out of focus", base, replace(air, spacing_px=41.5)),
    ):  # fmt: skip
        case = cases.Case(name, "", camera, (board,))
        scene, white = Scene(camera, render.held(case)), render.white(camera)
        found, stated = brute_force(scene, 0, render.ideal(case), white)
        found, stated = found * camera.pixel_um / 3.45, stated * camera.pixel_um / 3.45
        print(f"  {name}: correlation {found:.4f}, stated {stated:.4f} px of 3.45 um")
        close(f"{name}: spacing by correlation", found, stated, 0.01)
        check_centres(name, scene, white)


def check_centres(name, scene, white):
    """Micro-images of a noiseless white frame are where the grid says: the centre of each one's light."""
    camera, grid = scene.camera, render.grid(scene)
    basis, pitch = np.array(grid["micro_image_basis_px"]).T, grid["micro_image_pitch_px"]
    y, x = np.mgrid[0 : white.shape[0], 0 : white.shape[1]]
    misses = []
    for i in range(-2, 3):
        for j in range(-2, 3):
            centre = np.array(grid["a_micro_image_centre_px"]) + basis @ [i, j]
            if min(*centre, *(np.array(camera.size) - 1 - centre)) < 0.6 * pitch:
                continue
            # A soft disc; what it has of neighbours' light lies as evenly about the centre.
            off_x, off_y = x - centre[0], y - centre[1]
            light = white * np.clip(1 - (off_x**2 + off_y**2) / (0.6 * pitch) ** 2, 0, None) ** 2
            misses.append([(light * off_x).sum() / light.sum(), (light * off_y).sum() / light.sum()])
    close(f"{name}: micro-image centres, mean miss", np.mean(misses, 0), 0, 0.02)


def check_fixtures(folder):
    """Every frame has its truth, every truth its frames; one small frame comes out again as it is."""
    told = json.loads((folder / "truth.json").read_text())["frames"]
    there = {path.name for path in folder.glob("*.png")}
    named = {frame[key] for frame in told.values() for key in ("frame", "white")}
    assert there == named, f"frames without truth, or truth without frames: {sorted(there ^ named)}"
    for name, frame in told.items():
        for key in ("frame", "white"):
            size = Image.open(folder / frame[key]).size
            assert list(size) == frame["size_px"], f"{name}: {size} px"
    every = {case.name: case for case in cases.everything()}
    assert set(every) <= set(told), f"not rendered: {sorted(set(every) - set(told))}"
    for name, case in every.items():
        scene = Scene(case.camera, render.held(case))
        window = exact.window(case.camera, told[name]["boards"][0]["spacing_px"])
        assert told[name]["sensor"] == vars(case.sensor), f"{name}: another sensor now"
        close(
            f"{name}: spacing",
            exact.on_axis(scene, 0, window),
            told[name]["boards"][0]["spacing_exact_window_px"],
            2e-6,
        )
        close(f"{name}: grid", render.grid(scene)["micro_image_basis_px"], told[name]["micro_image_basis_px"], 1e-6)
    case = every["small_squ_12_n2.2_1"]
    again = render.expose(case.sensor, render.ideal(case), case.seed)
    off = np.abs(again.astype(int) - np.asarray(Image.open(folder / f"{case.name}.png")))
    assert off.max() <= 1 and (off > 0).mean() < 0.001, f"{case.name} comes out otherwise, by up to {off.max()}"


def main():
    folder = Path(sys.argv[1]) if sys.argv[1:] else DATA / "second"
    for check, *given in (
        (check_vectors,),
        (check_published,),
        (check_referee,),
        (check_own,),
        (check_fixtures, folder),
    ):
        print(check.__name__, flush=True)
        check(*given)
    print("all agree")


if __name__ == "__main__":
    main()
