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


"""Executable `command`: command-line client for `sim`, one command per call."""

import argparse
from collections.abc import Callable, Sequence
from functools import partial
import os
from pathlib import Path
import signal
import sys
from typing import Any

from procphys_ros.command_line import answers, Description, read, script
from procphys_ros.command_line.completion import memory, remember
from procphys_ros.command_line.values import parse, show
from procphys_ros.errors import CommandError, GrammarError, nearest_names, SceneError
from procphys_ros.terminal.argument_parser import split_words
from procphys_ros.terminal.interruption import raising

_DONE, _REFUSED, _INVALID, _NOT_FOUND = 0, 1, 2, 3
_SENT = 'sent on ~/{topic}, which gives no answer; "watch" shows rejections'


def main(words: Sequence[str] | None = None) -> int:
    """
    Execute one command line.

    :param words: after the command's name; None = the process's own.
    :returns: exit code: 0 done, 1 refused, 2 invalid usage, 3 no node found.
    """
    words = sys.argv[1:] if words is None else list(words)
    if words[:1] == ['__complete']:
        typed = words[1:]
        node = typed[typed.index('--node') + 1] if '--node' in typed[:-1] else '/sim'
        print(*answers(typed, memory(node)), sep='\n')
        return _DONE
    own, for_ros = split_words(words)
    said = read(own)
    if said.verb == 'completion':
        program = os.environ.get('PROCPHYS_COMMAND') or str(Path(sys.argv[0]).resolve())
        print(script(said.shell, program), end='')
        return _DONE
    if said.verb == 'warm':
        from procphys_ros.warming.command import main as warm
        return warm([])
    end = partial(SystemExit, _DONE if said.verb == 'watch' else 130)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, raising(end))
    return _talk(said, for_ros)


def _talk(said: argparse.Namespace, ros_words: Sequence[str]) -> int:
    """Find the node, send the command, and print the answer."""
    # Late, because it takes half a second, which help and completion need not wait for.
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from procphys_ros.ros.remote import NoNodeError, PATIENCE, Remote
    from procphys_ros.ros.starting import start_ros
    remote = None
    try:
        start_ros(['command', *ros_words], signal_handler_options=SignalHandlerOptions.NO)
        remote = Remote(said.node, said.timeout, max(said.timeout, PATIENCE))
        _VERBS[said.verb](remote, said)
        return _DONE
    except SceneError as error:
        print(f'command: {error}', file=sys.stderr)
        return _INVALID
    except CommandError as error:
        print(f'command: {error}', file=sys.stderr)
        return _REFUSED
    except NoNodeError as error:
        print(f'command: {error}', file=sys.stderr)
        return _NOT_FOUND
    except BrokenPipeError:  # the reader of a pipe, such as head, has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _DONE
    finally:
        if remote is not None:
            remote.close()
        rclpy.try_shutdown()


def _wind(remote: Any, said: argparse.Namespace) -> None:
    words = said.velocity
    if len(words) == 1:
        print(remote.switch('set_wind_enabled', words[0]))
        return
    remote.change({'wind.velocity': words})
    print(f'wind {show(words)} m/s')


def _with_parameters(service: str, group: str, *names: str) -> Callable:
    """Set the given parameters of a group, and call the service that reads them."""
    def carry_out(remote: Any, said: argparse.Namespace) -> None:
        given = {f'{group}.{name}': getattr(said, name) for name in names}
        print(remote.trigger(service, {name: value for name, value in given.items()
                                       if value is not None}))
    return carry_out


def _on_part(topic: str) -> Callable:
    """Send a wrench or an impulse to a part, in one message: other clients cannot interfere."""
    def carry_out(remote: Any, said: argparse.Namespace) -> None:
        _described(remote, said).check_part(said.part)
        remote.push(topic, said.part, (said.x, said.y, said.z), said.angular)
        print(_SENT.format(topic=topic))
    return carry_out


def _downwash(remote: Any, said: argparse.Namespace) -> None:
    remote.push('downwash', said.name, (said.x, said.y, said.z), (0.0, 0.0, 0.0))
    print(_SENT.format(topic='downwash'))


def _joint(remote: Any, said: argparse.Namespace) -> None:
    remote.drive(said.joint, said.mode, said.value)
    print(_SENT.format(topic='joint_command'))


def _explode(remote: Any, said: argparse.Namespace) -> None:
    place = (said.x, said.y, said.z)
    if said.charge is None:
        remote.explode(place)
        print(_SENT.format(topic='explosion'))
        return
    print(remote.trigger('explode', {'explosion.position': place,
                                     'explosion.charge': said.charge}))


def _text_of(grammar: Path) -> str:
    """Read a file of the user's that the node may not reach, in our language; '' = no such."""
    from procphys_ros.language import TRANSLATED
    if not grammar.is_file():
        return ''
    try:
        if grammar.suffix in TRANSLATED:
            from procphys_ros.lsystem.translation import translated_text
            from procphys_ros.terminal.warning_lines import print_warning, told_to
            with told_to(print_warning):
                return translated_text(grammar)
        return grammar.read_text('utf-8-sig')
    except GrammarError as error:
        raise CommandError(str(error)) from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'it is not UTF-8 text'
        raise CommandError(f'{grammar}: {reason}') from None


def _spawn(remote: Any, said: argparse.Namespace) -> None:
    from procphys_ros.scene.sources import SCANS
    path = Path(said.grammar)
    scan = path.suffix in SCANS and path.is_file()  # too large for a parameter: the node reads it
    print(remote.trigger('spawn', {
        'spawn.name': said.name, 'spawn.defines': said.define, 'spawn.seed': said.seed,
        'spawn.grammar': str(path.absolute()) if scan else said.grammar,
        'spawn.grammar_text': '' if scan else _text_of(path),
        'spawn.position': (said.x, said.y, said.z), 'spawn.yaw': said.yaw}))


def _step(remote: Any, said: argparse.Namespace) -> None:
    for _ in range(said.count):
        answer = remote.trigger('step_simulation')
    print(answer)


def _get(remote: Any, said: argparse.Namespace) -> None:
    known = remote.parameters()
    names = [name for name in known if name.startswith(said.name)]
    if not names:
        raise CommandError(f'there is no parameter "{said.name}"{nearest_names(said.name, known)}')
    width = max(map(len, names))
    for name, value in zip(names, remote.values(names)):
        print(f'{name:{width}}  {show(value)}')


def _set(remote: Any, said: argparse.Namespace) -> None:
    known = remote.parameters()
    if said.name not in known:
        raise CommandError(f'there is no parameter "{said.name}"{nearest_names(said.name, known)}')
    value = parse(said.value, remote.values([said.name])[0], remote.holds_texts(said.name))
    remote.change({said.name: value})
    print(f'{said.name}  {show(value)}')


def _load(remote: Any, said: argparse.Namespace) -> None:
    given = {f'load.{name}': value for name, value in (
        ('snow', said.snow), ('ice', said.ice), ('ramp', said.ramp)) if value is not None}
    if given:
        remote.change(given)
    snow, ice, ramp = remote.values(['load.snow', 'load.ice', 'load.ramp'])
    print(f'snow {show(snow)} kg/m², ice {show(ice)} m, changes in {show(ramp)} s')


def _list(remote: Any, said: argparse.Namespace) -> None:
    description = _described(remote, said)
    lines = description.listing(said.pattern) if said.pattern else description.overview()
    for line in lines:
        print(line)


def _watch(remote: Any, said: argparse.Namespace) -> None:
    from procphys_ros.ros.watching import watch
    watch(remote, said.seconds, sys.stdout)


def _described(remote: Any, said: argparse.Namespace) -> Description:
    description = Description(remote.description())
    remember(description, memory(said.node))
    return description


def _trigger(service: str) -> Callable:
    return lambda remote, said: print(remote.trigger(service))


def _switch(service: str, on: bool) -> Callable:
    return lambda remote, said: print(remote.switch(service, on))


_VERBS: dict[str, Callable] = {
    'wind': _wind, 'impulse': _on_part('impulse'), 'wrench': _on_part('wrench'),
    'downwash': _downwash, 'joint': _joint, 'explode': _explode, 'step': _step,
    'gust': _with_parameters('gust', 'gust', 'amplitude', 'duration', 'direction'),
    'launch': _with_parameters('launch_projectile', 'projectile', 'shape', 'size', 'mass',
                               'position', 'velocity'),
    'earthquake': _with_parameters('earthquake', 'earthquake', 'peak', 'duration', 'scale',
                                   'start', 'direction'),
    'load': _load,
    'grow': _with_parameters('grow', 'grow', 'target', 'rate', 'years'),
    'cut': _with_parameters('cut', 'cut', 'target', 'point', 'normal', 'reach', 'hinge',
                            'towards'),
    'demolish': _trigger('demolish'), 'clear': _trigger('clear_wrenches'),
    'pause': _switch('set_pause', True), 'resume': _switch('set_pause', False),
    'reset': _trigger('reset_simulation'), 'reload': _trigger('reload_scene'),
    'spawn': _spawn, 'remove': _with_parameters('remove', 'spawn', 'name'),
    'get': _get, 'set': _set, 'list': _list, 'watch': _watch,
}

if __name__ == '__main__':
    sys.exit(main())
