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

"""Import of the optional package mcap, with an error that says how to install it."""

from importlib import import_module
from types import SimpleNamespace

from procphys_ros.errors import RecordingError


def load_mcap() -> SimpleNamespace:
    """
    Import the used names of the package mcap.

    :returns: its Writer, CompressionType and make_reader.
    :raises RecordingError: if it is not installed.
    """
    try:
        writer, reader = (import_module(f'mcap.{name}') for name in ('writer', 'reader'))
    except ImportError as error:
        raise RecordingError('recordings need the package mcap: pip install mcap') from error
    return SimpleNamespace(Writer=writer.Writer, CompressionType=writer.CompressionType,
                           make_reader=reader.make_reader)
