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

"""Find a scene by a file, the name of a shipped scene, or a grammar."""

from collections.abc import Mapping
from pathlib import Path

from procphys_ros.errors import nearest_names, SceneError
from procphys_ros.files.resources import shared_folder
from procphys_ros.language import shorten
from procphys_ros.scene.scene import Scene
from procphys_ros.scene.sources import GRAMMARS, load_grammar

_SCENES = ('.yaml', '.yml')


def shipped_scenes() -> dict[str, Path]:
    """Find the scenes that come with the package, by name."""
    return {path.stem: path for path in sorted((shared_folder() / 'config').glob('*.yaml'))}


def scene_file(word: str) -> Path:
    """
    Find a scene file.

    :param word: its path, or the name of a shipped scene.
    :raises SceneError: when it is neither.
    """
    path, shipped = Path(word), shipped_scenes()
    if word in shipped:
        return shipped[word]
    if path.suffix not in _SCENES and not (word and path.exists()):
        raise SceneError(
            f'"{shorten(word)}" is neither a scene file ({", ".join(_SCENES)}) nor the name of a '
            f'shipped scene{nearest_names(word, shipped)} (shipped: {", ".join(shipped)})')
    return path


def shown_name(word: str) -> str:
    """Return the display name of a scene: of a shipped one, also by its path, or the word."""
    path = Path(word).resolve()
    return next((name for name, file in shipped_scenes().items() if file.resolve() == path), word)


def open_scene(word: str, seed: int | None = None,
               defines: Mapping[str, float] | None = None) -> Scene:
    """
    Read a scene, or put one instance of a grammar or scanned tree on empty ground.

    :param word: as `scene_file` takes it, or a grammar: a path, or the name of a shipped one.
    :param seed: of a grammar; None = 0.
    :param defines: of a grammar; those that are not given keep its own values.
    :raises SceneError: when the name is unknown, or a scene gets arguments for a grammar.
    :raises GrammarError: when a grammar cannot be read or derived.
    """
    if Path(word).suffix not in GRAMMARS:
        path = scene_file(word)
        if seed is not None or defines:
            raise SceneError(f'{"--define" if defines else "--seed"}: is for a grammar; '
                             f'"{shorten(word)}" holds its own values')
        return Scene.from_yaml(path)
    scene = Scene()
    built = load_grammar(word, 'scene', Path()).build(seed=seed or 0, **(defines or {}))
    scene.add(built, name=Path(word).stem)
    return scene
