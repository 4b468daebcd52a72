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


"""Parsers made by lark, whose tables are cached beside the compiled kernels."""

import hashlib
from io import BytesIO
from typing import Any

import lark

from procphys_ros.compilation.folder import kernel_folder, prepare
from procphys_ros.files.output_files import write_whole


def make_parser(name: str, grammar: str, **options: Any) -> lark.Lark:
    """
    Make an LALR parser that knows the place of each node, or load it from the user's cache.

    File errors never keep it from being made.

    :param name: dotted name of the module whose parser it is.
    :param grammar: in lark's own language.
    :param options: of `lark.Lark`.
    """
    facts = repr((grammar, sorted(options.items()), lark.__version__))
    digest = hashlib.sha256(facts.encode()).hexdigest()[:16]
    path = kernel_folder(name) / f'{digest}.tables'
    try:
        return lark.Lark.load(BytesIO(path.read_bytes()))
    except Exception:  # whatever a missing or damaged file may raise
        pass
    made = lark.Lark(grammar, parser='lalr', propagate_positions=True, maybe_placeholders=True,
                     **options)
    made_tables = BytesIO()
    made.save(made_tables)
    try:
        prepare(path.parent)
        write_whole(path, made_tables.getvalue())
    except OSError:
        pass  # the cache of kernels has warned of it
    return made
