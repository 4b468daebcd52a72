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

"""Soundness: blueprints whose arrays programs have filled are checked before they are placed."""

from collections.abc import Mapping

import numpy as np

from procphys_ros.blueprint import Blueprint, GROUND, JointType, Shape
from procphys_ros.errors import SceneError
from procphys_ros.geometry.linear import norm

_UNIT = 1e-6  # largest deviation of the length of a quaternion from 1
# Columns of numbers, and which of `_WORDS` they must be.
_PARTS = {'size': 'above', 'visual_size': 'least', 'density': 'above', 'mass': 'above',
          'inertia': 'above', 'leaf_area': 'least'}
_BONDS = {'bond_extent': 'above', 'bond_area': 'above'}
_MORTAR = {'tension': 'strength', 'cohesion': 'strength', 'friction': 'least',
           'compression': 'above', 'normal_stiffness': 'above', 'shear_stiffness': 'above',
           'reinforcement': 'least'}
_HINGES = {'swing_limit': 'above', 'swing_stiffness': 'above', 'preload': 'least',
           'cling': 'least'}
_JOINTS = {'stiffness': 'least', 'damping': 'least', 'friction': 'least', 'effort': 'least',
           'fastest': 'strength', 'force': 'strength', 'moment': 'strength'}
_LEAVES = {'size': 'least', 'shedding_speed': 'least'}
_WORDS = {'above': 'finite and above 0', 'least': 'finite and 0 or more', 'strength': '0 or more'}


def check_blueprint(name: str, blueprint: Blueprint) -> None:
    """
    Raise SceneError for the first number of a blueprint that cannot be simulated.

    :param name: of the object, for the message.
    """
    parts, names = len(blueprint), blueprint.textures
    _check_numbers(f'{name}: part', blueprint, _PARTS)
    _check_poses(f'{name}: part', 'poses', blueprint.poses)
    for column, known in (('shape', tuple(Shape)), ('kind', blueprint.kinds),
                          ('material', blueprint.materials), ('texture', names or ('',))):
        _check_range(f'{name}: part', column, getattr(blueprint, column), len(known))
    _check_numbers(f'{name}: bond', blueprint, _BONDS)
    _check_poses(f'{name}: bond', 'bond_frame', blueprint.bond_frame)
    first, second = blueprint.bonds.T
    _demand((first >= GROUND) & (second >= 0) & (blueprint.bonds < parts).all(axis=1)
            & (first != second), f'{name}: bond', 'bonds', blueprint.bonds,
            f'two different parts, 0 to {parts - 1}, or {GROUND}, the ground, and a part')
    _check_numbers(f'{name}: mortar', blueprint.mortar, _MORTAR)
    _check_numbers(f'{name}: hinge', blueprint.hinges, _HINGES)
    _check_numbers(f'{name}: leaf', blueprint.leaves, _LEAVES)
    _check_poses(f'{name}: leaf', 'pose', blueprint.leaves.pose)
    _check_joints(name, blueprint)
    for what, column in (('ornaments', 'triangle'), ('hexahedra', 'corners')):
        value = getattr(getattr(blueprint, what), column)
        _demand(np.isfinite(value), f'{name}: {what}', column, value, 'finite')
    for what in ('leaves', 'ornaments', 'hexahedra', 'plates'):
        _check_range(f'{name}: {what}', 'part', getattr(blueprint, what).part, parts)
    for what in ('leaves', 'ornaments'):
        _check_range(f'{name}: {what}', 'texture', getattr(blueprint, what).texture, len(names))


def _check_joints(name: str, blueprint: Blueprint) -> None:
    joints, parts, what = blueprint.joints, len(blueprint), f'{name}: joint'
    _check_numbers(what, joints, _JOINTS)
    _check_poses(what, 'frame', joints.frame)
    _demand(np.isfinite(joints.anchor), what, 'anchor', joints.anchor, 'finite')
    _demand(joints.low <= joints.high, what, 'low', joints.low, 'no more than high')
    first, second = joints.parts.T
    _demand((first >= GROUND) & (second >= 0) & (joints.parts < parts).all(axis=1)
            & (first != second), what, 'parts', joints.parts,
            f'two different parts, 0 to {parts - 1}, or {GROUND}, the ground, and a part')
    _check_range(what, 'kind', joints.kind - np.uint8(1), len(JointType))
    _check_range(what, 'name', joints.name, len(blueprint.joint_names))
    _check_numbers(f'{name}: plate', blueprint.plates, {'area': 'least'})
    _check_range(f'{name}: plate', 'normal', blueprint.plates.normal, 3)


def _check_numbers(what: str, table: object, rules: Mapping[str, str]) -> None:
    for column, rule in rules.items():
        value = getattr(table, column)
        good = value > 0.0 if rule == 'above' else value >= 0.0
        if rule != 'strength':
            good &= np.isfinite(value)
        _demand(good, what, column, value, _WORDS[rule])


def _check_poses(what: str, column: str, poses: np.ndarray) -> None:
    good = np.isfinite(poses).all(axis=1) & (np.abs(norm(poses[:, 3:], axis=1) - 1.0) <= _UNIT)
    _demand(good, what, column, poses, 'finite, with a quaternion of length 1')


def _check_range(what: str, column: str, value: np.ndarray, count: int) -> None:
    _demand((value >= 0) & (value < count), what, column, value, f'from 0 to {count - 1}')


def _demand(good: np.ndarray, what: str, column: str, value: np.ndarray, allowed: str) -> None:
    """Raise SceneError for the first row that is not good, (N,) or (N, D) bool."""
    if not good.all():
        row = int(np.argmin(good if good.ndim == 1 else good.all(axis=1)))
        raise SceneError(f'{what} {row}: {column} is {value[row].tolist()}, it must be {allowed}')
