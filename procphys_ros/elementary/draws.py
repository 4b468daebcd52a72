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
Random numbers from uniform ones, which numpy draws with the same bits everywhere.

Its own normal and exponential numbers pass through libm.
"""

import math

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.elementary import functions
from procphys_ros.elementary.arrays import log, power


@kernel
def _pair(first, second, out):
    """Write two independent normal numbers for each two uniform ones (Box & Muller 1958)."""
    for i in range(len(first)):
        size = math.sqrt(-2.0 * functions.log(1.0 - first[i]))
        c, s = functions.cos_sin(2.0 * math.pi * second[i])
        out[2 * i] = size * c
        if 2 * i + 1 < len(out):
            out[2 * i + 1] = size * s


def standard_normal(rng: np.random.Generator, shape: int | tuple[int, ...] = ()) -> np.ndarray:
    """Draw normal numbers of mean 0 and standard deviation 1, of a shape."""
    out = np.empty(shape)
    half = -(-out.size // 2)
    _pair(rng.random(half), rng.random(half), out.reshape(-1))
    return out


def normal_of(uniform: np.ndarray) -> np.ndarray:
    """
    Convert uniform numbers to as many normal ones, pair by pair.

    A longer array begins with the same numbers, which those of `standard_normal` do not.

    :param uniform: from 0 to 1, (..., K), K even.
    """
    pairs = uniform.reshape(-1, 2).T.copy()
    out = np.empty(uniform.shape)
    _pair(pairs[0], pairs[1], out.reshape(-1))
    return out


def weibull(rng: np.random.Generator, exponent: float, count: int) -> np.ndarray:
    """Draw numbers of the Weibull distribution of scale 1."""
    return power(-log(1.0 - rng.random(count)), 1.0 / exponent)
