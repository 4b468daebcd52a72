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

"""Map blocks: the houses, trees and roads of a map, built by the grammars that its rules name."""

from collections.abc import Callable, Iterator
import logging
import math
from pathlib import Path

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import GrammarError, SceneError
from procphys_ros.files.resources import shared_folder
from procphys_ros.maps import Feature, House, houses_of, PARTY, read_map, roads_of
from procphys_ros.scene.keys import draw_defines
from procphys_ros.scene.map_rules import MapRule, MapRules, read_rules
from procphys_ros.scene.plan import Street
from procphys_ros.scene.sources import Grammar
from procphys_ros.scene.streets import Lot
from procphys_ros.wallgrammar import WallGrammar

RULES = 'map.rules'  # shipped with the grammars
_LOG = logging.getLogger(__name__)


class MapBlock:
    """
    Content of a map, for a scene.

    :ivar streets: roads in straight pieces.
    :ivar count: of houses and trees.
    """

    def __init__(self, path: Path, rules: Path | None):
        """
        Read a map.

        :param rules: which grammars its features take; None = the shipped ones.
        :raises SceneError: naming file, place, and what is allowed.
        """
        own = read_rules(rules or shared_folder() / 'grammars' / RULES)
        found = read_map(path)
        features = found.in_metres()
        if not features:
            raise SceneError(f'{path}: there is no building, road or tree in it; ' + (', '.join(
                f'{count} {kind}' for kind, count in found.left_out.items()) or 'nothing')
                + ' was left out')
        self.streets = [street for one in features if one.kind == 'road'
                        for street in _streets(one, own)]
        self._houses = [
            (feature, house, rule) for feature, house in houses_of(features)
            if (rule := own.of('building', feature.tags)) is not None and rule.grammar]
        self._trees = [(one, rule) for one in features if one.kind == 'tree'
                       and (rule := own.of('tree', one.tags)) is not None and rule.grammar]
        self.count = len(self._houses) + len(self._trees)

    def lots(self, seed: int, load: Callable[[str], Grammar]) -> Iterator[Lot | None]:
        """
        Build and place the houses, then the trees; None for a house that cannot be built.

        :param seed: of random numbers.
        :param load: reads a grammar.
        :raises SceneError: when a rule names a grammar that is none of walls.
        """
        told: dict[str, list[str]] = {}
        for number, (feature, house, rule) in enumerate(self._houses):
            rng = np.random.default_rng([seed, 25, number])
            built, notes, reason = None, [str(house)], ''
            if isinstance(house, House):
                grammar = load(rule.grammar)
                if not isinstance(grammar, WallGrammar):
                    raise SceneError(f'{rule.grammar} is no grammar of walls')
                middle = house.corners.mean(axis=0).round(3)
                built, notes, reason = _built(grammar, feature, house.moved(-middle), rule, rng)
            for note in notes:
                told.setdefault(note, []).append(
                    feature.where + (f' ({reason})' if reason else ''))
            yield None if built is None else Lot(f'house_{number}', built, middle, 0.0)
        for note, places in told.items():
            _LOG.warning(f'{len(places)} of {len(self._houses)} houses: {note}, the first: '
                         f'{places[0]}')
        for number, (feature, rule) in enumerate(self._trees):
            rng = np.random.default_rng([seed, 26, number])
            blueprint = load(rule.grammar).build(seed=int(rng.integers(2 ** 31)),
                                                 **draw_defines(rule.defines, rng))
            yield Lot(f'tree_{number}', blueprint, feature.rings[0][0],
                      float(rng.uniform(-math.pi, math.pi)))


def _streets(feature: Feature, rules: MapRules) -> list[Street]:
    """Return the pieces of a road as streets."""
    rule = rules.of('road', feature.tags)
    if rule is None:
        return []
    return [Street(road.start, road.end, road.width, rule.surface, rule.pavement,
                   rule.pavement_surface) for road in roads_of(feature, rule.width)]


def _built(grammar: WallGrammar, feature: Feature, house: House, rule: MapRule,
           rng: np.random.Generator) -> tuple[Blueprint | None, list[str], str]:
    """
    Build a house, more plainly where the grammar cannot build it.

    :returns: its blueprint, what was left out, and why; no blueprint where nothing stands.
    """
    seed, defines, reason = int(rng.integers(2 ** 31)), draw_defines(rule.defines, rng), ''
    for told, plan, roof, bare in _attempts(house):
        try:
            found = grammar.over(
                plan.corners, plan.facades, feature.where, plan.storeys,
                plan.storey_height or rule.storey_height or None, roof,
                plan.pitch, bare).build(seed=seed, **defines)
        except GrammarError as error:
            reason = reason or error.message
            continue
        return found, [*house.notes, *told], reason
    return None, ['houses are left out'], reason


def _attempts(house: House) -> Iterator[tuple[list[str], House, str | None, bool]]:
    """
    Yield ways to build a house, from what the map tells to a box of masonry.

    Each is what is left out, the house, its roof, and whether it has no floors.
    """
    plans = [([], house), *((['outlines are simplified'], plan) for plan in house.plainer)]
    for told, plan in plans:
        roof = house.roof
        if plan.wide:
            yield [*told, 'wide ones have no floors and roofs'], plan, 'none', True
            continue
        if roof != 'flat' and plan.room != 'all':  # eaves would stand in those of a neighbour
            roof = 'gable' if plan.room == 'ridge' else 'flat'
        yield told, plan, roof, False
        if roof == 'gable' and plan.room == 'all':
            yield [*told, 'gables are hips'], plan, 'hip', False
            roof = 'hip'
        if roof != 'flat':
            yield [*told, 'floors are left out'], plan, roof, True
            yield [*told, 'roofs are flat'], plan, 'flat', False
        yield [*told, 'floors and roofs are left out'], plan, 'none', True
    for told, plan in plans:
        blind = plan._replace(facades=(PARTY,) * len(plan.corners))
        yield [*told, 'houses are boxes of masonry'], blind, 'none', True
