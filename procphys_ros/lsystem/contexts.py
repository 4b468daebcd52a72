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


"""Contexts: find the modules whose neighbours along the branches match a pattern."""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.lsystem.modules import POP, PUSH

OPEN, CLOSE, EXACT_CLOSE = -1, -2, -3  # brackets in a right context; keys are not negative


@kernel
def follow_tree(key: np.ndarray, ignored: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Link each module of a string to its neighbours on the tree.

    :param key: of each module, (M,).
    :param ignored: mask of the keys that contexts skip, (K,) bool.
    :returns: for each place the module before it on the way to the root (-1: none), (M,); the
        next place that is not ignored, (M + 1,); the closing bracket of each opening one, (M,).
    """
    count = len(key)
    before = np.empty(count, np.int32)
    closing = np.full(count, -1, np.int32)
    onward = np.empty(count + 1, np.int32)
    axis = np.empty(count + 1, np.int32)
    opened = np.empty(count + 1, np.int32)
    depth = 0
    last = -1
    for i in range(count):
        before[i] = last
        if key[i] == PUSH:
            axis[depth] = last
            opened[depth] = i
            depth += 1
        elif key[i] == POP:
            depth -= 1
            last = axis[depth]
            before[i] = last
            closing[opened[depth]] = i
        elif not ignored[key[i]]:
            last = i
    onward[count] = count
    for i in range(count - 1, -1, -1):
        onward[i] = onward[i + 1] if ignored[key[i]] else i
    return before, onward, closing


@kernel
def match_left(rows: np.ndarray, key: np.ndarray, before: np.ndarray,
               pattern: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Match left contexts: the path towards the root.

    :param rows: candidates, (N,).
    :param key: of each module, (M,).
    :param before: from `follow_tree`.
    :param pattern: keys, nearest first, (P,).
    :returns: mask of the rows that match, (N,) bool, and the modules matched, (N, P).
    """
    good = np.ones(len(rows), np.bool_)
    met = np.empty((len(rows), len(pattern)), np.int32)
    for n in range(len(rows)):
        at = before[rows[n]]
        for p in range(len(pattern)):
            if at < 0 or key[at] != pattern[p]:
                good[n] = False
                break
            met[n, p] = at
            at = before[at]
    return good, met


@subroutine
def _past_branches(at, key, onward, closing):
    while at < len(key) and key[at] == PUSH:
        at = onward[closing[at] + 1]
    return at


@subroutine
def _match_one(at, key, onward, closing, pattern, met, places, ends):
    """Match one right context; a named branch may match any branch at that place."""
    depth = 0
    p = 0
    at = onward[at]
    while p < len(pattern):
        code = pattern[p]
        fits = True
        if code == OPEN:
            if at < len(key) and key[at] == PUSH:
                places[depth] = p
                ends[depth] = closing[at]
                depth += 1
                at = onward[at + 1]
            else:
                fits = False
        elif code in (CLOSE, EXACT_CLOSE):
            if code == EXACT_CLOSE:
                at = _past_branches(at, key, onward, closing)
            if code == CLOSE or at == ends[depth - 1]:
                depth -= 1
                at = onward[ends[depth] + 1]
            else:
                fits = False
        else:
            at = _past_branches(at, key, onward, closing)
            if at < len(key) and key[at] == code:
                met[p] = at
                at = onward[at + 1]
            else:
                fits = False
        if fits:
            p += 1
        elif depth == 0:
            return False
        else:  # this branch does not fit: look at the next one beside it
            depth -= 1
            p = places[depth]
            at = onward[ends[depth] + 1]
    return True


@kernel
def match_right(rows: np.ndarray, key: np.ndarray, onward: np.ndarray, closing: np.ndarray,
                pattern: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Match right contexts: the tree above, skipping branches that the pattern does not name.

    :param rows: candidates, (N,).
    :param key: of each module, (M,).
    :param onward: from `follow_tree`.
    :param closing: from `follow_tree`.
    :param pattern: keys and bracket codes, (P,).
    :returns: mask of the rows that match, (N,) bool, and the modules matched, (N, P).
    """
    good = np.empty(len(rows), np.bool_)
    met = np.full((len(rows), len(pattern)), -1, np.int32)
    places = np.empty(len(pattern), np.int64)
    ends = np.empty(len(pattern), np.int64)
    for n in range(len(rows)):
        good[n] = _match_one(rows[n] + 1, key, onward, closing, pattern, met[n], places, ends)
    return good, met
