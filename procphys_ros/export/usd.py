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

"""USD: a scene with UsdPhysics, for Isaac Sim, Newton, Omniverse, Blender and others."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf

from procphys_ros.appearance.paving import Paving
from procphys_ros.blueprint import GROUND, Law
from procphys_ros.export.articulation import articulate, Articulation, LOOSE
from procphys_ros.export.content import Content, Report
from procphys_ros.export.markup import unlike
from procphys_ros.export.mechanism_tree import mechanism_tree
from procphys_ros.export.surfaces import foliage_of, local_part, paved
from procphys_ros.export.surfaces import ground as ground_mesh
from procphys_ros.export.usd_joints import (
    add_base,
    add_hinge,
    add_mechanism_joint,
    add_weld,
    mortar_limits,
    pass_through,
)
from procphys_ros.export.usd_layer import Layer, place, put, refer, relate
from procphys_ros.export.usd_shapes import (
    add_collider,
    add_mesh,
    identifier,
    Materials,
    Prototypes,
    weigh,
)
from procphys_ros.geometry import rotation
from procphys_ros.physics.terrain import Terrain

ROOT = '/World'
_PROTOTYPES = '/Prototypes'
_GROUND_SIZE = 500.0  # [m] as drawn; the collision plane is infinite


def write_usd(content: Content, path: Path, report: Report) -> None:
    """
    Write a scene with its physics.

    :param content: to write.
    :param path: file that ends in .usda (text) or .usdc (binary); textures are written beside it.
    :param report: called as parts are written.
    """
    with Sdf.ChangeBlock():
        layer = Layer(ROOT)
        layer.prim(ROOT, 'Xform')
        materials = Materials(layer, f'{ROOT}/materials', path)
        _physics(layer, content.gravity)
        add_ground(layer, materials, content.terrain, content.paving)
        roots = _roots(content)
        paths = [f'{roots[owner]}/{identifier(name)}'
                 for owner, name in zip(content.owner, content.part_names)]
        for root in roots:
            layer.prim(root, 'Xform')
        joints = articulate(content)
        _segments(layer, materials, content, joints, paths)
        _hinges(layer, content, joints, paths, roots)
        _bricks(layer, materials, content, joints, paths, report)
        _welds(layer, content, paths, report)
        _mechanisms(layer, content, paths)
    materials.write()


def _roots(content: Content) -> list[str]:
    """Return unique paths of the objects, different from those of the ground and others."""
    taken = {'physics', 'ground', 'materials', 'trees',
             *(f'paving_{number}' for number in range(len(content.paving)))}
    names = []
    for owner in content.objects:
        names.append(unlike(identifier(owner.name), taken))
        taken.add(names[-1])
    return [f'{ROOT}/{name}' for name in names]


def _physics(layer: Layer, gravity: float) -> None:
    scene = layer.prim(f'{ROOT}/physics', 'PhysicsScene')
    put(scene, 'vector3f', 'physics:gravityDirection', Gf.Vec3f(0.0, 0.0, -1.0))
    put(scene, 'float', 'physics:gravityMagnitude', gravity)


def add_ground(layer: Layer, materials: Materials, terrain: Terrain,
               paving: Sequence[Paving]) -> None:
    """Write the ground, a plane or a mesh for collision, and visual-only surfaces."""
    for number, one in enumerate(paving):
        add_mesh(layer, f'{ROOT}/paving_{number}', paved(one), materials.path(one.texture))
    if not terrain.is_flat:
        add_mesh(layer, f'{ROOT}/ground', ground_mesh(terrain), materials.path('ground'))
        hills = layer.prim(f'{ROOT}/ground', 'Mesh', [
            'MaterialBindingAPI', 'PhysicsCollisionAPI', 'PhysicsMeshCollisionAPI'])
        put(hills, 'token', 'physics:approximation', 'none', uniform=True)
        return
    ground = layer.prim(f'{ROOT}/ground', 'Plane', ['PhysicsCollisionAPI', 'MaterialBindingAPI'])
    put(ground, 'token', 'axis', 'Z', uniform=True)
    put(ground, 'double', 'width', _GROUND_SIZE)
    put(ground, 'double', 'length', _GROUND_SIZE)
    relate(ground, 'material:binding', [materials.path('ground')])


def _segments(layer: Layer, materials: Materials, content: Content, joints: Articulation,
              paths: list[str]) -> None:
    """Write the segments of trees as rigid bodies with bark and leaves."""
    for row, part in enumerate(joints.part.tolist()):
        apis = ['PhysicsRigidBodyAPI', 'PhysicsMassAPI']
        if joints.parent[row] == LOOSE and (joints.parent == row).any():
            apis.append('PhysicsArticulationRootAPI')
        spec = layer.prim(paths[part], 'Xform', apis)
        place(spec, content.poses[part])
        weigh(spec, content, part)
        bark = content.textures[content.blueprint.texture[part]]
        add_mesh(layer, f'{paths[part]}/bark', local_part(content, part), materials.path(bark))
        add_collider(layer, f'{paths[part]}/collider', content, part)
        for number, (name, _, shape) in enumerate(foliage_of(content, part)):
            add_mesh(layer, f'{paths[part]}/leaves_{number}', shape, materials.path(name), True)


def _hinges(layer: Layer, content: Content, joints: Articulation, paths: list[str],
            roots: list[str]) -> None:
    """Attach the segments of each tree to a base that is fixed to the world."""
    bases: dict[int, tuple[str, np.ndarray]] = {}
    for row in np.flatnonzero(joints.parent != LOOSE).tolist():
        part, parent = int(joints.part[row]), int(joints.parent[row])
        rest = content.blueprint.bond_frame[joints.bond[row]]
        owner = int(content.owner[part])
        if parent < 0:
            if owner not in bases:
                bases[owner] = add_base(layer, roots[owner], rest)
            body, home = bases[owner]
        else:
            body = paths[joints.part[parent]]
            home = content.blueprint.poses[joints.part[parent]]
        add_hinge(layer, f'{paths[part]}_joint', (body, paths[part]),
                  rotation.relative(home, rest), content, joints, row)
    trees = [roots[owner] for owner in bases]
    if trees:
        pass_through(layer, f'{ROOT}/trees', trees)


def _bricks(layer: Layer, materials: Materials, content: Content, joints: Articulation,
            paths: list[str], report: Report) -> None:
    """Write all parts that are not branches as instances of their shapes."""
    shapes = Prototypes(layer, _PROTOTYPES, content, materials)
    mine = content.exists.copy()
    mine[joints.part] = False
    parts = np.flatnonzero(mine)
    for done, part in enumerate(parts.tolist(), 1):
        spec = layer.prim(paths[part], 'Xform')
        refer(spec, shapes.path(part), instance=True)
        place(spec, content.poses[part])
        report(done, len(parts))


def _mechanisms(layer: Layer, content: Content, paths: list[str]) -> None:
    """Join the parts of mechanisms."""
    joints, machine = content.blueprint.joints, mechanism_tree(content)
    alive = np.flatnonzero(content.joints_hold).tolist()
    for scope in dict.fromkeys(f'{paths[part].rpartition("/")[0]}/joints'
                               for part in joints.parts[alive, 1].tolist()):
        layer.prim(scope, 'Scope')
    for row in alive:
        first, second = joints.parts[row].tolist()
        bodies = ('' if first == GROUND else paths[first], paths[second])
        name = identifier(content.joint_names[row].rpartition('/')[2])
        add_mechanism_joint(layer, f'{paths[second].rpartition("/")[0]}/joints/{name}', bodies,
                            (machine.bases[row], machine.seats[row]), joints, row)


def _welds(layer: Layer, content: Content, paths: list[str], report: Report) -> None:
    """Join unbroken mortar bonds by breakable fixed joints."""
    blueprint, (one, other) = content.blueprint, content.bond_seats
    bonds = np.flatnonzero(content.holds & (blueprint.bond_law == Law.MORTAR))
    force, torque = mortar_limits(blueprint)
    scopes = {f'{paths[part].rpartition("/")[0]}/bonds'
              for part in np.unique(blueprint.bonds[bonds, 1])}
    for scope in sorted(scopes):
        layer.prim(scope, 'Scope')
    for done, bond in enumerate(bonds.tolist(), 1):
        report(done, len(bonds))
        first, second = blueprint.bonds[bond].tolist()
        bodies = ('' if first == GROUND else paths[first], paths[second])
        path = f'{paths[second].rpartition("/")[0]}/bonds/bond_{bond}'
        add_weld(layer, path, bodies, (one[bond], other[bond]), force[bond], torque[bond])
