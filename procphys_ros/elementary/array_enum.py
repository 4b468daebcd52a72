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

"""Enumerations whose members stand in arrays."""

from enum import IntEnum

import numpy as np


class ArrayEnum(IntEnum):
    """Whole numbers with names; arrays are compared with them as soon as with plain ones."""

    # Numpy looks for an override of this in the type of each operand. Where there is none, the
    # search through an enumeration takes longer than the comparison of a few hundred numbers.
    __array_ufunc__ = np.ndarray.__array_ufunc__
