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


"""Command line of a running simulation: syntax, help and output, without ROS."""

from procphys_ros.command_line.completion import answers, script
from procphys_ros.command_line.description import Description
from procphys_ros.command_line.words import read

__all__ = ['answers', 'Description', 'read', 'script']
