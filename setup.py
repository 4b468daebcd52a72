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


from glob import glob
from pathlib import Path
import re

from setuptools import find_packages, setup

PACKAGE = 'procphys_ros'
ROOT = Path(__file__).resolve().parent  # colcon --symlink-install links to this file
_SOURCE = (ROOT / PACKAGE / '__init__.py').read_text(encoding='utf-8')
VERSION = re.search(r"__version__ = '([^']+)'", _SOURCE)[1]

setup(
    name=PACKAGE,
    version=VERSION,
    description='Procedural trees and buildings that carry their physics, on ROS 2 topics',
    long_description=(ROOT / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    maintainer='The procphys_ros authors',
    maintainer_email='procphys_ros@example.org',
    license='Apache-2.0',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', sorted(glob('config/*.*'))),
        (f'share/{PACKAGE}/config/meshes', sorted(glob('config/meshes/*'))),
        (f'share/{PACKAGE}/launch', sorted(glob('launch/*'))),
        (f'share/{PACKAGE}/grammars', sorted(glob('grammars/*'))),
        # pip ignores setup.cfg's install_scripts; `ros2 run` looks here in both installs.
        (f'lib/{PACKAGE}', sorted(glob('scripts/*'))),
    ],
    package_data={PACKAGE: ['py.typed'],  # its type hints are for its users, too
                  f'{PACKAGE}.render': ['shaders/*']},
    zip_safe=False,
    python_requires='>=3.11',
    # numba 0.58 is that of Ubuntu 24.04; the others may be as old as they are there.
    # PyBullet has wheels up to Python 3.11: later ones take the engine that needs no compiler.
    install_requires=['setuptools', 'numpy', 'numba>=0.58', 'scipy', 'lark', 'pyyaml',
                      'pybullet; python_version < "3.12"'],
    extras_require={
        # On a ROS machine these come with ROS itself, so they are no hard requirements.
        'wheels': ['ros-rclpy[fastrtps]~=7.1.6', 'ros-jazzy-common-interfaces'],
        'render': ['moderngl>=5.10', 'pillow', 'av'],  # pictures and films
        'bullet': ['pybullet'],  # the engine to compare with
        'usd': ['usd-core'],
        'record': ['mcap>=1.6'],
        'batch': ['pyarrow', 'distributed'],  # Parquet tables, clusters of machines
        'maps': ['shapely>=2.0', 'osmium'],  # houses of GeoJSON, OpenStreetMap and CityJSON
        'mesh': ['trimesh'],  # intruders in the shape of a mesh
        'view': ['viser>=1.1', 'trimesh', 'pillow'],
        'docs': ['sphinx', 'myst-parser', 'sphinx-rtd-theme', 'viser>=1.1', 'pillow'],
        'report': ['matplotlib', 'pytest', 'pytest-timeout', 'pytest-xdist'],
        'test': ['pytest', 'pytest-timeout', 'pytest-xdist', 'ruff', 'mypy', 'types-PyYAML',
                 # the wheels of ament's linters do not name what they need
                 'ros-ament-flake8', 'flake8', 'flake8-import-order',
                 'ros-ament-pep257', 'pydocstyle',
                 # readers of what is exported and recorded, none of them ours
                 'usd-core', 'mujoco', 'yourdfpy', 'trimesh', 'pygltflib', 'pillow',
                 'viser>=1.1', 'playwright',
                 'sphinx', 'myst-parser', 'sphinx-rtd-theme',  # the site of the documentation
                 'matplotlib', 'shapely>=2.0', 'osmium',
                 'mcap>=1.6', 'mcap-ros2-support', 'rosbags', 'pyarrow', 'distributed'],
    },
    entry_points={
        'console_scripts': [
            'sim = procphys_ros.ros.sim:main',
            'managed_sim = procphys_ros.ros.managed_sim:main',
            'command = procphys_ros.terminal.program:command',
            'render = procphys_ros.terminal.program:render',
            'export = procphys_ros.terminal.program:export',
            'batch = procphys_ros.terminal.program:batch',
            'record = procphys_ros.terminal.program:record',
            'replay = procphys_ros.terminal.program:replay',
            'view = procphys_ros.terminal.program:view',
            'examples = procphys_ros.terminal.program:examples',
            'map = procphys_ros.terminal.program:map',
        ],
    },
)
