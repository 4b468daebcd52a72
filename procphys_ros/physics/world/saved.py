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


"""Saved worlds: check the layout of saved arrays before a world is built from them."""

from collections.abc import Mapping

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.physics.rigid.contacts import no_contacts, POINT, split_key
from procphys_ros.physics.rigid.joints import JointKind, no_joints
from procphys_ros.physics.world.body_table import BodyState, BodyTable

_CONTACT = np.zeros((0, 13))  # rows of `Engine.contacts`
_TERRAIN = {'heights': np.zeros((0, 0)), 'low': np.zeros(2), 'edge': np.zeros(())}
_SINGLE = {'gravity': np.zeros(3), 'contacts': _CONTACT, 'asleep': _CONTACT,
           'places': np.zeros((0, 3)), 'excluded': np.zeros((0, 2), np.intp),
           'time_step': np.zeros(())}
_ROWS = 'contacts', 'resting'
_ENGINE = {'engine.order': np.zeros(0, np.int64), 'engine.still': np.zeros(0, bool),
           'engine.held': np.zeros(0, bool)}


def check_saved(arrays: Mapping[str, np.ndarray]) -> None:
    """
    Check the arrays that a world is to be built from.

    :param arrays: by the names of `World.save_state`.
    :raises ValueError: when one is missing, is of another type or width, differs in its number of
        rows from related ones, or refers to bodies, collision shapes or points that do not exist.
    """
    bodies = BodyTable().save()
    per_body = {name: column for name, column in bodies.items()
                if not name.startswith(('piece_', 'ground_', 'hexahedron_')) or
                name.endswith('_count')}
    del per_body['free'], per_body['capacity']
    tables = {'bodies': bodies, 'terrain': _TERRAIN}
    layout = _SINGLE | {f'{table}.{name}': column for table, columns in tables.items()
                        for name, column in columns.items()}
    joints = [name for name in arrays if name.startswith('joints.')]
    if joints:
        layout |= {f'joints.{name}': column for name, column in no_joints(0)._asdict().items()}
    engine = [name for name in arrays if name.startswith('engine.')]
    if engine:
        layout |= {f'engine.{rows}.{name}': column for rows in _ROWS
                   for name, column in no_contacts(0)._asdict().items()} | _ENGINE
    for name, pattern in layout.items():
        _check_column(name, arrays.get(name), pattern)
    used = len(arrays['bodies.state'])
    for names in ([f'bodies.{name}' for name in per_body],
                  ['bodies.piece_shape', 'bodies.piece_size', 'bodies.piece_pose'],
                  ['bodies.hexahedron_piece', 'bodies.hexahedron_corners'], joints,
                  *([name for name in engine if name.startswith(f'engine.{rows}.')]
                    for rows in _ROWS)):
        if len({len(arrays[name]) for name in names}) > 1:
            raise ValueError(f'{names[0]} has not as many rows as what belongs to it')
    _check_ids(arrays, used)
    if engine:
        _check_engine(arrays, used)


def _check_column(name: str, column: np.ndarray | None, pattern: np.ndarray) -> None:
    if (column is None or column.dtype != pattern.dtype or column.ndim != pattern.ndim
            or column.shape[1:] != pattern.shape[1:] and name != 'terrain.heights'):
        raise ValueError(f'{name} is missing, or not what it should be')


def _check_ids(arrays: Mapping[str, np.ndarray], used: int) -> None:
    limits = {'joints.kind': max(JointKind) + 1, 'joints.first': used, 'joints.second': used,
              'excluded': used, 'bodies.free': used, 'bodies.state': max(BodyState) + 1,
              'bodies.piece_shape': max(Shape) + 1}
    named = [(name, arrays[name], most) for name, most in limits.items() if name in arrays]
    named += [(name, arrays[name][:, :2], used) for name in ('contacts', 'asleep')]
    for name, column, most in named:
        if column.size and not 0 <= column.min() <= column.max() < most:
            raise ValueError(f'{name} names what there is not')
    for kind, rows in (('piece', 'piece_shape'), ('point', 'ground_point'),
                       ('hexahedron', 'hexahedron_piece')):
        first, count = arrays[f'bodies.first_{kind}'], arrays[f'bodies.{kind}_count']
        total = len(arrays[f'bodies.{rows}'])
        if np.any((first < 0) | (count < 0) | (count > total) | (first > total - count)):
            raise ValueError(f'bodies.first_{kind} names what there is not')
    if not used <= arrays['bodies.capacity'] <= 2 * used:  # as `BodyTable` grows
        raise ValueError('bodies.capacity is not the room of a table of so many bodies')


def _check_engine(arrays: Mapping[str, np.ndarray], used: int) -> None:
    """Check which bodies and pieces contacts name that an engine is to start from."""
    order = arrays['engine.order']
    named = [order, *(arrays[f'engine.{rows}.{side}'] for rows in _ROWS
                      for side in ('first', 'second'))]
    if any(column.size and not 0 <= column.min() <= column.max() < used for column in named):
        raise ValueError('engine.order or a contact names a body that there is not')
    free = arrays['bodies.free']
    if len(np.unique(order)) < len(order) or np.isin(order, free).any():
        raise ValueError('engine.order names a body twice, or one that was removed')
    if max(len(arrays['engine.still']), len(arrays['engine.held'])) > arrays['bodies.capacity']:
        raise ValueError('engine.still has more rows than there are bodies')
    pieces = arrays['bodies.piece_count'][order].sum()
    for rows in _ROWS:
        key = arrays[f'engine.{rows}.key']
        first, second = split_key(key)
        if np.any(key < 0) or np.any(np.diff(key) < 0) or np.any(
                (first >= pieces) & (first < POINT - 1)) or np.any(
                (second >= pieces) & (first != POINT)):
            raise ValueError(f'engine.{rows}.key names a piece that there is not')
