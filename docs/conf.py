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


"""Settings of the documentation site: `make docs`, or `sphinx-build -W docs build/docs`."""

from pathlib import Path
import re
import sys

_ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(_ROOT))

from procphys_ros import __version__  # noqa: E402

project = 'procphys_ros'
author = copyright = 'The procphys_ros authors'  # noqa: A001
release = __version__

extensions = ['myst_parser', 'sphinx.ext.autodoc']
exclude_patterns = ['README.md']  # the index for readers of the repository
myst_heading_anchors = 3  # links to headings, as on GitHub

autodoc_member_order = 'bysource'
autodoc_default_options = {'members': True}

html_theme = 'sphinx_rtd_theme'
html_title = f'procphys_ros {release}'
html_show_sourcelink = False

# What lies outside of docs/ and has a page of its own on the site.
_PAGES = {'CONTRIBUTING.md': 'repository/contributing.md',
          'CHANGELOG.rst': 'repository/changes.rst',
          'QUALITY_DECLARATION.md': 'repository/quality.md',
          'docs/decisions/': 'decisions/README.md', 'docs/README.md': 'index.md'}


def setup(app) -> None:
    """Compose the front page when Sphinx reads it."""
    app.connect('source-read', _compose_front_page)


def _compose_front_page(app, page: str, source: list[str]) -> None:
    """Put the repository's README on the front page, and the index of docs/ into the sidebar."""
    if page == 'index':
        readme = (_ROOT / 'README.md').read_text('utf-8')
        index = (_ROOT / 'docs' / 'README.md').read_text('utf-8')
        source[0] = re.sub(r'\]\(([^)\s]+)', _address, readme) + ''.join(
            _toctree(caption, re.findall(r'\]\(([^)\s]+)\)', items))
            for caption, items in re.findall(r'^\*\*(.+)\*\*\n((?:[* ] .*\n)+)', index, re.M))


def _address(link: re.Match) -> str:
    """Turn a link that starts at the repository's root into one that starts at docs/."""
    target = link[1]
    if target.startswith(('http', '#')):
        return link[0]
    return f']({_PAGES.get(target) or f"../{target}".replace("../docs/", "")}'


def _toctree(caption: str, links: list[str]) -> str:
    """Write the directive that lists pages in the sidebar."""
    pages = [f'{link}*' if link.endswith('/') else
             _PAGES.get(link.removeprefix('../'), link).rpartition('.')[0] for link in links]
    return '\n'.join(['', '```{toctree}', ':hidden:', ':glob:', f':caption: {caption}', '',
                      *pages, '```', ''])
