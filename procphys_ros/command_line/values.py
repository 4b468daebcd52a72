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


"""Parse and print parameter values."""

from collections.abc import Sequence
from typing import Any

from procphys_ros.errors import CommandError

_TRUTH = {'true': True, 'on': True, 'yes': True, 'false': False, 'off': False, 'no': False}


def parse(words: Sequence[str], present: Any, of_texts: bool = False) -> Any:
    """
    Parse a value of the type of the present one.

    :param words: as typed; lists word by word, or in brackets with commas.
    :param present: value to be replaced; None = of any type.
    :param of_texts: whether that is a list of strings: then each word is an item, whatever it
        contains, unless all are in one pair of brackets.
    :raises CommandError: if it does not have that type.
    """
    if of_texts:
        return [] if words == [''] else _texts(words)
    words = [word for text in words for word in text.strip('[]').replace(',', ' ').split()] \
        if isinstance(present, list) else [' '.join(words)]
    if isinstance(present, list):
        texts = any(isinstance(value, str) for value in present)
        values = [word if texts else _number(word) for word in words]
        return [str(v) for v in values] if any(isinstance(v, str) for v in values) else values
    text = words[0]
    if isinstance(present, str):
        return text
    if isinstance(present, bool):
        if text.lower() not in _TRUTH:
            raise CommandError(f'"{text}" is neither true nor false')
        return _TRUTH[text.lower()]
    value = _number(text)
    if isinstance(value, str) and present is not None:
        raise CommandError(f'"{text}" is not a number')
    return value


def show(value: Any) -> str:
    """Format a value for `parse`."""
    if value is None:
        return '(not set)'
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, float):
        return f'{value:g}'
    if isinstance(value, int):
        return str(value)
    if isinstance(value, str):
        lines = value.splitlines()
        return value if len(lines) < 2 else f'{lines[0]} … ({len(lines)} lines)'
    return '[' + ', '.join(show(v) for v in value) + ']'


def _texts(words: Sequence[str]) -> list[str]:
    """Parse a list of strings, word by word or as in YAML."""
    text = ' '.join(words)
    if not (text.startswith('[') and text.endswith(']')):
        return list(words)
    import yaml  # late, because completion need not wait for it
    try:
        values = yaml.load(text, yaml.BaseLoader)  # reads strings only, also for 'on' and 12
    except yaml.YAMLError as error:
        raise CommandError(f'"{text}" is not a list such as [oak, pine]') from error
    if not all(isinstance(value, str) for value in values):
        raise CommandError(f'"{text}" is not a list of texts such as [oak, pine]')
    return values


def _number(word: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            pass
    return word
