"""Textures of boards, drawn here: arrays of 0 to 1 that repeat. A texel is half a pixel's footprint at scale 1."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

WORDS = (
    "Underwater plenoptic cameras see a board through a shell of two spheres "
    "and tell how far the water bends its light 0123456789"
).split(" ")


def draw(name, seed, size=1024):
    return np.clip(globals()["_" + name](np.random.default_rng(seed), size), 0, 1).astype(np.float32)


def _natural(random, size):
    """1/f noise, as scenes have it: flat above 200 texels, nothing below 2.5."""
    f = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None])
    amplitude = 1 / np.maximum(f, 1 / 200) * np.exp(-((f * 2.5) ** 4))
    noise = np.fft.irfft2(np.fft.rfft2(random.standard_normal((size, size))) * amplitude, (size, size))
    return 0.5 + 0.2 * (noise - noise.mean()) / noise.std()


def _checkerboard(random, size, square=32):
    place = np.arange(size) // square
    return (place[:, None] + place) % 2.0


def _charuco(random, size, square=64, cell=6):
    """White squares of a checkerboard hold a code of 6 x 6 cells with a black rim; the codes are random."""
    board = _checkerboard(random, size, square)
    for y in range(0, size, square):
        for x in range(0, size, square):
            if board[y, x]:
                code = np.zeros((8, 8))
                code[1:7, 1:7] = random.integers(0, 2, (6, 6))
                edge = (square - 8 * cell) // 2
                board[y + edge : y + edge + 8 * cell, x + edge : x + edge + 8 * cell] = np.kron(
                    code, np.ones((cell, cell))
                )
    return board


def _text(random, size):
    """Lines of print, black on white, capitals about 19 texels high."""
    page = Image.new("L", (size, size), 255)
    pen, font = ImageDraw.Draw(page), ImageFont.load_default(26)
    for y in range(4, size, 32):
        pen.text((-random.integers(0, 60), y), " ".join(random.choice(WORDS, 60)), fill=0, font=font)
    return np.asarray(page) / 255


def _dots(random, size):
    """Few dots, 10 texels wide, one on 60 x 60 texels: most of the board is empty."""
    y, x = np.mgrid[0:size, 0:size]
    board = np.ones((size, size))
    for cx, cy in random.uniform(8, size - 8, ((size // 60) ** 2, 2)):
        board -= np.exp(-((((x - cx) ** 2 + (y - cy) ** 2) / 25) ** 2))
    return board


def _sine(random, size):
    """Two crossed sines of 32 texels: every period looks like the next."""
    wave = np.sin(2 * np.pi * np.arange(size) / 32)
    return 0.5 + 0.25 * (wave[:, None] + wave)


def _bars(random, size):
    """Upright bars of 16 texels: detail in one direction only."""
    return np.tile(np.arange(size) // 16 % 2.0, (size, 1))


def _step(random, size):
    """One slanting edge through the middle, dark on its left, nothing else; the pattern repeats far outside."""
    y, x = np.mgrid[0:size, 0:size] - size / 2
    return 0.5 + np.clip((x + 0.4 * y) / 2, -0.5, 0.5)


def _flat(random, size):
    return np.full((size, size), 0.6)
