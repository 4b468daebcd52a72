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


"""Table: rows of a batch on disk, each safe as soon as its run is over."""

from collections.abc import Mapping, Sequence
import csv
import io
import json
import os
from pathlib import Path
from typing import Any, BinaryIO

from procphys_ros.batch.run import MEASURES
from procphys_ros.errors import SceneError
from procphys_ros.files.output_files import lock, write_beside
from procphys_ros.simulation.readings import Series

SUFFIXES = ('.csv', '.parquet')


class Table:
    """
    Append rows to a CSV file; convert it to a Parquet file when all exist.

    :param path: file to write; until a Parquet file is complete its rows are in `<path>.rows.csv`.
    :param columns: names of the varied parameters.
    :param digest: of the sweep, in a separate column, so that another sweep cannot continue it.
    :ivar done: numbers of the runs with a row.
    :raises SceneError: if the file cannot be written, or holds rows of another sweep.
    """

    def __init__(self, path: Path, columns: Sequence[str], digest: str):
        if path.suffix not in SUFFIXES:
            raise SceneError(f'--out {path}: it must end in {" or ".join(SUFFIXES)}')
        self._path, self._digest = path, digest
        self._columns = ('run', *columns, *MEASURES, 'sweep')
        self._rows = path if path.suffix == '.csv' else path.with_name(f'{path.name}.rows.csv')
        self._file: BinaryIO | None = None  # none if all rows exist
        self.done: set[int] = set()
        try:
            self._go_on()
        except OSError as error:
            raise SceneError(f'--out {path}: {error.strerror or error}') from error

    def _go_on(self) -> None:
        """Read existing rows, cut off an incomplete one at the end, and keep the file open."""
        if self._path.suffix == '.parquet' and self._path.exists():
            self._check(*_parquet_rows(self._path))
            return
        self._file = self._rows.open('ab+', buffering=0)  # buffers no row when the disk is full
        try:
            if not lock(self._file):
                raise SceneError(f'--out {self._path}: another batch is writing it')
            self._file.seek(0)
            text = self._file.read()
            whole = text[:_end_of_rows(text)]  # the rest may end within a character
            if whole:
                read = csv.DictReader(io.StringIO(whole.decode(), newline=''))
                self._check(list(read.fieldnames or []), list(read))
            elif not ','.join(self._columns).encode().startswith(text):
                raise self._other_sweep()
        except (SceneError, UnicodeDecodeError, csv.Error) as error:
            self._file.close()
            raise error if isinstance(error, SceneError) else self._other_sweep() from None
        if whole != text:  # an incomplete row of this table
            os.truncate(self._rows, len(whole))
        if not whole:
            self._append(self._columns)

    def _check(self, columns: list[str], rows: list[dict]) -> None:
        """Accept existing rows, unless they are those of another sweep."""
        if columns != list(self._columns) or any(row['sweep'] != self._digest for row in rows):
            raise self._other_sweep()
        self.done = {int(row['run']) for row in rows}

    def _other_sweep(self) -> SceneError:
        return SceneError(f'--out {self._path}: holds another sweep, or one of another scene; '
                          'choose another file, or delete it')

    def add(self, number: int, values: Sequence[Any], measures: Mapping[str, float],
            series: Series | None = None) -> None:
        """
        Write the series of a run, then its row, safe against a kill of the process.

        :param number: of the run.
        :param values: of the varied parameters.
        :param measures: values of `MEASURES`.
        :param series: of its parts, for a separate file in the folder `<path>.series`.
        :raises SceneError: if the disk is full.
        """
        texts = [json.dumps(v) if isinstance(v, (list, tuple)) else v for v in values]
        try:
            if series is not None:
                folder = self._path.with_name(f'{self._path.name}.series')
                folder.mkdir(exist_ok=True)
                write_beside(folder / f'{number}.npz', series.save)
            self._append([number, *texts, *(measures[name] for name in MEASURES), self._digest])
        except OSError as error:
            raise SceneError(f'--out {self._path}: {error.strerror or error}') from error
        self.done.add(number)

    def _append(self, row: Sequence[Any]) -> None:
        assert self._file is not None, 'the table is complete'
        line = io.StringIO()
        csv.writer(line, lineterminator='\n').writerow(row)
        rest = line.getvalue().encode()
        while rest:
            rest = rest[self._file.write(rest):]
        os.fsync(self._file.fileno())

    def close(self, complete: bool) -> None:
        """
        Close the table.

        :param complete: whether all rows exist, so that a Parquet file can be written.
        :raises SceneError: if the disk is full.
        """
        if self._file is None:
            return
        self._file.close()
        if not complete or self._path.suffix != '.parquet':
            return
        try:
            write_beside(self._path, self._write_parquet)
            self._rows.unlink()
        except OSError as error:
            raise SceneError(f'--out {self._path}: {error.strerror or error}') from error

    def _write_parquet(self, path: Path) -> None:
        """Convert the rows; types of columns do not depend on the results."""
        import pyarrow
        from pyarrow import csv as arrow
        from pyarrow import parquet
        texts = arrow.ParseOptions(newlines_in_values=True)  # texts of grammars have several lines
        times = {name: pyarrow.float64() for name in MEASURES if name.endswith('_s')}
        types = arrow.ConvertOptions(column_types={**times, 'sweep': pyarrow.string()},
                                     null_values=[])  # NaN is a number here
        rows = arrow.read_csv(self._rows, parse_options=texts, convert_options=types)
        parquet.write_table(rows.sort_by('run'), path)


def _end_of_rows(text: bytes) -> int:
    """Return the end of the last complete row: after a line end outside quotes."""
    end = text.rfind(b'\n') + 1
    while text.count(b'"', 0, end) % 2:
        end = text.rfind(b'\n', 0, end - 1) + 1
    return end


def _parquet_rows(path: Path) -> tuple[list[str], list[dict]]:
    """Read the names of the columns, and the rows."""
    from pyarrow import ArrowInvalid, parquet
    try:
        table = parquet.read_table(path)
    except ArrowInvalid as error:
        raise SceneError(f'--out {path}: is no Parquet file') from error
    return table.column_names, table.to_pylist()


def check_format(path: Path) -> None:
    """
    Validate the format of a table.

    :raises SceneError: if a package is missing.
    """
    if path.suffix == '.parquet':
        try:
            import pyarrow  # noqa: F401
        except ImportError as error:
            raise SceneError(f'--out {path}: Parquet needs pyarrow, pip install it') from error
