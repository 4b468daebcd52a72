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


"""Palette: colours of textures, for pictures and RViz markers alike."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Look:
    """
    Appearance of a texture.

    :ivar rgba: colour, each 0 to 1.
    :ivar pattern: procedural image that modulates the colour (see `appearance.texture`).
    :ivar variation: differences of brightness between pieces, as a share of it.
    :ivar aspect: width of a leaf quad over its length; not used for other surfaces.
    """

    rgba: tuple[float, float, float, float]
    pattern: str = 'plain'
    variation: float = 0.04
    aspect: float = 1.0


LOOKS: dict[str, Look] = {
    'bark_oak': Look((0.36, 0.30, 0.24, 1.0), 'furrows'),
    'bark_pine': Look((0.50, 0.32, 0.22, 1.0), 'plates'),
    'bark_willow': Look((0.40, 0.36, 0.27, 1.0), 'furrows'),
    'bark_palm': Look((0.52, 0.46, 0.37, 1.0), 'rings'),
    'bark_beech': Look((0.55, 0.55, 0.52, 1.0), 'grain'),
    'bark_birch': Look((0.93, 0.92, 0.88, 1.0), 'lenticels'),
    'bark_birch_twig': Look((0.34, 0.25, 0.21, 1.0), 'plain'),
    'bark_shrub': Look((0.38, 0.31, 0.22, 1.0), 'furrows'),
    'bark': Look((0.40, 0.32, 0.24, 1.0), 'furrows'),
    'wood': Look((0.62, 0.47, 0.31, 1.0), 'furrows', 0.08),
    'torn_wood': Look((0.80, 0.66, 0.46, 1.0), 'furrows', 0.10),
    'soil': Look((0.27, 0.20, 0.14, 1.0), 'grain', 0.14),
    'leaf_oak': Look((0.27, 0.43, 0.13, 1.0), 'broad', 0.18, 1.5),
    'leaf_willow': Look((0.42, 0.54, 0.20, 1.0), 'streamer', 0.12, 1.7),
    'leaf_beech': Look((0.25, 0.46, 0.14, 1.0), 'small', 0.16, 1.5),
    'leaf_birch': Look((0.40, 0.55, 0.18, 1.0), 'small', 0.16, 1.5),
    'leaf_shrub': Look((0.24, 0.45, 0.20, 1.0), 'small', 0.20),
    'needle_pine': Look((0.21, 0.37, 0.20, 1.0), 'needles', 0.15, 1.6),
    'frond_palm': Look((0.33, 0.50, 0.16, 1.0), 'frond', 0.12),
    'frond_tip_palm': Look((0.35, 0.52, 0.17, 1.0), 'frond_tip', 0.12),
    'coconut': Look((0.42, 0.40, 0.16, 1.0), 'fruit', 0.15),
    'leaf': Look((0.30, 0.50, 0.18, 1.0), 'broad', 0.18),
    'flower': Look((0.90, 0.55, 0.65, 1.0), 'small', 0.10),
    'brick_red': Look((0.55, 0.31, 0.24, 1.0), 'grain', 0.11),
    'brick_yellow': Look((0.76, 0.64, 0.42, 1.0), 'grain', 0.12),
    'brick_grey': Look((0.56, 0.55, 0.53, 1.0), 'grain', 0.10),
    'brick': Look((0.55, 0.32, 0.25, 1.0), 'grain', 0.11),
    'sandstone': Look((0.78, 0.69, 0.52, 1.0), 'grain', 0.10),
    'stone': Look((0.60, 0.58, 0.54, 1.0), 'grain', 0.12),
    'stone_grey': Look((0.55, 0.55, 0.53, 1.0), 'grain', 0.14),
    'concrete': Look((0.68, 0.68, 0.66, 1.0), 'grain', 0.04),
    'brick_brown': Look((0.42, 0.29, 0.22, 1.0), 'grain', 0.12),
    'mortar': Look((0.75, 0.73, 0.68, 1.0), 'grain', 0.03),
    'mortar_grey': Look((0.70, 0.69, 0.65, 1.0), 'grain', 0.03),
    'bearing': Look((0.45, 0.44, 0.42, 1.0), 'grain', 0.03),
    'nail': Look((0.45, 0.46, 0.48, 1.0), 'plain', 0.02),
    'plaster': Look((0.90, 0.87, 0.80, 1.0), 'grain', 0.02),
    'oak': Look((0.50, 0.35, 0.20, 1.0), 'furrows', 0.10),
    'timber': Look((0.66, 0.49, 0.31, 1.0), 'furrows', 0.10),
    'glass': Look((0.62, 0.78, 0.86, 0.45), 'plain', 0.02),
    'slate': Look((0.30, 0.32, 0.36, 1.0), 'grain', 0.12),
    'tile_red': Look((0.56, 0.31, 0.23, 1.0), 'grain', 0.10),
    'steel': Look((0.55, 0.57, 0.60, 1.0), 'plain', 0.02),
    'projectile': Look((0.20, 0.20, 0.22, 1.0), 'plain', 0.0),
    'asphalt': Look((0.27, 0.27, 0.28, 1.0), 'grain', 0.0),
    'cobbles': Look((0.44, 0.42, 0.40, 1.0), 'grain', 0.0),
    'gravel': Look((0.60, 0.56, 0.48, 1.0), 'grain', 0.0),
    'paving': Look((0.66, 0.64, 0.60, 1.0), 'grain', 0.0),
    'ground': Look((0.50, 0.56, 0.40, 1.0), 'plain', 0.0),
}

_UNKNOWN = Look((0.60, 0.58, 0.55, 1.0), 'grain', 0.05)  # neutral grey: unknown, not alarming


def look(name: str) -> Look:
    """
    Find the look of a texture, by its name or by the longest table name that it contains.

    `leaf_maple` looks like `leaf`, `old_brick_red` like `brick_red`; else it is neutral grey.

    :param name: texture name in the grammar.
    """
    if name in LOOKS:
        return LOOKS[name]
    inside = [known for known in LOOKS if known in name]
    return LOOKS[max(inside, key=len)] if inside else _UNKNOWN


def is_known(name: str) -> bool:
    """Return whether a texture has its own look: its name is in the table, or contains one."""
    return any(known in name for known in LOOKS)


def rgba(name: str) -> tuple[float, float, float, float]:
    """
    Return the plain colour of a texture, each channel 0 to 1.

    :param name: texture name in the grammar.
    """
    return look(name).rgba
