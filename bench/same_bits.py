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
Run the shipped scenes as on other processors, and compare poses and break events to the bit.

Each setting takes away what a processor may lack: kernels of OpenBLAS, vector instructions of
numpy and of libm, instructions that numba compiles for; or it runs on another number of threads.
What differs from the plain run is printed, with the second from which on. An engine of bodies that
is not ours may use libm: without its instructions, scenes with loose bodies may differ.

The poorest processor lacks all of it at once, and runs on five threads; its run alone tells
whether anything differs, and `--each` what does.

    python bench/same_bits.py
    python bench/same_bits.py demo garden --seconds 3 --each
"""

import argparse
from collections.abc import Iterator
import json
import os
from pathlib import Path
import subprocess
import sys

from numpy._core._multiarray_umath import __cpu_dispatch__
from pose_hashes import difference, SCENES

_ROOT = Path(__file__).parents[1]
_THREADS = (1, 2, 5)
LIBM = 'libm without AVX2 and FMA'
_PLAIN_LIBM = {'GLIBC_TUNABLES': 'glibc.cpu.hwcaps=-AVX2,-FMA,-AVX2_Usable,-FMA_Usable'}
_ANY_NUMBA = {'NUMBA_CPU_NAME': 'generic', 'NUMBA_CPU_FEATURES': ''}


def _without(*instructions: str) -> dict[str, str]:
    found = [name for name in __cpu_dispatch__ if any(part in name for part in instructions)]
    return {'NPY_DISABLE_CPU_FEATURES': ' '.join(found)}


def poorest() -> Iterator[tuple[str, dict[str, str], int]]:
    """List processors that lack everything at once, with and without libm's instructions."""
    lacks = {'OPENBLAS_CORETYPE': 'Nehalem', **_ANY_NUMBA,
             **_without('AVX512', 'X86_V4', 'AVX2', 'FMA3', 'X86_V3')}
    yield 'all at once, but libm', lacks, 5
    yield LIBM, {**lacks, **_PLAIN_LIBM}, 5


def each() -> Iterator[tuple[str, dict[str, str], int]]:
    """List settings: name, environment that makes it, threads (0 = as they come)."""
    for kernel in ('Nehalem', 'Haswell', 'SkylakeX', 'Zen'):
        yield f'OpenBLAS of {kernel}', {'OPENBLAS_CORETYPE': kernel}, 0
    yield 'numpy without AVX-512', _without('AVX512', 'X86_V4'), 0
    yield ('numpy without AVX2 and FMA',
           _without('AVX512', 'X86_V4', 'AVX2', 'FMA3', 'X86_V3'), 0)
    yield LIBM, _PLAIN_LIBM, 0
    yield 'numba for any x86-64', _ANY_NUMBA, 0
    for count in _THREADS:
        yield f'{count} threads', {}, count


def run(scene: str, seconds: int, environment: dict[str, str], threads: int) -> list[dict]:
    """Simulate a scene in a process with an environment, and return hashes of each second."""
    code = ('import json\nfrom pose_hashes import simulate\n'
            f'print(json.dumps(simulate({scene!r}, {seconds}, {threads})))')
    done = subprocess.run(
        [sys.executable, '-c', code], check=True, cwd=_ROOT, stdout=subprocess.PIPE, text=True,
        env={**os.environ, 'PYTHONPATH': f'{_ROOT / "bench"}:{_ROOT}', **environment})
    return json.loads(done.stdout.splitlines()[-1])


def main() -> int:
    """Run what the command line asks for; exit status 1 when a scene differs."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('scenes', nargs='*', metavar='scene', help=f'of {", ".join(SCENES)}')
    parser.add_argument('--seconds', type=int, default=10, help='simulated per scene')
    parser.add_argument('--each', action='store_true', help='take away one thing at a time')
    asked = parser.parse_args()
    failed = 0
    for scene in asked.scenes or SCENES:
        plain = run(scene, asked.seconds, {}, 0)
        for name, environment, threads in each() if asked.each else poorest():
            found = run(scene, asked.seconds, environment, threads)
            told = difference(plain, found)
            others = told and name == LIBM and found[-1]['loose'] > 0
            failed += bool(told) and not others
            print(f'{scene:20s} {name:28s} {told or "same"}{" (engine)" * bool(others)}',
                  flush=True)
    return int(failed > 0)


if __name__ == '__main__':
    sys.exit(main())
