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


"""Guard: decides which requests of browsers reach a page."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from hmac import compare_digest
from http import HTTPStatus
from ipaddress import ip_address
import secrets
import socket
from threading import Lock
from typing import Any
from urllib.parse import urlsplit

_EVERYWHERE = ('', '0.0.0.0', '::')
_patching = Lock()


class Guard:
    """
    Admit requests for the page's address, which holds a secret that other sites do not know.

    :param host: address that the page is served on.
    :param names: other host names of the page, besides that address and localhost.
    :ivar name: of the host, in addresses.
    :ivar token: the secret, new in each run.
    :ivar watches: whether a server uses it.
    """

    def __init__(self, host: str, names: Iterable[str] = ()):
        self.name = socket.gethostname() if host in _EVERYWHERE else host
        self.token = secrets.token_urlsafe(16)
        self.watches = False
        self._names = {name.lower() for name in ('localhost', self.name, *names)}

    def address(self, port: int) -> str:
        """Return the address of the page at a TCP port."""
        name = f'[{self.name}]' if ':' in self.name else self.name
        return f'http://{name}:{port}/{self.token}'

    def refusal(self, path: str, hosts: Iterable[str], origins: Iterable[str]) -> str:
        """
        Return why a request is refused; '' = it is not.

        :param path: requested path.
        :param hosts: values of the header Host.
        :param origins: values of the header Origin; programs other than browsers send none.
        """
        host = ' '.join(hosts).lower()
        if not self._is_known(host):
            return 'view: this page is not served under this name; --allow-host NAME allows one\n'
        if any(origin.lower() not in (f'http://{host}', f'https://{host}') for origin in origins):
            return 'view: pages of other sites have no access to this page\n'
        if not compare_digest(_split(path)[0].encode(errors='replace'), self.token.encode()):
            return 'view: open the whole address that was printed when the page was started\n'
        return ''

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Guard the server started in this context; viser itself admits everybody."""
        import websockets.asyncio.server as library  # installed with viser

        def serve(*given: Any, process_request: Callable[[Any, Any], Any], **options: Any) -> Any:
            self.watches = True
            return original(*given, process_request=self._before(process_request), **options)
        with _patching:
            original = library.serve
            library.serve = serve  # type: ignore
            try:
                yield
            finally:
                library.serve = original  # type: ignore

    def _before(self, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        def process_request(connection: Any, request: Any) -> Any:
            headers = request.headers
            refusal = self.refusal(request.path, headers.get_all('Host'),
                                   headers.get_all('Origin'))
            if refusal:
                return connection.respond(HTTPStatus.FORBIDDEN, refusal)
            return answer(connection, replace(request, path=_split(request.path)[1]))
        return process_request

    def _is_known(self, host: str) -> bool:
        """Return whether a host name is known, or an address, which no other site controls."""
        try:
            name = urlsplit(f'//{host}').hostname or ''
            if name not in self._names:
                ip_address(name)
        except ValueError:
            return False
        return True


def _split(path: str) -> tuple[str, str]:
    """Split a path into its first folder and the rest."""
    first, _, rest = path.partition('?')[0].removeprefix('/').partition('/')
    return first, f'/{rest}'
