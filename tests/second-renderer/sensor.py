"""What a sensor makes of an ideal frame: vignetting of the lens, dust, gains, noise, clipping, depth."""

from dataclasses import dataclass

import numpy as np

BAYER = {"R": 0.62, "G": 1.0, "B": 0.48}  # what a filter lets through of a white board's light


@dataclass(frozen=True)
class Sensor:
    """All grey levels are of the frame's own depth."""

    bits: int = 8
    white: float = 0.82  # share of full scale that an unvignetted white board makes
    black: float = 0.0  # pedestal, grey levels
    noise: float = 2.0  # read noise: sigma of every pixel, grey levels
    shot: float = 0.0  # photon noise: sigma at full scale, grey levels; goes with the square root of the light
    white_noise: float = 0.0  # the white frame's read noise: mostly a mean of so many that only rounding is left
    column: float = 0.0  # sigma of what is added to a whole column, grey levels; drawn anew in every frame
    row: float = 0.0
    fixed: float = 0.0  # sigma of the pixels' gains about 1; the same in a frame and its white frame
    dust: int = 0  # specks, of 3 to 8 px, the same in a frame and its white frame
    falloff: float = 0.0  # share of the light that is lost in the frame's corners, with the distance squared
    bayer: str = ""  # "RGGB": colours of the first two rows; a raw mosaic of a grey board
    fixed_seed: int = 99


def expose(sensor, ideal, seed, white=False):
    """The frame as the file has it: unsigned integers, of 16 bits where the depth is above 8, low bits used first."""
    height, width = ideal.shape
    fixed, random = np.random.default_rng(sensor.fixed_seed), np.random.default_rng([seed, int(white)])
    light = ideal.astype(float) * sensor.white
    y, x = np.mgrid[0:height, 0:width]
    corner = ((x - (width - 1) / 2) ** 2 + (y - (height - 1) / 2) ** 2) / ((width / 2) ** 2 + (height / 2) ** 2)
    light *= 1 - sensor.falloff * corner
    for _ in range(sensor.dust):
        cx, cy, radius, depth = fixed.uniform([0, 0, 3, 0.15], [width, height, 8, 0.5])
        light *= 1 - depth * np.exp(-((((x - cx) ** 2 + (y - cy) ** 2) / radius**2) ** 2))
    if sensor.fixed:
        light *= 1 + sensor.fixed * fixed.standard_normal(light.shape)
    if sensor.bayer:
        gains = np.array([BAYER[colour] for colour in sensor.bayer]).reshape(2, 2)
        light *= np.tile(gains, ((height + 1) // 2, (width + 1) // 2))[:height, :width]
    full = 2**sensor.bits - 1
    read = sensor.white_noise if white else sensor.noise
    grey = sensor.black + full * light
    grey += np.sqrt(read**2 + sensor.shot**2 * np.clip(light, 0, None)) * random.standard_normal(light.shape)
    if not white:
        grey += sensor.column * random.standard_normal((1, width)) + sensor.row * random.standard_normal((height, 1))
    return np.clip(np.rint(grey), 0, full).astype(np.uint8 if sensor.bits == 8 else np.uint16)
