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

"""Progress: reports on long work to a listener of its thread."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, Protocol


class Listener(Protocol):
    """Receives the stages of a thread's work, which may be nested."""

    def begin(self, name: str, detail: str) -> None: ...

    def end(self) -> None: ...


_listener: ContextVar[Listener | None] = ContextVar('listener', default=None)


@contextmanager
def reported_to(listener: Listener) -> Iterator[None]:
    """Report all stages of this thread to a listener until the end of a block."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def stage(name: str, detail: str = '') -> Iterator[None]:
    """
    Report the work of a block.

    :param name: of the work, such as 'growing objects'.
    :param detail: its progress, such as 'oak_3, 4 of 250'.
    """
    begin(name, detail)
    try:
        yield
    finally:
        end()


def staged(name: str) -> Callable[[Callable], Callable]:
    """Make a decorator that reports the work of a function; else as `stage`."""
    def decorate(function: Callable) -> Callable:
        @wraps(function)
        def told(*arguments: Any, **keywords: Any) -> Any:
            with stage(name):
                return function(*arguments, **keywords)
        return told
    return decorate


def begin(name: str, detail: str = '') -> None:
    """Report the beginning of work that is not a block; `end` must follow."""
    listener = _listener.get()
    if listener is not None:
        listener.begin(name, detail)


def end() -> None:
    """Report the end of the work begun last."""
    listener = _listener.get()
    if listener is not None:
        listener.end()
