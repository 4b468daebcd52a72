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

"""Who gets the page, and who may command by it: nobody without its address, no other site."""

from http.client import HTTPConnection
import socket
from types import SimpleNamespace

import pytest
from view_scene import frame_of, free_port, simulation_at_rest

from procphys_ros.ros import view
from procphys_ros.view.guard import Guard
from procphys_ros.view.library import ViewError
from procphys_ros.view.page import Page
from procphys_ros.view.source import Status

viser = pytest.importorskip('viser')
connect = pytest.importorskip('websockets.sync.client').connect
InvalidStatus = pytest.importorskip('websockets.exceptions').InvalidStatus
EVIL = 'http://evil.example'


class Still:
    """A source that shows one frame and hears nothing."""

    can_undo = False

    def __init__(self):
        self.watched, self.moment = False, frame_of(simulation_at_rest())

    def frame(self):
        return self.moment

    def status(self):
        return Status(True, 'fine')

    def answer(self):
        return ''

    def say(self, command):
        raise AssertionError(command)


@pytest.fixture(scope='module')
def page():
    """Serve a page that a proxy passes on."""
    made = Page(Still(), port=free_port(), names=['robots.example'])
    yield made
    made.close()


def asked(page, path, **headers):
    """Ask for a path; return the status and the text."""
    connection = HTTPConnection('localhost', page.server.get_port(), timeout=60)
    connection.putrequest('GET', path, skip_host='Host' in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    return answer.status, answer.read().decode()


def path_of(page):
    """Return the path of the page's address."""
    return '/' + page.address.rpartition('/')[2]


@pytest.mark.parametrize('host', ['localhost', 'LOCALHOST:8080', '127.0.0.1:9000', '[::1]:9000',
                                  '192.168.1.7:8080', 'robots.example', 'Robots.Example:443'])
def test_the_address_opens_the_page(page, host):
    """Serve the page under its own names and addresses, through a tunnel or a proxy, too."""
    for path in (path_of(page), path_of(page) + '/', path_of(page) + '?websocket=x'):
        status, text = asked(page, path, Host=host)
        assert status == 200 and '<title>Viser' in text


@pytest.mark.parametrize('host', ['evil.example', 'localhost.evil.example', 'evil.example:8080',
                                  '', '[', '127.0.0.1.evil.example', 'xlocalhost', '2130706433',
                                  '127.1', 'robots.example.evil'])
def test_a_name_of_another_site_does_not(page, host):
    """Refuse names that may have been made to lead here, also with the right address."""
    assert asked(page, path_of(page), Host=host) == (
        403, 'view: this page is not served under this name; --allow-host NAME allows one\n')


@pytest.mark.parametrize('path', ['/', '/index.html', '/favicon.ico', '//', '/..', '/?token=x',
                                  '/' + 'A' * 22, '/%00', '/%C3%A4'])
def test_without_the_secret_there_is_no_page(page, path):
    """Say what to open."""
    status, text = asked(page, path)
    assert status == 403 and 'open the whole address' in text
    assert path_of(page)[1:] not in text


@pytest.mark.parametrize('origin, is_let_in', [
    (None, True), ('own', True), (EVIL, False), ('null', False), ('http://localhost:1', False),
    ('http://localhost', False), ('file://', False)])
def test_only_the_page_itself_commands(page, origin, is_let_in):
    """Open the connection for commands to the page and to programs, and to no other site."""
    site = page.address.rpartition('/')[0]
    socket_address = page.address.replace('http:', 'ws:')
    given = {'subprotocols': [f'viser-v{viser.__version__}'],
             'origin': site if origin == 'own' else origin}
    for address, is_right in ((socket_address, is_let_in), (site.replace('http:', 'ws:'), False),
                              (socket_address[:-1], False)):
        if is_right:
            connect(address, **given).close()
            continue
        with pytest.raises(InvalidStatus) as refused:
            connect(address, **given)
        assert refused.value.response.status_code == 403


def test_each_run_has_a_secret_of_its_own():
    """Let nobody in with an address of yesterday."""
    guards = [Guard('localhost') for _ in range(5)]
    assert len({guard.token for guard in guards}) == 5
    assert all(len(guard.token) >= 22 for guard in guards)
    old, new = guards[:2]
    assert new.refusal(f'/{old.token}', ['localhost'], [])
    assert not new.refusal(f'/{new.token}', ['localhost'], [])
    assert new.refusal(f'/{new.token}', ['localhost', 'localhost'], [])
    assert new.refusal(f'/{new.token}', [], [])


@pytest.mark.parametrize('host, shown', [
    ('localhost', 'localhost'), ('0.0.0.0', socket.gethostname()), ('::', socket.gethostname()),
    ('192.0.2.1', '192.0.2.1'), ('::1', '[::1]')])
def test_the_address_names_the_machine(host, shown):
    """Print an address that a browser can open, and that is let in."""
    guard = Guard(host)
    address = guard.address(8080)
    assert address == f'http://{shown}:8080/{guard.token}'
    assert not guard.refusal(f'/{guard.token}', [f'{shown}:8080'], [f'http://{shown}:8080'])


def test_a_server_that_cannot_be_guarded_is_not_started(monkeypatch):
    """Stop a server of some other viser that opens its port in another way."""
    stopped = []
    other = SimpleNamespace(__version__='9.0', ViserServer=lambda **_: SimpleNamespace(
        stop=lambda: stopped.append(True)))
    monkeypatch.setattr('procphys_ros.view.page.load_viser', lambda: other)
    with pytest.raises(ViewError, match=r'viser 9\.0'):
        Page(Still(), port=free_port())
    assert stopped


def test_the_option_names_further_hosts(monkeypatch):
    """Take several names from the command line."""
    served = []
    monkeypatch.setattr(view, '_played', lambda said: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(view, '_serve', lambda source, said, title: served.append(said.allow_host))
    assert view.main(['demo', '--allow-host', 'a.example', '--allow-host', 'b.example']) == 0
    assert served == [['a.example', 'b.example']]
