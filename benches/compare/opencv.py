"""The usual tools on the same frames: OpenCV and NumPy beside this program's figures.

Grid: adaptive threshold and connected components of the white frame, intensity-weighted centroid of every micro-image.
Spacing: masked, normalised cross-correlation of every pair of neighbours over whole-pixel shifts, a parabola through the
best and its neighbours, the median over all pairs. (Plain phase correlation of micro-images locks to their vignette.)

Reads the frames and figures that the benchmark `compare` wrote into FOLDER, prints one table of both, and leaves both as
comparison.json there, for the table of all benchmarks.
"""

import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np

# Best of so many runs, as on the other side.
RUNS = 3
FIGURES = ("grid_ms", "grid_error_px", "spacing_ms", "spacing_error_px")
# And of the live measurement, which is of the spacing, too.
LIVE = {"live_ms": "spacing_ms", "live_error_px": "spacing_error_px"}
# Share of the micro-image's radius that is compared.
MASK = 0.6


def best_of(work):
    """The result of `work`, and its shortest time in milliseconds."""
    shortest, result = float("inf"), None
    for _ in range(RUNS):
        start = time.perf_counter()
        result = work()
        shortest = min(shortest, time.perf_counter() - start)
    return result, 1e3 * shortest


def lattice(frame):
    """The true micro-image centres, and their lattice indices."""
    (ax, ay), (bx, by) = frame["basis_px"]
    cx, cy = frame["centre_px"]
    height, width = frame["height"], frame["width"]
    reach = int(max(width, height) / frame["pitch_px"]) + 2
    i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1))
    x, y = cx + i * ax + j * bx, cy + i * ay + j * by
    margin = frame["pitch_px"] * 0.75
    inside = (x > margin) & (y > margin) & (x < width - 1 - margin) & (y < height - 1 - margin)
    return np.stack([x[inside], y[inside]], 1), np.stack([i[inside], j[inside]], 1)


def components(white, pitch):
    """Centroids of the micro-images, px."""
    block = int(pitch) | 1
    binary = cv2.adaptiveThreshold(white, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY, block, 0)
    binary = cv2.erode(binary, np.ones((3, 3), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(binary)
    weight = white.astype(np.float64).ravel()
    flat = labels.ravel()
    ys, xs = np.divmod(np.arange(flat.size), white.shape[1])
    total = np.bincount(flat, weight, count)
    centres = np.stack(
        [np.bincount(flat, weight * axis, count) / np.maximum(total, 1) for axis in (xs, ys)], 1
    )
    area = stats[:, cv2.CC_STAT_AREA]
    good = (area > 0.2 * pitch**2) & (area < 1.2 * pitch**2)
    good[0] = False
    return centres[good]


def grid_error(found, truth):
    """Root mean square distance of the centroids from the nearest true centre, px."""
    if len(found) == 0:
        return float("nan")
    squares = []
    for chunk in np.array_split(found, max(1, len(found) // 500)):
        distance = np.linalg.norm(chunk[:, None, :] - truth[None, :, :], axis=2).min(1)
        squares.append(distance[distance < 5] ** 2)
    return float(np.sqrt(np.concatenate(squares).mean()))


def correlation_spacing(raw, white, frame, centres, indices):
    """Median over all pairs of the spacing with the best masked, normalised cross-correlation, px."""
    even = raw.astype(np.float32) / np.maximum(white.astype(np.float32), 20)
    places = {tuple(index): k for k, index in enumerate(indices)}
    radius = MASK * frame["pitch_px"] / 2
    reach = int(np.ceil(radius))
    dy, dx = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    expected = frame["spacing_px"]
    steps = [(1, 0), (0, 1)] + ([(-1, 1)] if frame["array"] == "hexagonal" else [])
    found = []
    for step in steps:
        pairs = [
            (k, places[(i + step[0], j + step[1])])
            for (i, j), k in places.items()
            if (i + step[0], j + step[1]) in places
        ]
        a, b = centres[[p[0] for p in pairs]], centres[[p[1] for p in pairs]]
        unit = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
        # The window sits between the two images of the same points: both stay within their masks.
        half = (np.linalg.norm(b - a, axis=1, keepdims=True) - expected) / 2
        origin = np.rint(a + unit * half).astype(int)
        inner = dx**2 + dy**2 <= (radius - half.mean()) ** 2 if radius - half.mean() > 4 else dx**2 + dy**2 <= 16
        oy, ox = dy[inner], dx[inner]

        def patches(centre):
            values = even[centre[:, 1, None] + oy, centre[:, 0, None] + ox]
            values = values - values.mean(1, keepdims=True)
            return values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-9)

        reference = patches(origin)
        shifts = np.arange(int(expected) - 2, int(expected) + 4)
        targets = [np.rint(origin + unit * s).astype(int) for s in shifts]
        along = np.stack([((t - origin) * unit).sum(1) for t in targets], 1)
        scores = np.stack([(reference * patches(t)).sum(1) for t in targets], 1)
        best = np.clip(scores.argmax(1), 1, len(shifts) - 2)
        rows = np.arange(len(best))
        left, middle, right = scores[rows, best - 1], scores[rows, best], scores[rows, best + 1]
        curve = left - 2 * middle + right
        sub = np.where(curve < -1e-6, 0.5 * (left - right) / np.where(curve < -1e-6, curve, -1), 0)
        good = (middle > 0.7) & (np.abs(sub) < 1)
        found.append((along[rows, best] + sub)[good])
    found = np.concatenate(found)
    return float(np.median(found)) if len(found) else float("nan")


def main(folder):
    figures = json.loads((folder / "frames.json").read_text())
    header = ["frame", "", "grid ms", "grid error px", "spacing ms", "spacing error px"]
    lines, ratios, compared = [], [], []
    for frame in figures["frames"]:
        white = cv2.imread(str(folder / frame["white"]), cv2.IMREAD_GRAYSCALE)
        raw = cv2.imread(str(folder / frame["raw"]), cv2.IMREAD_GRAYSCALE)
        centres, indices = lattice(frame)
        found, grid_ms = best_of(lambda: components(white, frame["pitch_px"]))
        spacing, spacing_ms = best_of(lambda: correlation_spacing(raw, white, frame, centres, indices))
        theirs = [grid_ms, grid_error(found, centres), spacing_ms, abs(spacing - frame["spacing_px"])]
        ours = [frame[key] for key in FIGURES]
        live = frame.get("live_ms")
        lines.append([frame["name"], "plenalign"] + [f"{v:.4g}" for v in ours])
        if live is not None:
            lines.append(["", "plenalign, live", "", "", f"{live:.4g}", f"{frame['live_error_px']:.4g}"])
        lines.append(["", "OpenCV, NumPy"] + [f"{v:.4g}" for v in theirs])
        their_figures = dict(zip(FIGURES, theirs))
        their_figures |= {key: their_figures[of] for key, of in LIVE.items() if key in frame}
        compared.append(
            {"name": frame["name"], "ours": {key: frame[key] for key in their_figures}, "theirs": their_figures}
        )
        ratio = [t / max(o, 1e-9) for t, o in zip(theirs, ours)]
        if live is not None:
            ratio[2] = theirs[2] / live
        lines.append(["", "ratio"] + [f"{v:.3g}" for v in ratio])
        ratios.append(ratio)
    versions = [f"OpenCV {cv2.__version__}", f"NumPy {np.__version__}"]
    comparison = {"tools": "OpenCV, NumPy", "versions": versions, "frames": compared}
    (folder / "comparison.json").write_text(json.dumps(comparison, indent=2))
    widths = [max(len(row[k]) for row in [header] + lines) for k in range(len(header))]
    for row in [header] + lines:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip())
    typical = np.exp(np.mean(np.log(np.maximum(np.array(ratios), 1e-9)), axis=0))
    print("geometric mean of the ratios (theirs over ours; spacing time: live where there is one): "
          f"grid time {typical[0]:.3g}, grid error {typical[1]:.3g}, "
          f"spacing time {typical[2]:.3g}, spacing error {typical[3]:.3g}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
