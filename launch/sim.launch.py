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


"""
Start the node on a scene, with a viewer or without.

ros2 launch procphys_ros sim.launch.py scene:=garden viewer:=rviz
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

_PACKAGE = 'procphys_ros'


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments, and start what they ask for."""
    return LaunchDescription([
        DeclareLaunchArgument('scene', default_value='demo', description=(
            'scene of the package, such as garden, or path of a parameter file')),
        DeclareLaunchArgument('viewer', default_value='none', choices=['none', 'rviz'],
                              description='what shows the scene'),
        DeclareLaunchArgument('name', default_value='sim', description='of the node'),
        DeclareLaunchArgument('namespace', default_value='', description='of the node'),
        OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list[Node]:
    given = {name: LaunchConfiguration(name).perform(context)
             for name in ('scene', 'viewer', 'name', 'namespace')}
    share = Path(get_package_share_directory(_PACKAGE))
    started = [Node(package=_PACKAGE, executable='sim', name=given['name'],
                    namespace=given['namespace'], output='screen',
                    parameters=[str(scene_file(given['scene'], share))])]
    if given['viewer'] == 'rviz':
        own = f'{given["namespace"].strip("/")}/{given["name"]}'.strip('/')
        topics = ('markers', 'ground', 'poses', 'breaks', 'dust', 'lidar')
        started.append(Node(package='rviz2', executable='rviz2', output='screen',
                            arguments=['-d', str(share / 'config' / 'procphys.rviz')],
                            remappings=[(f'/sim/{topic}', f'/{own}/{topic}')
                                        for topic in topics]))
    return started


def scene_file(scene: str, share: Path) -> Path:
    """
    Find the parameter file of a scene.

    :param scene: name of a scene of the package, with or without .yaml, or a path.
    :param share: share folder of the package.
    :raises FileNotFoundError: when there is none; the message names those of the package.
    """
    candidates = (Path(scene), share / 'config' / scene, share / 'config' / f'{scene}.yaml')
    for path in candidates:
        if path.is_file():
            return path
    known = ', '.join(sorted(path.stem for path in (share / 'config').glob('*.yaml')))
    raise FileNotFoundError(f'there is no scene "{scene}"; the package has {known}')
