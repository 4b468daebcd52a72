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

"""References: check that every name used by a rule exists, before the derivation."""

from collections.abc import Iterator

from procphys_ros.errors import nearest_names
from procphys_ros.wallgrammar.spec import Call, Division, Part, Repeat, Spec, Split, Successor


def check(spec: Spec) -> None:
    """
    Check that called rules and panels exist and take the given number of arguments.

    :param spec: a parsed grammar.
    :raises GrammarError: at the first such call.
    """
    for body in (spec.building, *spec.wings):
        for start in body.facades:
            _check_call(spec, start)
    for rules in spec.rules.values():
        for rule in rules:
            for call in _calls(rule.successor):
                _check_call(spec, call)


def _calls(node: 'Successor | Part | Repeat') -> Iterator[Call]:
    if isinstance(node, Call):
        yield node
    elif isinstance(node, Split | Repeat):
        for part in node.parts:
            yield from _calls(part)
    elif isinstance(node, Part):
        yield from _calls(node.successor)
    elif isinstance(node, Division):
        for content in node.contents:
            yield from _calls(content)


def _check_call(spec: Spec, call: Call) -> None:
    if call.name in spec.panels:
        if call.arguments:
            raise call.place.error(f'the panel "{call.name}" takes no arguments')
        return
    rules = spec.rules.get(call.name)
    if rules is None:
        known = [*spec.rules, *spec.panels]
        raise call.place.error(
            f'unknown rule or panel "{call.name}"{nearest_names(call.name, known)} '
            f'(rules: {", ".join(spec.rules) or "none"}; '
            f'panels: {", ".join(spec.panels) or "none"})')
    counts = sorted({len(rule.parameters) for rule in rules})
    if len(call.arguments) not in counts:
        raise call.place.error(
            f'the rule "{call.name}" takes {" or ".join(map(str, counts))} arguments, '
            f'found {len(call.arguments)}')
