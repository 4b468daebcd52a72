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

"""Tables: the materials and layouts that a grammar declares, checked and turned into numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from procphys_ros.appearance.palette import is_known, LOOKS
from procphys_ros.errors import nearest_names
from procphys_ros.language import Entry, Expression, Place
from procphys_ros.wallgrammar.bonds import BONDS, Layout
from procphys_ros.wallgrammar.boxes import micro
from procphys_ros.wallgrammar.materials import DEFAULTS, Material, NUMBERS
from procphys_ros.wallgrammar.spec import KINDS_OF_PANELS, Panel, Spec

_LAYOUT_KEYS = ('bond', 'unit', 'joint', 'offset', 'pieces', 'material')
_REQUIRED = ('density', 'tension', 'cohesion', 'compression')
_RANGES = {
    # No solid lies beyond these, and sums of products of larger values may not be finite.
    'density': (1.0, 25e3),     # [kg/m³] aerogel to osmium
    'tension': (0.0, 1e12), 'cohesion': (0.0, 1e12), 'compression': (1.0, 1e12),  # [Pa] 0: dry
    'friction': (0.0, 10.0),
    'modulus': (1e3, 2e12),     # [Pa] gel to diamond
    'reinforcement': (0.0, 1e12),  # [Pa]
}
# Materials that arches are not built of.
_NO_STONE = ('timber', 'oak', 'glass', 'fixing', 'nail', 'lap', 'halving', 'bearing', 'mortar')
_KINDS = ('boards', 'glazing', 'beam', 'arch', 'none', 'door', 'shutters')  # beside layouts
_SMALLEST = 0.01  # [m] smallest extent of a unit
_LARGEST = 20.0   # [m] largest
_JOINT = 0.01     # [m] when a layout names none


def read_materials(declared: Mapping[str, dict[str, Entry]], places: Mapping[str, Place],
                   known: Mapping[str, Material] = DEFAULTS,
                   required: Sequence[str] = _REQUIRED) -> dict[str, Material]:
    """
    Read every material by name: the predefined ones, then those of the grammar.

    :param declared: entries of each material of the grammar.
    :param places: where it stands, as 'material <name>'.
    :param known: the predefined ones.
    :param required: keys of one that is not predefined.
    :raises GrammarError: for unknown or missing keys, and values out of range.
    """
    materials = dict(known)
    for name, entries in declared.items():
        place = places[f'material {name}']
        _known_keys(entries, (*NUMBERS, 'texture'), f'material "{name}"')
        base = materials.get(name)
        if base is None:
            missing = [key for key in required if key not in entries]
            if missing:
                raise place.error(f'the material "{name}" needs {", ".join(missing)}')
            base = replace(DEFAULTS['brick'], texture='')
        values = {key: _number(entries[key]) for key in NUMBERS if key in entries}
        for key, value in values.items():
            low, high = _RANGES[key]
            if not low <= value <= high:
                raise entries[key].place.error(f'the {key} of "{name}" must be from {low:g} to '
                                               f'{high:g}, found {value:g}')
        texture = _texture(entries['texture']) if 'texture' in entries else base.texture
        materials[name] = replace(base, **values, texture=texture)
    return materials


def read_layouts(spec: Spec, materials: dict[str, Material]) -> dict[str, Layout]:
    """
    Read every layout by name.

    :param spec: the parsed grammar.
    :param materials: that layouts may name.
    :raises GrammarError: for unknown or missing keys, bonds, materials, and impossible units.
    """
    return {name: _layout(name, entries, spec.places[f'layout {name}'], materials)
            for name, entries in spec.layouts.items()}


def _layout(name: str, entries: dict[str, Entry], place: Place,
            materials: dict[str, Material]) -> Layout:
    _known_keys(entries, _LAYOUT_KEYS, f'layout "{name}"')
    for key in ('unit', 'material'):
        if key not in entries:
            raise place.error(f'the layout "{name}" needs "{key}:"')

    def place_of(key: str) -> Place:
        return entries[key].place if key in entries else place

    bond = _name(entries['bond']) if 'bond' in entries else name
    if bond not in BONDS:
        raise place_of('bond').error(
            f'unknown bond "{bond}"{nearest_names(bond, BONDS)} (bonds: {", ".join(BONDS)}); say '
            f'"bond:" when the layout has another name')
    material = _name(entries['material'])
    check_material(material, materials, place_of('material'))
    unit = [_value(v, place_of('unit')) for v in entries['unit'].values]
    if len(unit) != 3 or not _SMALLEST <= min(unit) <= max(unit) <= _LARGEST:
        raise place_of('unit').error(f'a unit is its length, width and height, each from '
                                     f'{_SMALLEST:g} to {_LARGEST:g} m; found {unit}')
    joint = _number(entries['joint']) if 'joint' in entries else _JOINT
    if not 0.0 <= joint <= 0.5 * min(unit):
        raise place_of('joint').error(f'a joint is from 0 to half the smallest extent of the '
                                      f'unit, {0.5 * min(unit):g} m, found {joint:g} m')
    offset = _number(entries['offset']) if 'offset' in entries else 0.5
    if not -1.0 <= offset <= 1.0:
        raise place_of('offset').error(f'an offset is from -1 to 1 unit, found {offset:g}')
    pieces = _number(entries['pieces']) if 'pieces' in entries else 1.0
    if not 1 <= pieces <= 100 or pieces != int(pieces):
        raise place_of('pieces').error(f'pieces is a whole number from 1 to 100, found {pieces:g}')
    layout = Layout(bond, (micro(unit[0]), micro(unit[1]), micro(unit[2])), micro(joint), offset,
                    int(pieces), list(materials).index(material))
    if layout.crossed and abs(layout.unit[0] - 2 * layout.unit[1] - layout.joint) > 1000:
        raise place_of('unit').error(
            f'{bond} bond needs a unit as long as two widths and a joint, '
            f'{2 * unit[1] + joint:g} m, found {unit[0]:g} m')
    return layout


def check_panel(panel: Panel, layouts: dict[str, Layout],
                materials: dict[str, Material]) -> None:
    """
    Check that the kind and the materials of a panel exist.

    :param panel: as parsed.
    :param layouts, materials: that exist.
    """
    if panel.kind not in (*_KINDS, *layouts):
        raise panel.place.error(
            f'unknown kind "{panel.kind}" of panel "{panel.name}"'
            f'{nearest_names(panel.kind, [*layouts, *_KINDS])} '
            f'(layouts: {", ".join(layouts) or "none"}; or {KINDS_OF_PANELS})')
    if panel.kind in layouts and panel.arguments:
        raise panel.place.error(f'the layout "{panel.kind}" of panel "{panel.name}" takes no '
                                f'arguments; its material stands in the layout')
    for material in panel.arguments:
        check_material(material, materials, panel.place)
        if panel.kind == 'arch' and material in _NO_STONE:
            stones = ', '.join(name for name in materials if name not in _NO_STONE)
            raise panel.place.error(f'arches are built of stones, not of "{material}" '
                                    f'(materials: {stones})')


def check_material(name: str, materials: dict[str, Material], place: Place) -> None:
    """
    Check that a material exists, and weighs something: what joins parts does not.

    :param name: as written.
    :param materials: that exist.
    :param place: of the name.
    """
    if name not in materials:
        raise place.error(f'unknown material "{name}"{nearest_names(name, materials)} '
                          f'(materials: {", ".join(materials)})')
    if not materials[name].density:
        bodies = ', '.join(known for known, material in materials.items() if material.density)
        raise place.error(f'"{name}" joins parts and has no density; none is built of it '
                          f'(materials: {bodies})')


def _known_keys(entries: dict[str, Entry], known: tuple[str, ...], what: str) -> None:
    for key, entry in entries.items():
        if key not in known:
            raise entry.place.error(f'unknown key "{key}" in {what}{nearest_names(key, known)} '
                                    f'(keys: {", ".join(known)})')


def _value(value: Expression | str, place: Place) -> float:
    if isinstance(value, str):
        raise place.error(f'expected a number, found "{value}"')
    return value.number({}, np.random.default_rng(0))


def _number(entry: Entry) -> float:
    if len(entry.values) != 1:
        raise entry.place.error(f'expected one number, found {len(entry.values)} values')
    return _value(entry.values[0], entry.place)


def _texture(entry: Entry) -> str:
    name = _name(entry)
    if not is_known(name):
        raise entry.place.error(f'unknown texture "{name}"{nearest_names(name, LOOKS)} '
                                f'(textures contain one of: {", ".join(LOOKS)})')
    return name


def _name(entry: Entry) -> str:
    if len(entry.values) != 1 or not isinstance(entry.values[0], str):
        raise entry.place.error('expected one name')
    return entry.values[0]
