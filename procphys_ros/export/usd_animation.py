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

"""USD animation: a simulated run as time samples of point instancers."""

from pathlib import Path

import numpy as np
from pxr import Sdf, Vt

from procphys_ros.blueprint import Shape
from procphys_ros.export.content import Content, Report
from procphys_ros.export.surfaces import foliage_of, local_part
from procphys_ros.export.usd import add_ground, ROOT
from procphys_ros.export.usd_layer import Layer, numbers, put, relate, vectors
from procphys_ros.export.usd_shapes import add_mesh, Materials
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

_SOON = 1e-9  # [s] rounding of times


class _Group:
    """
    Parts that joined the scene together, as one point instancer.

    :param layer: to write to.
    :param materials: of the scene.
    :param content: the scene when the parts joined.
    :param first: first of the parts; all after it belong to the group.
    :param code: time code of their first appearance; None = from the start.
    """

    def __init__(self, layer: Layer, materials: Materials, content: Content, first: int,
                 code: float | None):
        self._layer, self._materials = layer, materials
        self._parts = np.arange(first, len(content.blueprint))
        self._path = f'{ROOT}/parts_{first}'
        self._places = np.zeros((len(self._parts), 7))
        self._places[:, 6] = 1.0
        self._gone = np.zeros(0, np.int64)
        size = content.blueprint.visual_size[self._parts]
        self._margin = float(np.linalg.norm(size, axis=1).max(initial=0.0))
        spec = layer.prim(self._path, 'PointInstancer')
        shapes = self._shapes(content)
        relate(spec, 'prototypes', list(dict.fromkeys(shapes)))
        number = {path: i for i, path in enumerate(dict.fromkeys(shapes))}
        put(spec, 'int[]', 'protoIndices', numbers(np.array([number[path] for path in shapes])))
        for kind, name in (('point3f[]', 'positions'), ('quath[]', 'orientations'),
                           ('float3[]', 'extent'), ('int64[]', 'invisibleIds')):
            put(spec, kind, name, None)
        layer.sample(f'{self._path}.invisibleIds', 0.0, Vt.Int64Array())
        if code is not None:
            put(spec, 'token', 'visibility', 'inherited')
            layer.sample(f'{self._path}.visibility', 0.0, 'invisible')
            layer.sample(f'{self._path}.visibility', code, 'inherited')

    def sample(self, poses: np.ndarray, code: float) -> None:
        """
        Write the present poses of the parts.

        :param poses: of all parts, world [m], (N, 7); not finite = gone.
        :param code: time code.
        """
        mine = poses[self._parts]
        there = np.isfinite(mine).all(axis=1)
        self._places[there] = mine[there]  # parts that are gone keep their positions, invisible
        points = self._places[:, :3]
        self._layer.sample(f'{self._path}.positions', code, vectors(points))
        self._layer.sample(f'{self._path}.orientations', code, Vt.QuathArray.FromNumpy(
            np.ascontiguousarray(self._places[:, 3:], np.float16)))
        corners = np.array([points.min(axis=0) - self._margin, points.max(axis=0) + self._margin])
        self._layer.sample(f'{self._path}.extent', code, vectors(corners))
        gone = np.flatnonzero(~there)
        if not np.array_equal(gone, self._gone):
            self._gone = gone
            self._layer.sample(f'{self._path}.invisibleIds', code,
                               Vt.Int64Array.FromNumpy(gone.astype(np.int64)))

    def _shapes(self, content: Content) -> list[str]:
        """Write the prototypes; return the path of each part's prototype."""
        blueprint = content.blueprint
        carries = np.zeros(len(blueprint), bool)
        carries[blueprint.leaves.part] = carries[blueprint.ornaments.part] = True
        corners = {part: tuple(own) for part, own in zip(
            blueprint.hexahedra.part.tolist(), blueprint.hexahedra.corners.round(6).tolist())}
        known: dict[tuple[float, ...], str] = {}
        out = []
        self._layer.prim(f'{self._path}/shapes', 'Scope')
        for part in self._parts.tolist():
            key = (*blueprint.visual_size[part].round(9).tolist(), float(blueprint.shape[part]),
                   float(blueprint.texture[part]), float(part) if carries[part] else -1.0,
                   *corners.get(part, ()))
            if key not in known:
                known[key] = f'{self._path}/shapes/{Shape(blueprint.shape[part]).name.lower()}_' \
                             f'{len(known)}'
                self._shape(known[key], content, part, carries[part])
            out.append(known[key])
        return out

    def _shape(self, path: str, content: Content, part: int, carries: bool) -> None:
        self._layer.prim(path, 'Xform')
        texture = content.textures[content.blueprint.texture[part]]
        add_mesh(self._layer, f'{path}/surface', local_part(content, part),
                 self._materials.path(texture))
        for number, (name, _, shape) in enumerate(foliage_of(content, part) if carries else []):
            add_mesh(self._layer, f'{path}/leaves_{number}', shape, self._materials.path(name),
                     True)


def write_animation(scene: Scene, path: Path, start: float, end: float, fps: float,
                    report: Report) -> None:
    """
    Simulate a scene from rest and write a part of the run.

    Leaves are carried by their branches: they neither flutter nor fall.

    :param path: file that ends in .usda or .usdc; textures are written beside it.
    :param start: first moment [s].
    :param end: last moment [s].
    :param fps: moments per second, the unit of time codes.
    :param report: called with the simulated and the total time [s].
    """
    simulation = Simulation(scene)
    layer = Layer(ROOT)
    layer.set_metadata(timeCodesPerSecond=fps, framesPerSecond=fps, startTimeCode=start * fps,
                       endTimeCode=end * fps)
    with Sdf.ChangeBlock():
        layer.prim(ROOT, 'Xform')
        materials = Materials(layer, f'{ROOT}/materials', path)
        add_ground(layer, materials, scene.settings.terrain, scene.paving)
        groups: list[_Group] = []
        known, due = 0, start
        while due <= end + _SOON:
            while simulation.time < due - 0.5 * simulation.time_step:
                simulation.step()
                report(simulation.time, end)
            code = simulation.time * fps
            if len(simulation.blueprint) > known:
                groups.append(_Group(layer, materials, Content.of(simulation), known,
                                     code if groups else None))
                known = len(simulation.blueprint)
            for group in groups:
                group.sample(simulation.state.shown_poses(), code)
            due += 1.0 / fps
    simulation.close()
    materials.write()
