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


"""Backend: an OpenGL context without a display, and the error when there is none."""

from typing import Any

_NO_MODERNGL = 'drawing needs ModernGL: pip install moderngl'
_NO_OPENGL = ('drawing without a display needs OpenGL software rendering: '
              'apt-get install libegl1 libgl1 libgl1-mesa-dri')
# Names of the libraries without their development packages.
_LIBRARIES: dict[str, Any] = {'backend': 'egl', 'libgl': 'libGL.so.1', 'libegl': 'libEGL.so.1'}


class RenderUnavailableError(ImportError):
    """A missing dependency of drawing; the message says what to install."""


def open_context() -> Any:
    """
    Open an OpenGL 4.0 context that draws off-screen, a `moderngl.Context`.

    :raises RenderUnavailableError: if ModernGL is not installed, or no OpenGL can be opened.
    """
    try:
        import moderngl
    except ImportError as error:
        raise RenderUnavailableError(f'{_NO_MODERNGL} ({error})') from error
    try:
        return moderngl.create_context(400, True, **_LIBRARIES)
    except Exception as error:  # of any kind that the binding to EGL raises
        raise RenderUnavailableError(f'{_NO_OPENGL} ({error})') from error
