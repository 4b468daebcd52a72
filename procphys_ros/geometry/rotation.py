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

"""Vectorised rotations: unit quaternions as xyzw (geometry_msgs order), shape (..., 4)."""

import numpy as np

from procphys_ros.elementary import cos, sin
from procphys_ros.geometry.linear import norm

IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])
ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])  # pose of a frame in itself


def _components(vectors: np.ndarray) -> tuple[np.ndarray, ...]:
    """Split the last axis; `np.moveaxis` and `np.cross` take longer than the arithmetic."""
    vectors = np.asarray(vectors, float)
    return tuple(vectors[..., i] for i in range(vectors.shape[-1]))


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """
    Compose rotations: the result rotates by b first, then by a.

    :param a: (..., 4) unit quaternions.
    :param b: (..., 4) unit quaternions, broadcast against a.
    """
    ax, ay, az, aw = _components(a)
    bx, by, bz, bw = _components(b)
    return np.stack([
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ], axis=-1)


def conjugate(q: np.ndarray) -> np.ndarray:
    """Invert unit quaternions, (..., 4)."""
    return np.asarray(q, float) * np.array([-1.0, -1.0, -1.0, 1.0])


def rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """
    Rotate vectors by unit quaternions.

    :param q: (..., 4) unit quaternions.
    :param v: (..., 3) vectors, broadcast against q.
    """
    x, y, z, w = _components(q)
    a, b, c = _components(v)
    d, e, f = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    out = np.empty((*np.shape(d), 3))
    out[..., 0] = a + w * d + (y * f - z * e)
    out[..., 1] = b + w * e + (z * d - x * f)
    out[..., 2] = c + w * f + (x * e - y * d)
    return out


def to_matrix(q: np.ndarray) -> np.ndarray:
    """Convert unit quaternions (..., 4) to rotation matrices (..., 3, 3)."""
    x, y, z, w = _components(q)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
        2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
        2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
    ]
    return np.stack(rows, axis=-1).reshape(x.shape + (3, 3))


def from_matrix(m: np.ndarray) -> np.ndarray:
    """
    Convert rotation matrices (..., 3, 3) to unit quaternions (..., 4).

    The branch with the largest squared component is taken, so no case loses precision
    (Shepperd 1978, J. Guidance and Control 1(3)).
    """
    m = np.asarray(m, float)
    flat = m.reshape(-1, 3, 3)
    trace = np.trace(flat, axis1=1, axis2=2)
    choice = np.argmax(np.column_stack([
        flat[:, 0, 0], flat[:, 1, 1], flat[:, 2, 2], trace]), axis=1)
    q = np.empty((len(flat), 4))
    for i, (j, k) in enumerate([(1, 2), (2, 0), (0, 1)]):
        row = choice == i
        part = flat[row]
        q[row, i] = 1 - trace[row] + 2 * part[:, i, i]
        q[row, j] = part[:, j, i] + part[:, i, j]
        q[row, k] = part[:, k, i] + part[:, i, k]
        q[row, 3] = part[:, k, j] - part[:, j, k]
    row = choice == 3
    part = flat[row]
    q[row, 0] = part[:, 2, 1] - part[:, 1, 2]
    q[row, 1] = part[:, 0, 2] - part[:, 2, 0]
    q[row, 2] = part[:, 1, 0] - part[:, 0, 1]
    q[row, 3] = 1 + trace[row]
    q /= norm(q, axis=1, keepdims=True)
    return q.reshape(m.shape[:-2] + (4,))


def from_axis_angle(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """
    Make quaternions of rotations by an angle about an axis, (..., 4).

    :param axis: (..., 3) unit vectors.
    :param angle: (...) angles [rad].
    """
    half = 0.5 * np.asarray(angle, float)[..., None]
    return np.concatenate([np.asarray(axis, float) * sin(half), cos(half)], axis=-1)


def from_yaw(yaw: float) -> np.ndarray:
    """Make the quaternion (4,) of a rotation about the vertical [rad]."""
    return np.array([0.0, 0.0, sin(0.5 * yaw), cos(0.5 * yaw)])


def compose(outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """
    Compose poses: express `inner`, given in the frame `outer`, in the parent frame of `outer`.

    :param outer: (..., 7) poses x y z qx qy qz qw.
    :param inner: (..., 7) poses in the frame of outer.
    """
    outer = np.asarray(outer, float)
    inner = np.asarray(inner, float)
    position = outer[..., :3] + rotate(outer[..., 3:], inner[..., :3])
    return np.concatenate([position, multiply(outer[..., 3:], inner[..., 3:])], axis=-1)


def relative(frame: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Express poses (..., 7) in the given frame (..., 7): the inverse of `compose`."""
    frame = np.asarray(frame, float)
    pose = np.asarray(pose, float)
    back = conjugate(frame[..., 3:])
    position = rotate(back, pose[..., :3] - frame[..., :3])
    return np.concatenate([position, multiply(back, pose[..., 3:])], axis=-1)
