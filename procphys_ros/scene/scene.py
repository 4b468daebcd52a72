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

"""Scene: blueprints placed in the world, in the part order that holds from here to ROS."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
import logging
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from procphys_ros.appearance.paving import Paving
from procphys_ros.blueprint import Blueprint, chain
from procphys_ros.compilation.threads import most_threads
from procphys_ros.elementary import cos, sin
from procphys_ros.environment.habitat import Habitat
from procphys_ros.errors import nearest_names, SceneError
from procphys_ros.files.file_bounds import named_by
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import product
from procphys_ros.lsystem import grow, Growth, LSystem
from procphys_ros.lsystem.growth import build_drawn
from procphys_ros.maps import MAPS
from procphys_ros.progress import stage
from procphys_ros.scene.bearing import bear
from procphys_ros.scene.capacity import available_memory, check_capacity
from procphys_ros.scene.ground_record import read_ground_record
from procphys_ros.scene.layout import places
from procphys_ros.scene.objects import ObjectSpec, read_objects
from procphys_ros.scene.paving import pave
from procphys_ros.scene.placement import stand_on, unbonded
from procphys_ros.scene.plan import read_plan, Street
from procphys_ros.scene.plants import ScenePlant, Stand
from procphys_ros.scene.settings import read_settings, Settings
from procphys_ros.scene.shards import Shard
from procphys_ros.scene.soundness import check_blueprint
from procphys_ros.scene.sources import Grammar, load_grammar, locate, parse_grammar, PLAN, SITES
from procphys_ros.scene.streets import lay_out, Lot
from procphys_ros.scene.terrain import make_terrain
from procphys_ros.scene.tying import tie
from procphys_ros.scene.unused import check_given
from procphys_ros.scene.wind_map import read_wind_map
from procphys_ros.scene.wind_record import read_wind_record
from procphys_ros.scene.yaml_file import read_yaml
from procphys_ros.schema import Parameter, short

_LOG = logging.getLogger(__name__)
_SMALLEST = 0.5  # of the mean part count so far, as a lower bound for the individuals to come
_POSITION = Parameter('position', [0.0, 0.0, 0.0], 'where the origin of an object goes', 'm')
_YAW = Parameter('yaw', 0.0, 'turn of an object about the vertical', 'rad')


@dataclass(frozen=True)
class SceneObject:
    """
    One placed instance.

    :ivar name: unique in the scene.
    :ivar first: index of its first part.
    :ivar count: number of its parts.
    """

    name: str
    first: int
    count: int


class _Sapling(NamedTuple):
    """A plant that grows among others: its name, its place [m], (3,), and its turn [rad]."""

    name: str
    position: np.ndarray
    yaw: float
    growth: Growth


def _grown(seedling: Growth) -> Blueprint:
    """Build a plant that asks nothing, as far as it is to be derived."""
    plant = seedling.resumed()
    grow([plant])
    return build_drawn(plant.draw())


def check_name(name: str) -> None:
    """
    Check that a name can begin the names of parts, as in oak_0/17.

    :raises SceneError: when it is not a text, or has a slash or unprintable characters.
    """
    if not isinstance(name, str) or '/' in name or not name.isprintable():
        raise SceneError(f'{short(name)} cannot name an object; a name is a text without a slash '
                         'and line breaks')


def check_place(name: str, blueprint: Blueprint, position: Sequence[float], yaw: float) -> None:
    """
    Check that an object can be placed.

    :raises SceneError: for an invalid name, a place that is not finite, no blueprint, or one
        with numbers that cannot be simulated.
    """
    check_name(name)
    if not isinstance(blueprint, Blueprint):
        raise SceneError(f'{name} is {short(blueprint)}, it must be a Blueprint; `build` of a '
                         'grammar makes one')
    _POSITION.read(position, f'{name}.position')
    _YAW.read(yaw, f'{name}.yaw')
    check_blueprint(name, blueprint)


class Scene:
    """
    Placed objects and the settings of the world they stand in.

    :ivar objects: instances in part order.
    :ivar settings: gravity, time step, seed, wind and gust.
    :ivar paving: of its streets.
    :ivar shard: its share of a larger scene.
    :ivar plants: those of L-systems, which can grow on while it runs, by name.
    """

    def __init__(self, settings: Settings | None = None):
        if not isinstance(settings, Settings | None):
            raise SceneError(f'{short(settings)} is no Settings; Scene.from_yaml reads a file')
        self.settings = settings or Settings()
        self.objects: list[SceneObject] = []
        self._blueprints: list[Blueprint] = []
        self._carriers: list[np.ndarray] = []  # by object and bond: the bearing part, -1 = none
        self._hosts: list[np.ndarray] = []  # by object and joint: the branch it leads to, likewise
        self.paving: list[Paving] = []
        self.shard = Shard()
        self.plants: dict[str, ScenePlant] = {}
        self._instances = 0
        self._chained: Blueprint | None = None
        self._names: set[str] = set()
        self._memory = available_memory()

    @classmethod
    def from_yaml(cls, path: str | Path) -> 'Scene':
        """
        Read a scene file, which is a ROS parameter file of the node.

        :param path: the file.
        :raises SceneError: naming the file, the key and what is allowed.
        :raises GrammarError: when a grammar of the scene cannot be read or derived.
        """
        parameters = read_yaml(path)
        try:
            return cls.from_parameters(parameters, Path(path).absolute().parent)
        except SceneError as error:
            raise SceneError(f'{path}: {error}') from error

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any],
                        beside: Path | None = None) -> 'Scene':
        """
        Build a scene from a nested mapping of parameters.

        :param parameters: as in the `ros__parameters` of a parameter file.
        :param beside: folder of that file, searched first for grammars; None = unknown.
        :raises SceneError: naming the key and what is allowed.
        :raises GrammarError: when a grammar cannot be read or derived.
        """
        if not isinstance(parameters, Mapping):
            raise SceneError(f'the parameters are {short(parameters)}, they must be a mapping')
        specs = read_objects(parameters)
        for line in check_given(parameters, [spec.name for spec in specs]):
            _LOG.warning(line)
        if not specs:
            _LOG.warning('scene.objects is empty: nothing stands in the scene')
        settings = read_settings(parameters)
        scene = cls(replace(settings, wind_record=read_wind_record(settings.wind.file, beside),
                            wind_map=read_wind_map(settings.wind.map, beside),
                            ground_record=read_ground_record(settings.motion.motion, beside),
                            terrain=make_terrain(settings.ground, settings.seed, beside)))
        scene.shard = Shard.read(parameters)
        scene._add_objects(specs, beside)
        return scene

    @property
    def _parts(self) -> int:
        """Count the parts so far."""
        return self.objects[-1].first + self.objects[-1].count if self.objects else 0

    @property
    def blueprint(self) -> Blueprint:
        """All parts and bonds of the scene in the world frame."""
        if self._chained is None:
            chained = chain(self._blueprints)
            carriers = np.concatenate([np.zeros(0, np.intp), *self._carriers])
            if (carriers >= 0).any():
                bonds = chained.bonds.copy()
                bonds[carriers >= 0, 0] = carriers[carriers >= 0]
                chained = replace(chained, bonds=bonds)
            hosts = np.concatenate([np.zeros(0, np.intp), *self._hosts])
            if (hosts >= 0).any():
                parts = chained.joints.parts.copy()
                parts[hosts >= 0, 0] = hosts[hosts >= 0]
                chained = replace(chained, joints=replace(chained.joints, parts=parts))
            self._chained = chained
        return self._chained

    def add(self, blueprint: Blueprint, position: Sequence[float] = (0.0, 0.0, 0.0),
            yaw: float = 0.0, name: str = '', on: str = '', tied_to: str = '') -> SceneObject:
        """
        Place a blueprint; buildings are bonded to the ground where they stand on it.

        :param blueprint: to be placed; it is not changed.
        :param position: where its origin goes [m], (3,), world frame; z counts from the ground.
        :param yaw: turn about the vertical [rad].
        :param name: unique name, `object_<n>` when left out.
        :param on: object that it stands on and is bonded to, z counts from its top; '' = ground.
        :param tied_to: object to whose branches its ropes to the ground are tied instead.
        :raises SceneError: when the name is invalid or taken, the place not finite or off the
            terrain, the blueprint wrong, when nothing of the object `on` is under it, or when
            memory cannot hold so many parts.
        """
        name = name or f'object_{len(self.objects)}'
        check_place(name, blueprint, position, yaw)
        return self._place(blueprint, position, yaw, name, on, tied_to)

    def _place(self, blueprint: Blueprint, position: Sequence[float], yaw: float, name: str,
               on: str = '', tied_to: str = '') -> SceneObject:
        """Place a blueprint whose numbers are sound, such as that of a grammar."""
        if name in self._names:
            raise SceneError(f'there are two objects called "{name}"')
        first = self._parts
        check_capacity(first + len(blueprint), self._memory)
        placed_at = blueprint.placed(position, yaw)
        if on:
            standing, carriers = self._bear(placed_at, name, on)
        else:
            standing = stand_on(self.settings.terrain, unbonded(placed_at, position[2]), name)
            carriers = np.full(len(standing.bonds), -1)
        hosts = np.full(len(standing.joints), -1)
        if tied_to:
            tree, base = self._known(tied_to, f'{name}.tied_to')
            standing, hosts = tie(tree, standing, name, tied_to)
            hosts[hosts >= 0] += base
        self._hosts.append(hosts)
        placed = SceneObject(name, first, len(standing))
        self._blueprints.append(standing)
        self._carriers.append(carriers)
        self._chained = None
        self.objects.append(placed)
        self._names.add(name)
        return placed

    def _bear(self, placed: Blueprint, name: str, on: str) -> tuple[Blueprint, np.ndarray]:
        """Place an object on another; return it and the bearing part of each bond, -1 = none."""
        base, first = self._known(on, f'{name}.on')
        standing, carriers = bear(base, placed, name, on)
        return standing, np.where(carriers < 0, -1, first + carriers)

    def _known(self, name: str, key: str) -> tuple[Blueprint, int]:
        """Return an object that a parameter names, as placed, and its first part."""
        names = [known.name for known in self.objects]
        if name not in names:
            shown = ', '.join(names) or 'none'
            raise SceneError(f'{key}: there is no object "{name}" before it'
                             f'{nearest_names(name, names)} (objects: {shown})')
        return self._blueprints[names.index(name)], self.objects[names.index(name)].first

    def _add_objects(self, specs: Sequence[ObjectSpec], beside: Path | None) -> None:
        """
        Build and place all objects.

        Plants that ask where they stand grow among all that is listed before them, and together
        with those that are listed next to them.
        """
        stand: list[_Sapling] = []
        for number, spec in enumerate(specs):
            if (spec.on or spec.tied_to) and self.shard.count > 1:
                raise SceneError(f'{spec.name}.{"on" if spec.on else "tied_to"}: objects that '
                                 'hang on others cannot be shared among nodes; leave shard.count '
                                 'at 1')
            if spec.rules and not spec.grammar.endswith(MAPS):
                raise SceneError(f'{spec.name}.rules: only maps ({", ".join(MAPS)}) have rules')
            if spec.grammar.endswith(SITES):
                self._grow(stand)
                self._add_site(spec, number, beside)
                continue
            key = f'{spec.name}.grammar'
            grammar = (load_grammar(spec.grammar, key, beside) if spec.grammar
                       else parse_grammar(spec.grammar_text, f'{key}_text'))
            if spec.steps >= 0 and not isinstance(grammar, LSystem):
                raise SceneError(f'{spec.name}.steps: only L-systems are derived in steps')
            if isinstance(grammar, LSystem) and grammar.asks:
                stand += self._saplings(spec, number, grammar)
            else:
                self._grow(stand)
                self._add_object(spec, number, grammar)
        self._grow(stand)

    def _add_object(self, spec: ObjectSpec, number: int, grammar: Grammar) -> None:
        """Build and place all instances of one object; number makes its default seed its own."""
        seed, points, headings = self._spots(spec, number)
        names = spec.instance_names
        variants = min(spec.variants or len(names), len(names))
        mine = self.shard.members(self._instances, len(names))
        self._instances += len(names)
        built: dict[int, Blueprint] = {}
        seedlings: dict[int, Growth] = {}
        grown = 0
        for i in sorted({i % variants for i in mine}):
            with stage('growing objects', f'{names[i]}, {i + 1} of {variants}'):
                if isinstance(grammar, LSystem):
                    seedlings[i] = grammar.plant(rotation.ORIGIN, seed + i, spec.numbers,
                                                 spec.length)
                built[i] = (grammar.build(seed=seed + i, **spec.numbers) if spec.length is None
                            else _grown(seedlings[i]))
            grown += len(built[i])
            foreseen = _SMALLEST * len(mine) * grown / len(built)
            check_capacity(self._parts + max(grown, int(foreseen)), self._memory)
        check_capacity(self._parts + sum(len(built[i % variants]) for i in mine), self._memory)
        for i in mine:
            self._place(built[i % variants], points[i], headings[i], names[i], spec.on,
                        spec.tied_to)
            if seedlings and not spec.on:
                self.plants[names[i]] = ScenePlant(
                    seedlings[i % variants], tuple(points[i].tolist()), float(headings[i]),
                    Stand((names[i],)))

    def _seed(self, spec: ObjectSpec, number: int) -> int:
        return spec.seed if spec.seed >= 0 else self.settings.seed + 1_000_003 * number

    def _spots(self, spec: ObjectSpec, number: int) -> tuple[int, np.ndarray, np.ndarray]:
        """Return the seed of an object, and positions (N, 3) and headings (N,) of instances."""
        seed = self._seed(spec, number)
        points, headings = places(spec.layout, len(spec.instance_names), spec.spacing,
                                  np.random.default_rng([seed, number]))
        turn = np.array([[cos(spec.yaw), sin(spec.yaw)],
                         [-sin(spec.yaw), cos(spec.yaw)]])
        level = np.column_stack([product(points, turn), np.zeros(len(points))])
        return seed, np.asarray(spec.origin) + level, spec.yaw + headings

    def _saplings(self, spec: ObjectSpec, number: int, grammar: LSystem) -> list['_Sapling']:
        """Plant the instances of an object whose grammar asks where they stand."""
        for key, given in (('on', spec.on), ('tied_to', spec.tied_to),
                           ('variants', spec.variants)):
            if given:
                raise SceneError(f'{spec.name}.{key}: plants whose grammar asks where they stand '
                                 'grow on the ground, each on its own; leave it out')
        if self.shard.count > 1:
            raise SceneError(f'{spec.name}.grammar: plants that ask where they stand cannot be '
                             'shared among nodes; leave shard.count at 1')
        seed, points, headings = self._spots(spec, number)
        ground = self.settings.terrain.height(points)
        self._instances += len(points)
        return [_Sapling(name, point, float(heading), grammar.plant(
                    np.concatenate([point[:2], [point[2] + height], rotation.from_yaw(heading)]),
                    seed + i, spec.numbers, spec.length))
                for i, (name, point, heading, height) in enumerate(
                    zip(spec.instance_names, points, headings, ground))]

    def _grow(self, stand: list['_Sapling']) -> None:
        """Grow plants together, place them, and clear the list."""
        if not stand:
            return
        trees = self.settings.trees
        habitat = Habitat(self.blueprint, self.settings.terrain,
                          np.array(trees.growth_wind), trees.growth_storm,
                          self.settings.gravity, most_threads(self.settings.threads))
        with stage('growing objects', f'{len(stand)} that ask where they stand'):
            grow([sapling.growth for sapling in stand], habitat)
            drawn = [(sapling, sapling.growth.drawn()) for sapling in stand]
            alive = Stand(tuple(sapling.name for sapling, own in drawn if own is not None),
                          habitat)
            for sapling, own in drawn:
                if own is None:
                    _LOG.warning(f'{sapling.name} has died where it stands: nothing of it is left')
                    continue
                self._place(own.blueprint, sapling.position.tolist(), sapling.yaw, sapling.name)
                self.plants[sapling.name] = ScenePlant(
                    sapling.growth, tuple(sapling.position.tolist()), sapling.yaw, alive)
        stand.clear()

    def _add_site(self, spec: ObjectSpec, number: int, beside: Path | None) -> None:
        """Build and place the houses and trees of a plan or a map, `<name>_house_0` and so on."""
        key = f'{spec.name}.grammar'
        if spec.on or spec.tied_to:
            raise SceneError(f'{spec.name}.{"on" if spec.on else "tied_to"}: the houses and trees '
                             'of a plan stand on the ground')
        if spec.steps >= 0:
            raise SceneError(f'{spec.name}.steps: only L-systems are derived in steps')
        if spec.defines or spec.count:
            raise SceneError(f'{spec.name}: {key} is a plan, which has counts and defines of its '
                             f'own; leave {spec.name}.count and {spec.name}.defines out')
        with named_by(key, spec.grammar):
            self._fill_site(spec, self._seed(spec, number), locate(spec.grammar, key, beside),
                            beside)

    def _fill_site(self, spec: ObjectSpec, seed: int, path: Path, beside: Path | None) -> None:
        """Read a plan or a map, and build and place what is in it."""
        grammars: dict[str, Grammar] = {}

        def load(name: str) -> Grammar:
            if name not in grammars:
                grammars[name] = load_grammar(name, str(path), path.parent)
            return grammars[name]

        if path.suffix == PLAN:
            plan = read_plan(path)
            self._lay_out(spec, path, plan.streets, plan.count, lay_out(plan.rows, seed, load))
            return
        from procphys_ros.scene.map_block import MapBlock  # imports the language of walls
        with named_by(f'{spec.name}.rules', spec.rules):
            rules = locate(spec.rules, f'{spec.name}.rules', beside) if spec.rules else None
            block = MapBlock(path, rules)
        self._lay_out(spec, path, block.streets, block.count, block.lots(seed, load))

    def _lay_out(self, spec: ObjectSpec, path: Path, streets: Sequence[Street], count: int,
                 lots: Iterable[Lot | None]) -> None:
        """Pave streets, and place the houses and trees of a plan or a map that are there."""
        mine = set(self.shard.members(self._instances, count))
        self._instances += count
        turn = rotation.to_matrix(rotation.from_yaw(spec.yaw))[:2, :2]
        if self.shard.index == 0:
            self.paving += pave(streets, self.settings.terrain, np.asarray(spec.origin)[:2],
                                turn, str(path))
        for i, lot in enumerate(lots):
            if lot is None or i not in mine:
                continue
            with stage('growing objects', f'{spec.name}_{lot.name}, {i + 1} of {count}'):
                place = np.asarray(spec.origin) + [*product(turn, lot.position), 0.0]
                self._place(lot.blueprint, place, spec.yaw + lot.yaw, f'{spec.name}_{lot.name}')
