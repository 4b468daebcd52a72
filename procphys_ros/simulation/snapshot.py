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


"""
Snapshot: the whole state of a simulation as bytes, and back.

A snapshot is an `archive` of `records`. Constants are not in it: they are named, and taken from
the model of the simulation that restores; arrays that equal one of them are taken from there, too.
Nothing is built by a name found in a snapshot, and what was read is compared with the state that
the scene begins with, field by field, before anything goes on from it.
"""

from dataclasses import fields, is_dataclass, replace
import hashlib
from typing import Any

import numpy as np

from procphys_ros import __version__
from procphys_ros.blueprint import Blueprint, GROUND
from procphys_ros.errors import SceneError, SnapshotError
from procphys_ros.files.archive import pack, unpack
from procphys_ros.files.records import check_alike, Form, Reader, Writer
from procphys_ros.physics.world import World
from procphys_ros.scene import SceneObject
from procphys_ros.simulation.events import EVENT
from procphys_ros.simulation.model import compile_model, Model
from procphys_ros.simulation.state import State

_PACKAGE = 'procphys_ros.'
_ADDED = tuple[Blueprint, list[SceneObject]]  # all parts and objects, if some have joined
_FAULTS = (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError,
           RecursionError, SceneError)


def _read_generator(state: Any) -> np.random.Generator:
    generator = np.random.Generator(np.random.PCG64(0))
    generator.bit_generator.state = state
    return generator


# A world is built from its arrays after everything else has been read.
_FORMS = {World: Form(World.save_state, lambda arrays: arrays),
          np.random.Generator: Form(lambda generator: generator.bit_generator.state,
                                    _read_generator)}


def dump(scene: Model, model: Model, state: State) -> bytes:
    """
    Serialise a state.

    :param scene: model of the scene as loaded.
    :param model: the same, or enlarged by objects added since.
    :param state: of a simulation between two steps.
    """
    table: dict[str, Any] = {'version': __version__, 'scene': digest(scene), 'time': state.time}
    arrays: list[np.ndarray] = []
    if model is not scene:
        added = model.blueprint, list(model.objects)
        table['added'] = _section(scene, added, _ADDED, arrays)
    table['state'] = _section(model, state, State, arrays)
    return pack(table, arrays, [EVENT])


def load(scene: Model, data: bytes) -> tuple[Model, State]:
    """
    Deserialise a state.

    :param scene: model of the scene that it was saved from.
    :returns: the model, enlarged by the added objects, and the state.
    :raises SnapshotError: if it is not a snapshot, damaged, of another version or another scene.
    """
    table, arrays = unpack(data, [EVENT])
    try:
        version, made_from = table['version'], table['scene']
        if version != __version__:
            raise SnapshotError(f'the snapshot was saved by version {str(version):.20} of '
                                f'procphys_ros, this is {__version__}')
        if made_from != digest(scene):
            raise SnapshotError('the snapshot was saved from another scene, or with other '
                                'settings, seed or time step')
        model = scene
        if 'added' in table:
            model = _enlarged(scene, *_content(scene, table['added'], _ADDED, arrays))
        return model, _started(model, _content(model, table['state'], State, arrays))
    except _FAULTS as error:
        reason = f': {error}' if type(error) is ValueError else ''
        raise SnapshotError(f'the snapshot holds no state of this scene{reason}') from error


def clone(model: Model, state: State) -> State:
    """Copy a state; constants are shared."""
    constants = _constants(model)
    writer = Writer(constants, _FORMS)
    record = writer.write(state, State)
    copies = [array.copy() for array in writer.arrays]
    return _with_world(model, Reader(writer.objects, copies, constants, _FORMS).read(record,
                                                                                     State))


def digest(model: Model) -> str:
    """Hash all inputs of a scene that affect its simulation."""
    total = hashlib.sha256()
    for part in (replace(model.settings, threads=0), model.seed, model.time_step, model.shard):
        total.update(repr(part).encode())
    for column in _arrays(model.blueprint).values():
        total.update(str(column.dtype).encode() + np.ascontiguousarray(column).tobytes())
    return total.hexdigest()


def _section(model: Model, value: Any, kind: Any, arrays: list[np.ndarray]) -> dict[str, Any]:
    """
    Serialise a value.

    Arrays are written as their number, or as the name of a constant equal to them. The latter are
    limited to the size of the model, so that a small file cannot request many copies.

    :param arrays: those that are not copies are appended.
    """
    writer = Writer(_constants(model), _FORMS)
    record = writer.write(value, kind)
    known = {_identity(array): name for name, array in _arrays(model).items()}
    room = _size(model)
    places: list[int | str] = []
    for array in writer.arrays:
        name = known.get(_identity(array))
        if name is not None and array.nbytes <= room:
            room -= array.nbytes
            places.append(name)
        else:
            places.append(len(arrays))
            arrays.append(array)
    return {'record': record, 'objects': writer.objects, 'places': places}


def _content(model: Model, section: Any, kind: Any, arrays: list[np.ndarray]) -> Any:
    """Deserialise a value written by `_section`."""
    constants, places = _constants(model), section['places']
    numbers = [place for place in places if type(place) is int]
    if len(set(numbers)) < len(numbers) or min(numbers, default=0) < 0:
        raise ValueError('an array is there twice')
    copies = [constants[name] for name in places if type(name) is str]
    if sum(array.nbytes for array in copies) > _size(model):
        raise ValueError('there are more copies than constants')
    made = [(arrays if type(place) is int else constants)[place].copy() for place in places]
    return Reader(section['objects'], made, constants, _FORMS).read(section['record'], kind)


def _started(model: Model, state: State) -> State:
    """Compare a state with the initial one of its scene, and create its world."""
    pattern = State.initial(model)
    pattern.world.close()
    check_alike(pattern, state, _FORMS, 'state')
    if len(state.parts) != sum(map(len, state.blueprints)):
        raise ValueError('it has not a row for each part')
    return _with_world(model, state)


def _with_world(model: Model, state: State) -> State:
    arrays: Any = state.world
    state.world = World.restore(arrays, model.settings.engine)
    return state


def _enlarged(scene: Model, blueprint: Blueprint, objects: list[SceneObject]) -> Model:
    """Compile a scene with the objects added to it."""
    check_alike(scene.blueprint, blueprint, _FORMS, 'blueprint')
    blueprint.__post_init__()
    if sum(known.count for known in objects) != len(blueprint):
        raise ValueError('its objects have not all parts')
    for parts in (blueprint.bonds, blueprint.leaves.part, blueprint.ornaments.part,
                  blueprint.hexahedra.part):
        if parts.size and not GROUND <= parts.min() <= parts.max() < len(blueprint):
            raise ValueError('it names parts that there are not')
    return compile_model(scene.settings, scene.shard, blueprint, objects, scene.time_step,
                         scene.seed, scene.wind, scene.loaded, plants=scene.plants)


def _identity(array: np.ndarray) -> tuple[str, tuple[int, ...], bytes]:
    return str(array.dtype), array.shape, array.tobytes()


def _size(model: Model) -> int:
    """Return the memory of a model's constants [bytes]."""
    return sum(array.nbytes for array in _arrays(model).values())


def _constants(model: Model) -> dict[str, Any]:
    """Name the arrays of a model, its blueprint and its settings that states refer to."""
    return {**_arrays(model), 'blueprint': model.blueprint, 'settings': model.settings,
            'culling': model.settings.culling}


def _arrays(thing: Any, name: str = '', seen: set[int] | None = None) -> dict[str, np.ndarray]:
    """Find all arrays in an object of this package, by their path."""
    seen = set() if seen is None else seen
    if isinstance(thing, np.ndarray):
        return {name: thing}
    if id(thing) in seen:
        return {}
    seen.add(id(thing))
    if isinstance(thing, (tuple, list)):
        inner = {str(i): item for i, item in enumerate(thing)}
    elif is_dataclass(thing):
        inner = {field.name: getattr(thing, field.name) for field in fields(thing)}
    elif type(thing).__module__.startswith(_PACKAGE) and hasattr(thing, '__dict__'):
        inner = vars(thing)
    else:
        return {}
    found: dict[str, np.ndarray] = {}
    for key, item in inner.items():
        found |= _arrays(item, f'{name}/{key}', seen)
    return found
