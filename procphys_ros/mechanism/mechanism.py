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

"""Mechanism: from the text of a mechanism grammar to a blueprint of parts and joints."""

from dataclasses import dataclass
from pathlib import Path

from procphys_ros.blueprint import Blueprint
from procphys_ros.language import (
    check_length,
    generator_of,
    GrammarFile,
    resolve_defines,
)
from procphys_ros.mechanism.assembly import assemble, usual_material
from procphys_ros.mechanism.derivation import MechanismWriter
from procphys_ros.mechanism.parser import parse
from procphys_ros.mechanism.spec import MechanismSpec
from procphys_ros.mechanism.tables import MATERIALS
from procphys_ros.wallgrammar.materials import Material
from procphys_ros.wallgrammar.tables import check_material, read_materials

MOST_PARTS = 10_000  # default bound on the parts of one mechanism
_REQUIRED = ('density',)


@dataclass(frozen=True)
class MechanismGrammar(GrammarFile):
    """
    A parsed mechanism grammar, ready to build.

    :ivar spec: definitions of the text.
    :ivar source: name of the text, for errors.
    :ivar most_parts: bound on the parts of the mechanism.
    """

    spec: MechanismSpec
    source: str
    materials: dict[str, Material]
    most_parts: int = MOST_PARTS

    @classmethod
    def parse(cls, text: str, source: str = '<text>', most_parts: int = MOST_PARTS,
              folder: Path | None = None) -> 'MechanismGrammar':
        """
        Read a grammar.

        :param text: the grammar.
        :param source: name for errors.
        :param most_parts: bound on the parts of the mechanism.
        :param folder: searched for included files before the shipped ones.
        :raises GrammarError: where the text does not fit the language.
        """
        check_length(text, source)
        spec = parse(text, source, folder)
        materials = read_materials(spec.materials, spec.places, MATERIALS, _REQUIRED)
        return cls(spec, source, materials, most_parts)

    def build(self, /, seed: int = 0, **defines: float) -> Blueprint:
        """
        Derive the mechanism.

        :param seed: of weighted rules and random numbers.
        :param defines: values of parameters that replace their defaults.
        :returns: parts and joints, in the coordinates of the text, the ground at 0.
        :raises GrammarError: when rules, values or materials do not make a mechanism.
        """
        generator = generator_of(seed, self.source)
        values = resolve_defines(self.spec.parameters, defines, generator, self.source)
        writer = MechanismWriter(self.spec, values, generator, self.most_parts)
        writer.write()
        if not writer.parts:
            raise self.spec.place.error(f'the mechanism "{self.spec.name}" has no parts')
        for part in writer.parts:
            check_material(usual_material(part), self.materials, part.place)
        return assemble(writer.parts, writer.joints, self.materials)
