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

A snapshot is a header line, a description as JSON, and the compressed state. Constants are not in
it: they are named, and taken from the model of the simulation that restores. Reading one creates
arrays and the classes of this package that a state is made of, and calls nothing else, so that a
file from elsewhere can do no harm.
"""

from dataclasses import fields, is_dataclass, replace
import hashlib
import io
import json
import pickle
from typing import Any
import zlib

import numpy as np

from procphys_ros import __version__
from procphys_ros.errors import SnapshotError
from procphys_ros.physics.world import World
from procphys_ros.simulation.model import compile_model, Model
from procphys_ros.simulation.state import State

_MAGIC = b'procphys_ros snapshot 1\n'
_LENGTH = 8  # [bytes] of the number that says how long the part is that tells of additions
_LEVEL = 1  # of compression; higher ones take several times longer for a tenth less
_LARGEST = 4 << 30  # [bytes] of a state; beyond it a file is not read
_PACKAGE = 'procphys_ros.'
# What numpy and the standard library need to make arrays, generators and containers.
_ALLOWED = {
    ('collections', 'deque'), ('_codecs', 'encode'), ('numpy', 'ndarray'), ('numpy', 'dtype'),
    ('numpy.core.multiarray', '_reconstruct'), ('numpy._core.multiarray', '_reconstruct'),
    ('numpy.core.multiarray', 'scalar'), ('numpy._core.multiarray', 'scalar'),
    ('numpy.core.numeric', '_frombuffer'), ('numpy._core.numeric', '_frombuffer'),
    ('numpy.random._pickle', '__generator_ctor'),
    ('numpy.random._pickle', '__bit_generator_ctor'),
    ('numpy.random._pcg64', 'PCG64'), ('numpy.random.bit_generator', 'SeedSequence'),
    ('numpy.random.bit_generator', '__pyx_unpickle_SeedSequence'),
    ('builtins', 'set'), ('builtins', 'frozenset'), ('builtins', 'slice'), ('builtins', 'range'),
}


def dump(scene: Model, model: Model, state: State) -> bytes:
    """
    Write a state down.

    :param scene: model of the scene as it was loaded.
    :param model: the same, or enlarged by what was added since.
    :param state: of a simulation between two steps.
    """
    added = b'' if model is scene else _pickle(scene, (model.blueprint, model.objects))
    content = len(added).to_bytes(_LENGTH, 'little') + added + _pickle(model, state)
    packed = zlib.compress(content, _LEVEL)
    return describe(scene, state.time, packed) + packed


def describe(scene: Model, time: float, packed: bytes) -> bytes:
    """
    Make the head of a snapshot.

    :param scene: model of the scene as it was loaded.
    :param time: simulated [s].
    :param packed: the compressed content that follows.
    """
    about = {'version': __version__, 'scene': digest(scene), 'time': time,
             'size': len(packed), 'sha256': hashlib.sha256(packed).hexdigest()}
    return _MAGIC + json.dumps(about).encode() + b'\n'


def load(scene: Model, data: bytes) -> tuple[Model, State]:
    """
    Read a state.

    :param scene: model of the scene that it was saved from.
    :returns: the model, enlarged by what had been added, and the state.
    :raises SnapshotError: when it is no snapshot, damaged, of another version or another scene.
    """
    packed = _checked(scene, data)
    try:
        unpacker = zlib.decompressobj()
        content = unpacker.decompress(packed, _LARGEST)
        if unpacker.unconsumed_tail:
            raise SnapshotError('the snapshot is larger than 4 GiB')
        end = _LENGTH + int.from_bytes(content[:_LENGTH], 'little')
        model = _enlarged(scene, content[_LENGTH:end])
        state = _Reader(io.BytesIO(content[end:]), model).load()
    except (zlib.error, pickle.UnpicklingError, EOFError, AttributeError, IndexError, KeyError,
            TypeError, ValueError, ImportError) as error:
        raise SnapshotError(f'the snapshot cannot be read: {error}') from error
    if not isinstance(state, State):
        raise SnapshotError('the snapshot holds no state')
    return model, state


def _checked(scene: Model, data: bytes) -> bytes:
    """Check what a snapshot says of itself, and give its content."""
    if not isinstance(data, (bytes, bytearray)) or not data.startswith(_MAGIC):
        raise SnapshotError('this is no snapshot of a simulation')
    try:
        line, packed = data[len(_MAGIC):].split(b'\n', 1)
        about = json.loads(line)
        whole = (len(packed) == about['size']
                 and hashlib.sha256(packed).hexdigest() == about['sha256'])
        version, made_from = about['version'], about['scene']
    except (ValueError, KeyError, TypeError) as error:
        raise SnapshotError('the snapshot is damaged: its description cannot be read') from error
    if not whole:
        raise SnapshotError('the snapshot is damaged: its content does not fit its checksum')
    if version != __version__:
        raise SnapshotError(f'the snapshot was saved by version {version} of procphys_ros, this '
                            f'is {__version__}')
    if made_from != digest(scene):
        raise SnapshotError('the snapshot was saved from another scene, or with other settings, '
                            'seed or time step')
    return packed


def _enlarged(scene: Model, added: bytes) -> Model:
    """Compile a scene with what had been added to it."""
    if not added:
        return scene
    blueprint, objects = _Reader(io.BytesIO(added), scene).load()
    return compile_model(scene.settings, scene.shard, blueprint, objects, scene.time_step,
                         scene.seed, scene.wind, scene.loaded)


def clone(model: Model, state: State) -> State:
    """Copy a state; constants are shared."""
    return _Reader(io.BytesIO(_pickle(model, state)), model).load()


def digest(model: Model) -> str:
    """Hash everything that a scene is compiled from, and that makes a difference to its course."""
    total = hashlib.sha256()
    for part in (replace(model.settings, threads=0), model.seed, model.time_step, model.shard):
        total.update(repr(part).encode())
    for column in _arrays(model.blueprint).values():
        total.update(str(column.dtype).encode() + np.ascontiguousarray(column).tobytes())
    return total.hexdigest()


class _Writer(pickle.Pickler):
    """Writes a state, naming what the model holds instead of writing it."""

    def __init__(self, file: io.BytesIO, model: Model):
        super().__init__(file, protocol=5)
        self._names = {id(constant): name for name, constant in _constants(model).items()}

    def persistent_id(self, thing: Any) -> str | None:
        return self._names.get(id(thing))

    def reducer_override(self, thing: Any) -> Any:
        if isinstance(thing, World):
            return _restore_world, (thing.save_state(), thing.engine)
        return NotImplemented


class _Reader(pickle.Unpickler):
    """Reads a state, and refuses everything that is not part of one."""

    def __init__(self, file: io.BytesIO, model: Model):
        super().__init__(file)
        self._constants = _constants(model)

    def persistent_load(self, name: Any) -> Any:
        if name not in self._constants:
            raise pickle.UnpicklingError(f'there is no constant "{name}"')
        return self._constants[name]

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in _ALLOWED or (module, name) == (__name__, _restore_world.__name__):
            return super().find_class(module, name)
        if module.startswith(_PACKAGE) and '.' not in name:
            found = super().find_class(module, name)
            if isinstance(found, type) and found.__module__ == module:
                return found
        raise pickle.UnpicklingError(f'{module}.{name} is no part of a state')


def _restore_world(arrays: dict[str, np.ndarray], engine: str) -> World:
    return World.restore(arrays, engine)


def _pickle(model: Model, thing: object) -> bytes:
    file = io.BytesIO()
    _Writer(file, model).dump(thing)
    return file.getvalue()


def _constants(model: Model) -> dict[str, Any]:
    """Name the arrays of a model, its blueprint and its settings, which states refer to."""
    return {**_arrays(model), 'blueprint': model.blueprint, 'settings': model.settings,
            'culling': model.settings.culling}


def _arrays(thing: Any, name: str = '', seen: set[int] | None = None) -> dict[str, np.ndarray]:
    """Find all arrays that an object of this package holds, by the way to them."""
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
