# Copyright 2026 The procphys_ros authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.


"""Textures: small images of bark, brick grain and leaf clusters, computed from a seed."""

from functools import cache

import numpy as np

_PIXELS = 256
_SURFACES = ('furrows', 'plates', 'rings', 'lenticels', 'grain')
# Leaf clusters: blades, spread of their roots along and across the twig, blade length and width,
# angle to the twig [degrees]; lengths over the image side.
CLUSTERS = {
    'broad': (64, (0.05, 0.80), 0.22, 0.19, 0.105, (20, 95)),
    'small': (60, (0.05, 0.85), 0.25, 0.13, 0.075, (15, 100)),
    'needles': (230, (0.00, 0.66), 0.02, 0.48, 0.014, (8, 78)),
}


@cache
def image(pattern: str) -> np.ndarray | None:
    """
    Compute an image that multiplies a surface's colour, (P, P, 4) uint8, brightest part white.

    The first row is the upper edge. Images of surfaces repeat without a seam; images of leaves are
    transparent around the leaves and grow upwards from the middle of the lower edge.

    :param pattern: `Look.pattern`.
    :returns: None for a plain surface.
    """
    rng = np.random.default_rng(7)
    if pattern in _SURFACES:
        light, alpha = _surface(pattern, rng), np.ones((_PIXELS, _PIXELS))
    elif pattern in CLUSTERS:
        light, alpha = _cluster(CLUSTERS[pattern], rng)
    elif pattern == 'streamer':
        light, alpha = _streamer(rng)
    elif pattern in ('frond', 'frond_tip'):
        light, alpha = _frond(pattern == 'frond_tip', rng)
    elif pattern == 'fruit':
        light, alpha = _fruit()
    else:
        return None
    pixels = np.stack([light, light, light, alpha], axis=-1)[::-1]
    return np.ascontiguousarray(np.round(255.0 * np.clip(pixels, 0.0, 1.0)).astype(np.uint8))


@cache
def noise_image() -> np.ndarray:
    """Compute four independent channels of periodic noise in octaves, (P, P, 4) uint8."""
    rng = np.random.default_rng(11)
    channels = []
    for _ in range(4):
        channels.append(0.5 + 0.18 * _octaves(rng, 0.7))
    return np.round(255.0 * np.clip(np.stack(channels, axis=-1), 0.0, 1.0)).astype(np.uint8)


def _octaves(rng: np.random.Generator, share: float) -> np.ndarray:
    """Draw multi-scale noise, zero mean and unit deviation, (P, P), each octave weaker."""
    octaves = np.zeros((_PIXELS, _PIXELS))
    for i in range(6):
        octaves += share ** i * _noise(rng, 4 * 2 ** i, 4 * 2 ** i)
    return octaves / octaves.std()


def mean_light(pattern: str) -> float:
    """Return the mean brightness of the image where it is opaque, 0 to 1."""
    pixels = image(pattern)
    if pixels is None:
        return 1.0
    opaque = pixels[..., 3] > 127
    return float(pixels[..., 0][opaque].mean()) / 255.0


def _noise(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Draw periodic noise of zero mean and unit deviation, (P, P), by cells per side."""
    spectrum = np.fft.fft2(rng.standard_normal((_PIXELS, _PIXELS)))
    frequency = np.fft.fftfreq(_PIXELS) * _PIXELS
    falloff = np.exp(-((frequency[:, None] / rows) ** 2 + (frequency / columns) ** 2))
    noise = np.fft.ifft2(spectrum * falloff).real
    return (noise - noise.mean()) / noise.std()


def _surface(pattern: str, rng: np.random.Generator) -> np.ndarray:
    """Draw bark (rows run along the branch) or grain, brightness 0 to 1."""
    fine = 0.03 * _noise(rng, 90, 90)
    height = np.linspace(0.0, 1.0, _PIXELS, endpoint=False)[:, None]
    if pattern == 'furrows':  # long cracks along the branch
        return 0.80 - 0.35 * np.clip(1.2 - np.abs(_noise(rng, 5, 22)) * 2.0, 0, 1) + fine
    if pattern == 'plates':  # flakes between dark cracks
        return 0.82 - 0.45 * np.clip(1.0 - np.abs(_noise(rng, 9, 11)) * 3.0, 0, 1) + fine
    if pattern == 'rings':  # scars of shed fronds
        scar = np.abs((8.0 * height + 0.08 * _noise(rng, 2, 4)) % 1.0 - 0.5)
        return 0.86 - 0.40 * np.clip(1.0 - scar / 0.12, 0, 1) + fine
    if pattern == 'lenticels':  # short dark dashes across white bark, and a few black scars
        dashes = np.clip(_noise(rng, 40, 7) - 1.7, 0, 1)
        scars = np.clip(2.0 * (_noise(rng, 9, 4) - 1.9), 0, 1)
        return 0.97 - 0.65 * dashes - 0.75 * scars + fine
    # Stone, brick and concrete: noise of one scale would look woven. Pores are dark and few.
    return 0.90 + 0.07 * _octaves(rng, 0.85) - 0.25 * np.clip(_noise(rng, 60, 60) - 2.0, 0, 1)


def _cluster(shape: tuple, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw many blades along a twig: brightness and alpha."""
    count, (low, high), spread, length, width, (inner, outer) = shape
    light, alpha = np.full((_PIXELS, _PIXELS), 0.7), np.zeros((_PIXELS, _PIXELS))
    _blade(light, alpha, (0.5, 0.0), 0.0, high, 0.018, 0.45)
    root = low + (high - low) * np.sort(rng.random(count))[::-1]
    for i, y in enumerate(root):  # lower blades last: they overlap those farther up
        side = 1.0 if i % 2 else -1.0
        bend = outer + (inner - outer) * (y - low) / (high - low)
        angle = side * np.radians(bend + 12.0 * rng.standard_normal())
        start = (0.5 + spread * rng.uniform(-1.0, 1.0) * (1.1 - y), y)
        _blade(light, alpha, start, angle, length * rng.uniform(0.8, 1.2),
               width * rng.uniform(0.8, 1.2), rng.uniform(0.62, 1.0))
    return light, alpha


def _streamer(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw thin shoots side by side with narrow leaves along them: brightness and alpha."""
    light, alpha = np.full((_PIXELS, _PIXELS), 0.7), np.zeros((_PIXELS, _PIXELS))
    for x in np.linspace(0.07, 0.93, 7):
        low, high = rng.uniform(0.0, 0.35), rng.uniform(0.70, 0.98)
        for i, y in enumerate(np.arange(high, low, -0.045)):
            angle = np.radians((14.0 if i % 2 else -14.0) + 8.0 * rng.standard_normal())
            _blade(light, alpha, (x, y - 0.1), angle, 0.21 * rng.uniform(0.8, 1.2), 0.028,
                   rng.uniform(0.6, 1.0))
    return light, alpha


def _frond(tip: bool, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw a feathered palm leaf around its midrib; the tip half runs to a point."""
    light, alpha = np.full((_PIXELS, _PIXELS), 0.7), np.zeros((_PIXELS, _PIXELS))
    for y in np.arange(1.0, -0.42, -1.0 / 18.0):
        reach = 0.50 * (max(1.0 - y, 0.02) ** 0.8 if tip else 1.0)
        for side in (-1.0, 1.0):
            _blade(light, alpha, (0.5, y), side * np.radians(52.0 + 4.0 * rng.standard_normal()),
                   reach / np.sin(np.radians(52.0)), 0.05, rng.uniform(0.65, 1.0))
    _blade(light, alpha, (0.5, -0.2), 0.0, 1.2 if tip else 1.6, 0.05, 0.95)
    return light, alpha


def _fruit() -> tuple[np.ndarray, np.ndarray]:
    """Draw one ball with a shaded rim: brightness and alpha."""
    y, x = (np.mgrid[:_PIXELS, :_PIXELS] + 0.5) / _PIXELS - 0.5
    square = (x ** 2 + y ** 2) / 0.48 ** 2
    return np.sqrt(np.clip(1.0 - 0.8 * square, 0.0, 1.0)), (square < 1.0).astype(float)


def _blade(light: np.ndarray, alpha: np.ndarray, start: tuple[float, float], angle: float,
           length: float, width: float, brightness: float) -> None:
    """
    Paint one pointed leaf over the image.

    :param start: petiole, x and y over the image side, y up.
    :param angle: from the upward direction towards +x [rad].
    :param length, width: over the image side.
    :param brightness: of the blade, 0 to 1; the midrib is lighter.
    """
    y, x = (np.mgrid[:_PIXELS, :_PIXELS] + 0.5) / _PIXELS
    along = ((x - start[0]) * np.sin(angle) + (y - start[1]) * np.cos(angle)) / length
    across = ((x - start[0]) * np.cos(angle) - (y - start[1]) * np.sin(angle)) / (0.5 * width)
    outline = np.sin(np.pi * np.clip(along, 0.0, 1.0) ** 0.8)
    inside = (along > 0.0) & (along < 1.0) & (np.abs(across) < outline)
    light[inside] = (brightness * (1.0 - 0.25 * np.abs(across)))[inside]
    alpha[inside] = 1.0
