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


"""Ground motion: recorded or synthetic accelerations of the ground, and oscillators under them."""

from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.elementary import cos, exp, sin, standard_normal

GroundRecord = tuple[tuple[float, ...], ...]  # rows of time [s], and one to three accelerations

INTERVAL = 0.005  # [s] of synthetic motions, as most records have
ACROSS = 0.85     # of the motion along the direction, by the variances of principal axes
#                   (Penzien & Watabe 1974, Earthq. Eng. Struct. Dyn. 3, 365-373), ...
VERTICAL = 2.0 / 3.0  # ... and upwards (Newmark & Hall 1982, EERI monograph 3)
_RISE, _STRONG, _FADE = 2.0 / 12.0, 4.0 / 12.0, 0.268 * 12.0  # envelope: ends of the rise and of
# the strong phase as shares of the duration, decay after it; type C of Jennings, Housner & Tsai
# (1968, Simulated earthquake motions, Caltech)
_HIGH_PASS = 0.1  # of the ground's frequency (Clough & Penzien 1975, Dynamics of structures, 26-2)
_RING = 4.0       # time constants of that filter until the ground rests


class GroundMotion(NamedTuple):
    """
    Motion of the ground over time, with accelerations that are linear between its rows.

    :ivar time: ascending, from 0 [s], (T,).
    :ivar acceleration: [m/s²], (T, 3), world.
    :ivar velocity: its integral [m/s], (T, 3).
    :ivar displacement: the integral of that [m], (T, 3).
    """

    time: np.ndarray
    acceleration: np.ndarray
    velocity: np.ndarray
    displacement: np.ndarray

    @property
    def duration(self) -> float:
        """Time after which the ground is no longer accelerated [s]."""
        return float(self.time[-1])

    def at(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return acceleration, velocity and displacement of the ground at a time, (3,) each."""
        if not 0.0 <= time < self.duration:
            end = 0 if time < 0.0 else -1
            late = max(time - self.duration, 0.0)
            return (np.zeros(3), self.velocity[end].copy(),
                    self.displacement[end] + late * self.velocity[end])
        k = int(np.searchsorted(self.time, time, side='right')) - 1
        since = time - self.time[k]
        first, last = self.acceleration[k:k + 2]
        gained = since / (self.time[k + 1] - self.time[k]) * (last - first)
        return (first + gained,
                self.velocity[k] + since * (first + 0.5 * gained),
                self.displacement[k] + since * (self.velocity[k] + since * (
                    0.5 * first + gained / 6.0)))

    def mean_acceleration(self, start: float, end: float) -> np.ndarray:
        """Return the mean acceleration between two times [m/s²], (3,)."""
        return (self.at(end)[1] - self.at(start)[1]) / (end - start)


def integrated(time: np.ndarray, acceleration: np.ndarray) -> GroundMotion:
    """
    Integrate accelerations that are linear between their rows.

    :param time: ascending [s], (T,).
    :param acceleration: [m/s²], (T, 3).
    """
    step = np.diff(time)[:, None]
    first, last = acceleration[:-1], acceleration[1:]
    gained = 0.5 * step * (first + last)
    velocity = np.vstack([np.zeros(3), np.cumsum(gained, axis=0)])
    way = step * (velocity[:-1] + step * (2.0 * first + last) / 6.0)
    return GroundMotion(time, acceleration, velocity,
                        np.vstack([np.zeros(3), np.cumsum(way, axis=0)]))


STILL = integrated(np.zeros(1), np.zeros((1, 3)))
"""The ground at rest."""


def recorded(record: GroundRecord, start: float, scale: float, direction: np.ndarray
             ) -> GroundMotion:
    """
    Return the motion of a record, which begins with its first row.

    :param record: of along the direction, to its left, and up; the latter two may be missing.
    :param start: time of the record up to which it is left out [s]; before its last row.
    :param scale: of its accelerations.
    :param direction: level unit vector, (3,).
    """
    rows = np.array(record, float)
    start = max(start, rows[0, 0])
    kept = rows[rows[:, 0] > start]
    first = [np.interp(start, rows[:, 0], column) for column in rows[:, 1:].T]
    time = np.concatenate([[0.0], kept[:, 0] - start])
    local = np.zeros((len(time), 3))
    local[:, :rows.shape[1] - 1] = scale * np.vstack([first, kept[:, 1:]])
    return integrated(time, _turned(local, direction))


def synthetic(peak: float, duration: float, frequency: float, damping: float,
              direction: np.ndarray, generator: np.random.Generator) -> GroundMotion:
    """
    Draw a motion with the spectrum of Kanai (1957) and Tajimi (1960).

    White noise, which rises and fades, shakes soil that responds as an oscillator; a second one
    leaves the ground at rest in the end (Clough & Penzien).

    :param peak: greatest acceleration along the direction [m/s²].
    :param duration: of the noise [s]; the ground rests a little later.
    :param frequency: of the soil [Hz]; firm soil 2.5.
    :param damping: ratio of the soil; firm soil 0.6.
    :param direction: level unit vector, (3,).
    """
    soil = 2.0 * np.pi * frequency
    slow = _HIGH_PASS * soil
    noisy = round(duration / INTERVAL) + 1
    count = noisy + round(_RING / (damping * slow * INTERVAL))
    share = np.arange(noisy) / (noisy - 1)
    envelope = np.minimum(np.square(share / _RISE), 1.0)
    envelope *= exp(-_FADE * np.maximum(share - _STRONG, 0.0))
    local = np.zeros((count, 3))
    for axis, part in enumerate((1.0, ACROSS, VERTICAL)):
        noise = np.zeros(count)
        noise[:noisy] = envelope * standard_normal(generator, noisy)
        soft = respond(noise, INTERVAL, soil, damping)
        shaken = -2.0 * damping * soil * soft[:, 1] - soil * soil * soft[:, 0]
        high = respond(shaken, INTERVAL, slow, damping)
        local[:, axis] = -shaken - 2.0 * damping * slow * high[:, 1] - slow * slow * high[:, 0]
        local[:, axis] *= part * peak / np.abs(local[:, axis]).max()
    return integrated(INTERVAL * np.arange(count), _turned(local, direction))


def _turned(local: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Turn accelerations along a level direction, to its left and up to the world, (T, 3)."""
    x, y = float(direction[0]), float(direction[1])
    return np.column_stack([x * local[:, 0] - y * local[:, 1], y * local[:, 0] + x * local[:, 1],
                            local[:, 2]])


def respond(acceleration: np.ndarray, interval: float, angular: float, damping: float
            ) -> np.ndarray:
    """
    Compute the response of an oscillator on shaken ground, exact for linear accelerations.

    :param acceleration: of the ground [m/s²], (T,).
    :param interval: between them [s].
    :param angular: frequency of the oscillator [rad/s].
    :param damping: ratio, below 1.
    :returns: displacement [m] and velocity [m/s] relative to the ground, (T, 2).
    """
    out = np.zeros((len(acceleration), 2))
    _respond(acceleration, interval, transition(np.array([angular]), damping, interval)[0], out)
    return out


@kernel
def _respond(acceleration, interval, step, out):
    for t in range(1, len(out)):
        for c in range(2):
            out[t, c] = (step[c, 0] * out[t - 1, 0] + step[c, 1] * out[t - 1, 1]
                         + step[c, 2] * acceleration[t - 1] + step[c, 3] * acceleration[t])


def transition(angular: np.ndarray, damping: float, interval: float) -> np.ndarray:
    """
    Return the exact step of damped oscillators on ground with a linear acceleration.

    Nigam & Jennings (1969, Bull. Seism. Soc. Am. 59, 909-922), equations 2.7 to 2.10.

    :param angular: frequencies [rad/s], (K,).
    :param damping: ratio, below 1.
    :param interval: [s].
    :returns: rows of displacement and velocity at its end, columns of displacement, velocity and
        acceleration of the ground at its start, and acceleration at its end, (K, 2, 4).
    """
    w, z, h = np.asarray(angular, float), damping, interval
    root = np.sqrt(1.0 - z * z)
    e, s, c = exp(-z * w * h), sin(w * root * h), cos(w * root * h)
    fade, square, cube = z / root, w * w, w * w * w
    out = np.empty((len(w), 2, 4))
    out[:, 0, 0] = e * (fade * s + c)
    out[:, 0, 1] = e * s / (w * root)
    out[:, 1, 0] = -w / root * e * s
    out[:, 1, 1] = e * (c - fade * s)
    a, b = (2.0 * z * z - 1.0) / (square * h), 2.0 * z / (cube * h)
    out[:, 0, 2] = e * ((a + z / w) * s / (w * root) + (b + 1.0 / square) * c) - b
    out[:, 0, 3] = -e * (a * s / (w * root) + b * c) - 1.0 / square + b
    turn, fall = c - fade * s, w * root * s + z * w * c
    out[:, 1, 2] = (e * ((a + z / w) * turn - (b + 1.0 / square) * fall)
                    + 1.0 / (square * h))
    out[:, 1, 3] = -e * (a * turn - b * fall) - 1.0 / (square * h)
    return out
