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


"""Backend: PyVista, without which nothing is drawn, and what it says when it is missing."""

import os
from types import ModuleType

_NO_PYVISTA = 'drawing needs PyVista: pip install pyvista'
_NO_OPENGL = ('drawing without a display needs OpenGL software rendering: '
              'apt-get install libegl1 libgl1 libgl1-mesa-dri')


class RenderUnavailableError(ImportError):
    """Something that drawing needs is not installed; the message says what to install."""


def load_pyvista() -> ModuleType:
    """
    Import PyVista for drawing off-screen.

    :raises RenderUnavailableError: when PyVista is not installed, or no OpenGL can be opened.
    """
    try:
        import pyvista
    except ImportError as error:
        raise RenderUnavailableError(f'{_NO_PYVISTA} ({error})') from error
    if not os.environ.get('DISPLAY') and not _has_headless_opengl():
        raise RenderUnavailableError(_NO_OPENGL)
    pyvista.vtk_verbosity('error')  # else VTK warns that there is no display, which is the point
    return pyvista


def _has_headless_opengl() -> bool:
    """Tell whether VTK will find a library to draw with; it ends the process if it does not."""
    from ctypes import CDLL

    for library in ('libEGL.so.1', 'libOSMesa.so.8', 'libOSMesa.so'):
        try:
            CDLL(library)
        except OSError:
            continue
        return True
    return False
