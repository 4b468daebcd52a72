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

"""Parser of a command's words whose complaints are one line."""

import argparse
from typing import NoReturn


class OneLineParser(argparse.ArgumentParser):
    """Parser that answers a mistake with one line and exit code 1, without its usage."""

    def error(self, message: str) -> NoReturn:
        """Print a complaint and exit."""
        self.exit(1, f'{self.prog}: {message}\n')
