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


"""Show: a page for a simulation of this process, in one call."""

from collections.abc import Iterable

from procphys_ros.simulation import Simulation
from procphys_ros.view.page import HOST, Page, PORT
from procphys_ros.view.player import Player


class PlayerPage(Page):
    """A page that owns its source and closes it."""

    def close(self) -> None:
        """Stop the server, and wait for the present step."""
        super().close()
        self._source.close()


def show(simulation: Simulation, host: str = HOST, port: int = PORT,
         names: Iterable[str] = ()) -> Page:
    """
    Play a simulation on a page; in a notebook the page is shown below the cell.

    The page steps the simulation in a separate thread until `Page.close`; no other code may.

    :param simulation: to be played.
    :param host: address that the page is served on.
    :param port: TCP port.
    :param names: other host names of the page, besides `host` and localhost.
    :raises ViewError: if viser is missing, or the port is in use.
    """
    player = Player(simulation)
    page = PlayerPage(player, host, port, names=names)
    player.start()
    page.start()
    return page
