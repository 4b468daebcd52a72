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

"""Materials: strengths and stiffness of parts, and of what joins them."""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np


@dataclass(frozen=True)
class Material:
    """
    A material; its strengths hold for bonds between its parts.

    :ivar density: [kg/m³].
    :ivar tension: tensile strength [Pa].
    :ivar cohesion: shear strength without compression [Pa].
    :ivar friction: rise of shear strength with compression.
    :ivar compression: compressive strength [Pa].
    :ivar modulus: Young's modulus [Pa].
    :ivar texture: name of its look; empty = the name of the material.
    :ivar reinforcement: force at which the steel near one face of a section yields, over the area
        of the section [Pa].
    """

    density: float
    tension: float
    cohesion: float
    friction: float
    compression: float
    modulus: float
    texture: str = ''
    reinforcement: float = 0.0


def texture_numbers(materials: Mapping[str, Material]) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the looks of materials, each once, and the number of that of each, (M,)."""
    looks = [material.texture or name for name, material in materials.items()]
    textures = tuple(dict.fromkeys(looks))
    return textures, np.array([textures.index(look) for look in looks], np.int16)


NUMBERS = tuple(f.name for f in fields(Material) if f.name != 'texture')

NAIL_AREA = 25e-4  # [m²] of contact that stands for one nail, see `nail` below

# Predefined materials; a grammar may declare them anew, whole or in part.
DEFAULTS = {
    # Clay facing brick as laid, in common mortar: density PSI 78 (2026) 19-22 kN/m³; tension from
    # bond-wrench tests of good clay bond, 0.15-0.5 MPa; cohesion and friction DIN EN 1996-1-1/NA
    # (0.22 MPa and 0.6 for M10, mean values higher); 10 GPa with 10 mm of 2 GPa mortar make a
    # wall of 6.5 GPa, which is 1000·f_k of EN 1996-1-1 3.7.2 for f_k = 6.5 MPa.
    'brick': Material(1900.0, 0.2e6, 0.25e6, 0.7, 10e6, 10e9, 'brick_red'),
    # The strengths of a unit are those of its joints already; those of mortar count only once a
    # grammar declares them.
    'mortar': Material(1800.0, np.inf, np.inf, np.inf, np.inf, 2e9, 'mortar_grey'),
    # Softwood C24, EN 338: mean density 420, f_t,0 14.5 MPa, f_v 4 MPa, f_c,0 21 MPa, E 11 GPa.
    'timber': Material(420.0, 14.5e6, 4e6, 0.4, 21e6, 11e9, 'timber'),
    # Hardwood D30, EN 338: mean density 640, f_t,0 18 MPa, f_v 3.9 MPa, f_c,0 24 MPa, E 11 GPa.
    'oak': Material(640.0, 18e6, 3.9e6, 0.4, 24e6, 11e9, 'oak'),
    # Concrete C30/37, EN 1992-1-1 Table 3.1: f_ctm 2.9 MPa, E_cm 33 GPa, f_ck 30 MPa; 0.9 MPa in
    # shear (BCB presets). Reinforced by 0.25 % of B500 in each face, a mesh of 393 mm²/m in slabs
    # of 0.16 m; the least that 9.2.1.1 allows is 0.15 %.
    'concrete': Material(2400.0, 2.9e6, 0.9e6, 0.7, 30e6, 33e9, 'concrete', 1.25e6),
    # Float glass, EN 572-1: 2500 kg/m³, 70 GPa, f_g,k 45 MPa.
    'glass': Material(2500.0, 45e6, 20e6, 0.2, 200e6, 70e9, 'glass'),
    # Clay roof tile, EN 1304: about 40 kg/m² at 20 mm.
    'tile': Material(2000.0, 2e6, 2e6, 0.6, 20e6, 10e9, 'tile_red'),
    # Nails, screws and putty smeared over the contact: a 3.1 mm nail in C24 holds about 0.3 kN in
    # withdrawal, 20e-6·ρ_k² N/mm² times 3.1 mm times 40 mm with ρ_k = 350 kg/m³ (EN 1995-1-1 8.23,
    # 8.25), and 0.5 kN in shear (8.2.2), and slips by 1 mm at 0.7 kN (Table 7.1); one per 10 cm²
    # of contact, over the millimetre that dry contacts are taken to have.
    'fixing': Material(0.0, 0.3e6, 0.5e6, 0.4, 5e6, 0.7e6, 'nail'),
    # A single such nail, smeared over the 25 cm² (`NAIL_AREA`) whose stiffness along it is
    # its slip modulus. Tile nails and clips hold 0.2 to 0.9 kN.
    'nail': Material(0.0, 0.12e6, 0.2e6, 0.4, 5e6, 0.7e6, 'nail'),
    # Timbers lapped over each other and nailed as densely as above: tension shears the nails.
    'lap': Material(0.0, 0.5e6, 0.5e6, 0.4, 5e6, 0.7e6, 'nail'),
    # Timbers halved over each other, or cogged at their ends: half of `timber`.
    'halving': Material(0.0, 7.25e6, 2e6, 0.4, 10.5e6, 5.5e9, 'nail'),
    # Timber that rests in a pocket of masonry, wedged and mortared in: it gives like a dry,
    # uneven bed (1 GPa/m), holds little tension, and has friction.
    'bearing': Material(0.0, 0.1e6, 0.1e6, 0.5, 5e6, 1e6, 'bearing'),
}


def weakest(strengths: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """
    Return the lowest strengths of several materials, column by column, (n, columns).

    :param strengths: (materials, columns).
    :param rows: materials that meet, (n, k).
    """
    return strengths[rows].min(axis=1)
