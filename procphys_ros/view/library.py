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


"""Import of the optional package viser, with an error that says how to install it."""

from types import ModuleType

from procphys_ros.errors import ProcPhysError


class ViewError(ProcPhysError):
    """A page that cannot be served: missing package, or port in use."""


def load_viser() -> ModuleType:
    """
    Import viser.

    :raises ViewError: if it is not installed.
    """
    try:
        import viser
    except ImportError as error:
        raise ViewError(f'the page needs viser: pip install procphys_ros[view] ({error})') \
            from error
    return viser
