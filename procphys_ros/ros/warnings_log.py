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


"""Warnings of the library, of grammars and scenes, in the log of ROS."""

import logging
from typing import Any
import warnings

from rclpy.impl.rcutils_logger import RcutilsLogger

from procphys_ros.errors import GrammarWarning


class _Forward(logging.Handler):
    """Hands records of Python's logging to a logger of ROS."""

    def __init__(self, logger: RcutilsLogger):
        super().__init__(logging.WARNING)
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        self._logger.warning(record.getMessage())


def forward_warnings(logger: RcutilsLogger) -> None:
    """
    Log what the library warns of, a line each, from now on; other warnings stay as they are.

    :param logger: of the node.
    """
    logging.getLogger('procphys_ros').addHandler(_Forward(logger))
    others = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        if issubclass(category, GrammarWarning):
            logger.warning(str(message))
        else:
            others(message, category, *place, **more)

    warnings.showwarning = show
