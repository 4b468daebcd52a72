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
USD layers, written through Sdf: prims and properties without a stage.

A stage recomposes with every change; a layer alone takes a prim in some microseconds.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, UsdGeom, Vt

from procphys_ros.files.output_files import write_beside

_TYPES = Sdf.ValueTypeNames


class Layer:
    """
    A USD layer with z up, in metres and kilograms.

    :param root: path of the default prim.
    """

    def __init__(self, root: str):
        self._layer = Sdf.Layer.CreateAnonymous('.usda')
        self._layer.defaultPrim = root.lstrip('/')
        self.set_metadata(upAxis=UsdGeom.Tokens.z, metersPerUnit=1.0, kilogramsPerUnit=1.0)

    def set_metadata(self, **values: Any) -> None:
        """Set metadata of the layer."""
        for key, value in values.items():
            self._layer.pseudoRoot.SetInfo(key, value)

    def prim(self, path: str, kind: str = '', apis: Sequence[str] = (),
             specifier: Sdf.Specifier = Sdf.SpecifierDef) -> Sdf.PrimSpec:
        """
        Create a prim.

        :param path: absolute; its parents exist.
        :param kind: schema type, such as Xform.
        :param apis: applied API schemas, with instance names after a colon.
        :param specifier: def or class.
        """
        spec = Sdf.CreatePrimInLayer(self._layer, path)
        spec.specifier = specifier
        if kind:
            spec.typeName = kind
        if apis:
            applied = Sdf.TokenListOp()
            applied.prependedItems = list(apis)
            spec.SetInfo('apiSchemas', applied)
        return spec

    def sample(self, path: str, code: float, value: Any) -> None:
        """
        Set the value of an attribute at a time.

        :param path: of the attribute.
        :param code: time code.
        """
        self._layer.SetTimeSample(path, code, value)

    def write(self, path: Path) -> None:
        """
        Write the layer; the suffix selects text (.usda) or binary (.usdc).

        :raises OSError: if the file cannot be written.
        """
        write_beside(path, self._export)

    def _export(self, path: Path) -> None:
        path.open('wb').close()  # raises the reason, which USD does not
        try:
            done = self._layer.Export(str(path))
        except Tf.ErrorException:  # many lines, and not always the reason
            done = False
        except UnicodeEncodeError as error:
            raise OSError('USD takes no path that is not UTF-8') from error
        if not done:
            raise OSError('USD could not write it, the disk may be full')


def put(spec: Sdf.PrimSpec, kind: str, name: str, value: Any, uniform: bool = False) -> Any:
    """
    Add an attribute to a prim.

    :param kind: type as in a .usda file, such as float or point3f[].
    :param value: its default; None for one with time samples only.
    :param uniform: whether it never has time samples.
    """
    variability = Sdf.VariabilityUniform if uniform else Sdf.VariabilityVarying
    attribute = Sdf.AttributeSpec(spec, name, _TYPES.Find(kind), variability)
    if value is not None:
        attribute.default = value
    return attribute


def relate(spec: Sdf.PrimSpec, name: str, targets: Iterable[str]) -> None:
    """Add a relationship to a prim."""
    relationship = Sdf.RelationshipSpec(spec, name, False)
    for target in targets:
        relationship.targetPathList.explicitItems.append(target)


def refer(spec: Sdf.PrimSpec, other: str, instance: bool = False) -> None:
    """
    Add a reference to another prim of the same layer.

    :param instance: whether the referencing prims share it unchanged.
    """
    spec.referenceList.prependedItems.append(Sdf.Reference('', other))
    if instance:
        spec.SetInfo('instanceable', True)


def place(spec: Sdf.PrimSpec, pose: np.ndarray, scale: np.ndarray | None = None) -> None:
    """
    Set the transform of a prim in its parent.

    :param pose: x y z qx qy qz qw [m], (7,).
    :param scale: along its own axes, (3,); None = 1.
    """
    order = ['xformOp:translate', 'xformOp:orient']
    put(spec, 'double3', order[0], Gf.Vec3d(*pose[:3].tolist()))
    put(spec, 'quatf', order[1], quaternion(pose[3:]))
    if scale is not None:
        order.append('xformOp:scale')
        put(spec, 'float3', order[2], Gf.Vec3f(*scale.tolist()))
    put(spec, 'token[]', 'xformOpOrder', Vt.TokenArray(order), uniform=True)


def quaternion(attitude: np.ndarray) -> Gf.Quatf:
    """Convert xyzw to USD's quaternion."""
    x, y, z, w = attitude.tolist()
    return Gf.Quatf(w, x, y, z)


def vectors(rows: np.ndarray) -> Any:
    """Convert rows (K, 2) or (K, 3) to an array of single-precision vectors."""
    kind = Vt.Vec2fArray if rows.shape[1] == 2 else Vt.Vec3fArray
    return kind.FromNumpy(np.ascontiguousarray(rows, np.float32))


def numbers(values: np.ndarray) -> Any:
    """Convert integers (K,) to an array."""
    return Vt.IntArray.FromNumpy(np.ascontiguousarray(values, np.int32))
