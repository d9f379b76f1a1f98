"""The exact spacing: traced chief rays, no formula of thin shells or small angles.

A pair of neighbouring microlenses stands astride a place of the field, its direction n. A sensor point p is seen
through the first; the board's point X on that ray is sought under the second by Newton's iteration over the sensor.
The spacing is (p' - p) . n. The microlenses of such a pair need not be of the lattice, so that the spacing is a smooth
function of the place, of the direction and of where within the micro-images one looks: the mean of the two points'
places, each from the centre of its own micro-image, which is u. u = 0 is "pointwise".
"""

import numpy as np


def spacing(scene, board, places, direction, within_px, look=None):
    """Exact spacings in px at sensor `places` (px from the axis, n x 2) for `within_px` (u, n x 2).

    `look` says where a point of the sensor sees the board: by its chief ray (scene.chief, unless given) or on the
    mean over the rays that pass the aperture (scene.seen).
    """
    camera, look = scene.camera, look or scene.chief
    pixel = camera.pixel_mm
    places, within = np.atleast_2d(places) * pixel, np.atleast_2d(within_px) * pixel
    along = np.broadcast_to(np.stack([np.cos(direction), np.sin(direction)], -1), places.shape)
    middle = scene.seen_through(places)[0]
    first, second = middle - along * camera.mla_pitch / 2, middle + along * camera.mla_pitch / 2
    guess = camera.spacing_px(camera.equivalent(camera.board_distance(scene.boards[board]))) * pixel
    apart = scene.micro_image(second) - scene.micro_image(first)
    p = scene.micro_image(first) + within + (apart - along * guess) / 2
    wanted = look(board, first, p)
    other, step = p + along * guess, pixel * 0.1
    for _ in range(6):
        miss = look(board, second, other) - wanted
        columns = [(scene.chief(board, second, other + h) - scene.chief(board, second, other - h)) / (2 * step)
                   for h in (np.array([step, 0]), np.array([0, step]))]  # fmt: skip
        (a, c), (b, d) = (columns[0].T, columns[1].T)
        area = a * d - b * c
        other = other - np.stack(
            [(d * miss[:, 0] - b * miss[:, 1]) / area, (a * miss[:, 1] - c * miss[:, 0]) / area], -1
        )
    return ((other - p) * along).sum(-1) / pixel


def disc(radius, step=1.0):
    """Places spread evenly within a disc about 0, px: one on step x step px, as seeds in a sunflower, and mirrored.

    No two lie alike upon the pixels, so that what interpolation between these does wrong averages out.
    """
    count = int(np.pi * (radius / step) ** 2 / 2) + 1
    k = np.arange(count)
    way, angle = radius * np.sqrt((k + 0.5) / count), k * np.pi * (3 - np.sqrt(5))
    half = np.stack([way * np.cos(angle), way * np.sin(angle)], -1)
    return np.concatenate([half, -half]) if radius else np.zeros((1, 2))


def window(camera, spacing_px):
    """The window that fixtures state spacings for: u within 0.3 of the micro-image pitch of the centre, and both
    points within 0.47 of it from the centre of their own micro-image."""
    pitch = camera.micro_image_pitch_px
    within = disc(0.3 * pitch, max(1.0, pitch / 30))
    half = (pitch - spacing_px) / 2
    return (
        within[np.hypot(np.abs(within[:, 0]) + abs(half), within[:, 1]) <= 0.47 * pitch]
        if abs(half) < 0.3 * pitch
        else disc(0.1 * pitch)
    )


def harmonics(scene, board, places, within, look=None):
    """At each place the window's mean, as m + c cos 2 phi + s sin 2 phi over the pair's direction phi: (m, c, s)."""
    places = np.atleast_2d(places)
    rows = np.repeat(places, len(within), 0)
    values = []
    for direction in np.radians([0, 60, 120]):
        turned = within @ np.array([[np.cos(direction), np.sin(direction)], [-np.sin(direction), np.cos(direction)]])
        values.append(
            spacing(scene, board, rows, direction, np.tile(turned, (len(places), 1)), look)
            .reshape(len(places), -1)
            .mean(1)
        )
    l0, l60, l120 = values
    return np.stack([(l0 + l60 + l120) / 3, (2 * l0 - l60 - l120) / 3, (l60 - l120) / np.sqrt(3)], -1)


def on_axis(scene, board, within, place=(0.0, 0.0), look=None):
    """Mean over the directions of the array's neighbours, at one place."""
    mean, cos2, sin2 = harmonics(scene, board, place, within, look)[0]
    phi = scene.camera.directions
    return float((mean + cos2 * np.cos(2 * phi) + sin2 * np.sin(2 * phi)).mean())
