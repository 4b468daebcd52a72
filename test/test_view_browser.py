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


"""The page of a running node in a real browser, without a display."""

from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
import shutil
import signal
from threading import Thread
from time import sleep

from node_process import NodeProcess, PATIENCE, SAPLING, wait_until
from PIL import Image
import pytest
import rclpy
from view_scene import free_port

from procphys_ros.ros.followed_node import FollowedNode
from procphys_ros.view.page import Page

sync_playwright = pytest.importorskip('playwright.sync_api').sync_playwright
viser = pytest.importorskip('viser')
CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')
if CHROMIUM is None:
    pytest.skip('no Chromium: apt-get install chromium', allow_module_level=True)
SOFTWARE = ('--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
            '--ignore-gpu-blocklist')
SIZE = {'width': 560, 'height': 420}
SCENERY = {'x': 0, 'y': 200, 'width': 220, 'height': 220}  # [px] free of the panel and of notices
SCENE = {'scene': {'objects': ['sapling']},
         'sapling': {'grammar_text': SAPLING, 'count': 3, 'layout': 'row', 'spacing': 1.0},
         'wind': {'velocity': [9.0, 3.0, 0.0]}}
SLOW = 1e3 * PATIENCE  # [ms]


@pytest.fixture(scope='module')
def node(tmp_path_factory):
    """Run a node in which trees sway."""
    process = NodeProcess(tmp_path_factory.mktemp('node'), SCENE)
    process.wait_for_banner()
    yield process
    process.kill()


@pytest.fixture(scope='module')
def followed(node):
    """Follow the node."""
    rclpy.init()
    made = FollowedNode('sim', PATIENCE)
    made.start()
    yield made
    made.close()
    rclpy.try_shutdown()


@pytest.fixture(scope='module')
def page(followed):
    """Serve its page."""
    made = Page(followed, port=free_port())
    made.start()
    yield made
    made.close()


@pytest.fixture(scope='module')
def requests():
    """Collect what the browser asks for."""
    return []


@pytest.fixture(scope='module')
def browser(page, requests):
    """Open the page in a browser."""
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=list(SOFTWARE))
        tab = chromium.new_page(viewport=SIZE)
        tab.set_default_timeout(SLOW)
        tab.on('request', lambda request: requests.append(request.url))
        tab.goto(page.address)
        tab.get_by_text(', running, ').wait_for()  # WebGL may say that it is running, too
        yield tab
        chromium.close()


def picture(browser):
    """Take a picture of the scene beside the panel."""
    return browser.screenshot(clip=SCENERY, timeout=SLOW)


def number_beside(browser, label):
    """Find the field for the number of a slider."""
    return browser.locator(
        f'xpath=//label[normalize-space(.)="{label}"]/following::input[@type="text"][1]')


def test_the_page_moves_while_the_wind_blows(browser):
    """See another picture after a while."""
    first = picture(browser)
    wait_until(lambda: picture(browser) != first, 'another picture')


def test_the_page_stands_still_while_paused(browser, followed):
    """Tick the box, and see the same picture again and again."""
    browser.get_by_label('pause').click(force=True)  # the page may set the box anew
    wait_until(lambda: followed.status().paused, 'the pause')
    browser.get_by_text('paused').first.wait_for()
    wait_until(lambda: picture(browser) == picture(browser), 'the last picture')
    last = picture(browser)
    sleep(1.0)
    assert picture(browser) == last


def test_a_slider_reaches_the_node(browser, followed):
    """Type a wind speed, and find the node's wind to be that."""
    field = number_beside(browser, 'speed [m/s]')
    field.fill('20')
    field.press('Enter')
    wait_until(lambda: sum(v ** 2 for v in followed.status().wind) ** 0.5 > 19.5, 'the wind')


def choose(browser, label, option):
    """Choose from a list."""
    browser.locator(f'xpath=//label[normalize-space(.)="{label}"]/following::input[1]'
                    ).first.click()
    browser.get_by_role('option', name=option, exact=True).click()


def test_a_first_click_only_looks(browser, followed):
    """Click the ground, and read what it is."""
    before = followed.answer()
    browser.mouse.click(110, 400)
    wait_until(lambda: '>ground</' in browser.content(), 'what was clicked')
    assert followed.answer() == before


def test_a_click_with_a_tool_reaches_the_node(browser, followed):
    """Take the charges, click the ground, and hear of a charge."""
    choose(browser, 'tool', 'set off a charge')
    browser.get_by_text('A click sets off 10 kg TNT there.').wait_for()
    browser.mouse.click(110, 400)
    wait_until(lambda: 'kg TNT' in followed.answer(), 'the charge')


def test_what_is_seen_can_be_saved(browser):
    """Download a picture as large as the view, without the panel."""
    browser.get_by_text('View', exact=True).click()
    with browser.expect_download() as coming:
        browser.get_by_role('button', name='save picture', include_hidden=True
                            ).dispatch_event('click')
    with Image.open(coming.value.path()) as saved:
        assert saved.size == (SIZE['width'], SIZE['height'])
        assert len(saved.convert('RGB').resize((56, 42)).getcolors(9999)) > 20


def test_nothing_is_asked_of_other_machines(browser, page, requests):
    """Load everything from where the page is."""
    assert requests
    site = page.address.rpartition('/')[0]
    assert all(url.startswith((page.address, f'blob:{site}/', 'data:'))
               for url in requests), requests


@pytest.fixture
def other_site():
    """Serve an empty page on another port, which makes it another site."""
    class Empty(BaseHTTPRequestHandler):

        def do_GET(self):
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_):
            pass
    with ThreadingHTTPServer(('127.0.0.1', 0), Empty) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f'http://127.0.0.1:{server.server_port}/'
        server.shutdown()


def test_another_site_does_not_reach_the_node(browser, page, other_site):
    """Refuse connections that another site opens, with the address of the page and without."""
    tab = browser.context.browser.new_page()
    tab.goto(other_site)
    for name in (page.address, page.address.rpartition('/')[0]):
        outcome = tab.evaluate("""([name, protocol]) => new Promise(done => {
            const socket = new WebSocket(name, protocol);
            socket.onopen = () => done('open');
            socket.onerror = () => done('refused');
        })""", [name.replace('http:', 'ws:'), f'viser-v{viser.__version__}'])
        assert outcome == 'refused', name
    tab.close()


def test_a_dead_node_is_shown(browser, node):
    """Kill the node, and read that on the page."""
    node.finish(signal.SIGKILL)
    browser.get_by_text('/sim does not answer').wait_for()
