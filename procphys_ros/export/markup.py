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

"""Markup: what the XML formats share."""

from collections.abc import Container
from pathlib import Path
import xml.etree.ElementTree as ElementTree

import numpy as np

from procphys_ros.files.output_files import write_beside

_DIGITS = 9  # significant, of every number written: nanometres per metre


def text(*values: float) -> str:
    """Format numbers separated by spaces; zero has no sign."""
    return ' '.join(f'{value + 0.0:.{_DIGITS}g}' for value in values)


def child(parent: ElementTree.Element, tag: str, content: str | None = None,
          **attributes: str) -> ElementTree.Element:
    """
    Append an element.

    :param content: its text.
    :param attributes: a trailing _ is removed, for names such as `type_` and `class_`.
    """
    element = ElementTree.SubElement(
        parent, tag, {key.rstrip('_'): value for key, value in attributes.items()})
    element.text = content
    return element


def write(root: ElementTree.Element, path: Path, note: str) -> None:
    """
    Write a document.

    :param note: comment in front of the root element.
    """
    ElementTree.indent(root)
    body = ElementTree.tostring(root, encoding='unicode')
    head = f'<?xml version="1.0" encoding="utf-8"?>\n<!-- {note} -->\n'
    write_beside(path, lambda part: part.write_text(f'{head}{body}\n', encoding='utf-8'))


def roll_pitch_yaw(attitude: np.ndarray) -> np.ndarray:
    """
    Convert a quaternion to rotations about the fixed axes x, y, z in this order [rad], (3,).

    :param attitude: xyzw, (4,).
    """
    x, y, z, w = attitude
    pitch = np.clip(2.0 * (w * y - z * x), -1.0, 1.0)
    if abs(pitch) > 1.0 - 1e-12:  # straight up or down: yaw is set to zero
        return np.array([2.0 * np.arctan2(x, w), np.arcsin(pitch), 0.0])
    return np.array([np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
                     np.arcsin(pitch),
                     np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))])


def unlike(name: str, taken: Container[str]) -> str:
    """Return an unused name: the given one, with underscores appended if necessary."""
    while name in taken:
        name += '_'
    return name
