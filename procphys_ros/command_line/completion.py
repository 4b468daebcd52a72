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


"""Completion: what the TAB key offers, and the lines that teach a shell to ask for it."""

from collections.abc import Sequence
import json
import os
from pathlib import Path
import re

from procphys_ros.command_line import words
from procphys_ros.command_line.description import Description
from procphys_ros.files.resources import cache_home

_MOST = 200  # names offered at once; for thousands a shell asks whether to show them
_FIXED = {'wind': ('on', 'off'), 'completion': ('bash', 'zsh')}
_TAKES_PART = ('impulse', 'wrench', 'cut', 'list')
_ZSH = 'autoload -U +X compinit && compinit; autoload -U +X bashcompinit && bashcompinit\n'
_SHELL = """\
_procphys_command() {{
  local IFS=$'\\n'
  COMPREPLY=($({program} __complete "${{COMP_WORDS[@]:1:COMP_CWORD}}" 2>/dev/null))
  if [[ ${{COMPREPLY[0]-}} == */ ]]; then compopt -o nospace 2>/dev/null; fi
}}
complete -F _procphys_command {names}
"""


def script(shell: str, program: str) -> str:
    """
    Return the shell code that enables completion of the command.

    :param shell: 'bash' or 'zsh'.
    :param program: path of the command.
    """
    # `command` alone is a shell builtin: only the path identifies this program.
    names = ' '.join(dict.fromkeys([program, os.path.relpath(program)]))
    lines = _SHELL.format(program=program, names=names)
    return _ZSH + lines if shell == 'zsh' else lines


def answers(typed: Sequence[str], scene: Path) -> list[str]:
    """
    Offer completions.

    :param typed: words so far; the last is incomplete and may be empty.
    :param scene: file with the names of the last known scene, see `remember`.
    """
    *before, word = typed or ['']
    verb = next((w for w in before if w in words.verbs()), '')
    if word.startswith('--'):
        found = words.options(verb)
    elif not verb:
        found = words.verbs()
    elif verb in _FIXED and before[-1] == verb:
        found = list(_FIXED[verb])
    elif verb in _TAKES_PART and before[-1] == verb:
        found = _names(word, scene)
    else:
        found = []
    return [name for name in found if name.startswith(word)][:_MOST]


def remember(description: Description, scene: Path) -> None:
    """
    Store the names of a scene for completion, which cannot wait for a node to be found.

    :param description: from the node.
    :param scene: file to write; errors are ignored.
    """
    names = {owner: description.parts(owner) for owner in description.objects}
    if scene.parts[0] == '~':  # neither HOME nor the user database has a home
        return
    try:
        scene.parent.mkdir(parents=True, exist_ok=True)
        scene.write_text(json.dumps(names), 'utf-8')
    except OSError:
        pass


def memory(node: str) -> Path:
    """Return the file for the names of a node's scene, one for each ROS domain."""
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    return cache_home() / f'{domain}{re.sub(r"[^A-Za-z0-9_]", ".", node)}.json'


def _names(word: str, scene: Path) -> list[str]:
    """Offer objects, and after a slash their parts."""
    try:
        known: dict[str, list[str]] = json.loads(scene.read_text('utf-8'))
    except (OSError, ValueError):
        return []
    owner, slash, _ = word.partition('/')
    return known.get(owner, []) if slash else [f'{name}/' for name in known]
