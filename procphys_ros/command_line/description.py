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


"""Read `~/scene_description`, and list the contents of a scene."""

from collections import Counter
from collections.abc import Iterator
from fnmatch import fnmatchcase
import json
from typing import Any

from procphys_ros.errors import CommandError, nearest_names

_WILD = '*?['
_MOST_DIGITS = 18  # of an index


class Description:
    """
    Objects and parts of a scene.

    :param text: JSON of `~/scene_description`.
    """

    def __init__(self, text: str):
        self._content: dict[str, Any] = json.loads(text)
        self._ranges = {o['name']: range(o['first'], o['first'] + o['count'])
                        for o in self._content['objects'] if not o.get('removed')}

    @property
    def names(self) -> list[str]:
        """Return the names of all parts, in their order."""
        return self._content['parts']['name']

    @property
    def objects(self) -> list[str]:
        """Return the names of the objects."""
        return list(self._ranges)

    def parts(self, owner: str) -> list[str]:
        """Return the parts of an object as `<object>/<kind>_<index>`; empty if it is unknown."""
        return [self._content['parts']['name'][i] for i in self._ranges.get(owner, ())]

    def overview(self) -> Iterator[str]:
        """Yield a line per object: its name, its numbers of parts by kind, and their mass."""
        width = max((len(name) for name in self.objects), default=0)
        kinds, masses = self._content['parts']['kind'], self._content['parts']['mass']
        for name in self.objects:
            rows = self._ranges[name]
            counts = Counter(kinds[i] for i in rows)
            total = sum(masses[i] for i in rows)
            content = ', '.join(f'{count} {kind}' for kind, count in counts.most_common(5))
            more = ', …' if len(counts) > 5 else ''
            yield f'{name:{width}}  {len(rows):6d} parts  {_mass(total)}  {content}{more}'

    def listing(self, pattern: str) -> Iterator[str]:
        """
        Yield a line per part that matches a pattern.

        :param pattern: `oak_0`, `oak_*`, `house/pane`, `house/pane_3`, `house/12`, with wildcards.
        :raises CommandError: if there is none; the message suggests names.
        """
        owner, _, part = pattern.partition('/')
        owners = [name for name in self.objects if fnmatchcase(name, owner)]
        if not owners:
            raise CommandError(f'there is no object "{owner}"'
                               f'{nearest_names(owner, self.objects)}')
        chosen = [i for name in owners for i in self._matching(name, part)]
        if not chosen:
            kinds = {self._content['parts']['kind'][i] for name in owners
                     for i in self._ranges[name]}
            raise CommandError(f'no part of {owners[0]} is called "{part}"; kinds are '
                               f'{", ".join(sorted(kinds))}')
        parts = self._content['parts']
        width = max(len(parts['name'][i]) for i in chosen)
        for i in chosen:
            size = ' x '.join(f'{edge:.3g}' for edge in parts['size'][i])
            yield (f'{parts["name"][i]:{width}}  {_mass(parts["mass"][i])}  '
                   f'{parts["material"][i]}, {parts["shape"][i]} {size} m')

    def check_part(self, name: str) -> None:
        """
        Validate that a name or an index identifies one part.

        :raises CommandError: if it matches none, or several; the message suggests names.
        """
        total = len(self._content['parts']['name'])
        if name.isascii() and name.isdigit():
            if len(name) > _MOST_DIGITS or int(name) >= total:
                raise CommandError(f'there is no part {name[:_MOST_DIGITS]}; indices go from 0 to '
                                   f'{total - 1}')
            return
        owner, slash, part = name.partition('/')
        if owner not in self._ranges or not part:
            near = nearest_names(owner, self.objects)
            raise CommandError(f'there is no part "{name[:99]}"{near}; parts are called '
                               f'object/index, such as {next(iter(self.objects), "oak_0")}/0')
        found = [self._content['parts']['name'][i] for i in self._matching(owner, part)]
        if name not in found and not (part.isascii() and part.isdigit() and found):
            next(self.listing(name))
            raise CommandError(f'"{name}" means {len(found)} parts by kind or wildcard; say one, '
                               f'such as {found[0]}')

    def _matching(self, owner: str, part: str) -> Iterator[int]:
        """Find the parts of an object that match a kind, a name, an index or wildcards."""
        for local, i in enumerate(self._ranges.get(owner, ())):
            name = self._content['parts']['name'][i].rpartition('/')[2]
            kind = self._content['parts']['kind'][i]
            if not part or part in (str(local), name, kind) or (
                    any(c in part for c in _WILD) and fnmatchcase(name, part)):
                yield i


def _mass(kilograms: float) -> str:
    if kilograms >= 1000.0:
        return f'{kilograms / 1000.0:7.1f} t '
    if kilograms >= 1.0:
        return f'{kilograms:7.1f} kg'
    return f'{1000.0 * kilograms:7.1f} g '
