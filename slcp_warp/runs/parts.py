"""Parts: the rows of one chunk as a Parquet file that says what it belongs to and proves what it holds."""

import hashlib
import io
import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..storage.files import FileError, most_bytes, opened, parse_json, read_bytes, reading
from .job import Columns

KEY, SEAL = b"slcp-warp", b"slcp-warp.sha256"  # of the metadata
UNSEALED = hashlib.sha256(b"a part before its hash is known").hexdigest().encode()
NEEDS = "stores of runs need pyarrow and filelock: pip install 'slcp-warp[data]'"


def arrow() -> Any:
    """The package pyarrow, with its Parquet. Raises ImportError that names the extra."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise ImportError(NEEDS) from error
    return pyarrow


def encode(columns: Columns, facts: Mapping[str, Any]) -> bytes:
    """A part's file: columns as `columns.checked` gives them, and facts (JSON values) about them.

    The file names the hash of all its bytes, those of the hash taken as UNSEALED.
    """
    pa = arrow()
    shapes = {name: list(a.shape[1:]) for name, a in columns.items() if a.ndim > 1}
    text = json.dumps(dict(facts) | {"rows": len(next(iter(columns.values()))), "shapes": shapes})
    arrays = [_to_arrow(pa, column) for column in columns.values()]
    fields = [pa.field(name, array.type, nullable=False) for name, array in zip(columns, arrays)]
    table = pa.Table.from_arrays(arrays, schema=pa.schema(fields))
    texts = [name for name, column in columns.items() if column.dtype.kind == "U"]
    sink = io.BytesIO()
    with pa.parquet.ParquetWriter(sink, table.schema, compression="zstd", use_dictionary=texts) as writer:
        writer.write_table(table)
        writer.add_key_value_metadata({KEY: text.encode(), SEAL: UNSEALED})
    data = sink.getvalue()
    return data.replace(UNSEALED, hashlib.sha256(data).hexdigest().encode())


def in_memory(columns: Columns) -> Any:
    """Columns as a `pyarrow.dataset`."""
    pa = arrow()
    import pyarrow.dataset

    return pyarrow.dataset.dataset(pa.table({name: _to_arrow(pa, a) for name, a in columns.items()}))


def _to_arrow(pa: Any, column: np.ndarray) -> Any:
    if column.dtype.kind == "U":
        if len(column) and (column == column[0]).all():
            indices = np.zeros(len(column), np.int32)
            return pa.DictionaryArray.from_arrays(indices, pa.array([str(column[0])]))
        return pa.array(column.tolist(), pa.string()).dictionary_encode()
    flat = pa.array(column.reshape(-1))
    if column.ndim == 1:
        return flat
    return pa.FixedSizeListArray.from_arrays(flat, int(np.prod(column.shape[1:])))


def names_of(path: Path) -> tuple[str, ...]:
    """The columns of a part. Raises FileError where it is no part."""
    with reading(path, "a part of a run", FileError), opened(path, most_bytes()) as file:
        return tuple(arrow().parquet.ParquetFile(file).schema_arrow.names)


def facts_of(path: Path) -> dict[str, Any]:
    """What a part says of itself, without reading its rows. Raises FileError where it is no part."""
    with reading(path, "a part of a run", FileError), opened(path, most_bytes()) as file:
        return _facts(arrow().parquet.ParquetFile(file))


def _facts(file: Any) -> dict[str, Any]:
    text = (file.metadata.metadata or {}).get(KEY)
    if text is None:
        raise FileError("it does not say what it belongs to; was it written by a run?")
    facts = parse_json(text.decode())
    if not isinstance(facts, dict) or not isinstance(facts.get("shapes"), dict):
        raise FileError("what it says of itself is no table of values")
    return facts


def read(path: Path, columns: Collection[str] | None = None) -> tuple[dict[str, Any], Columns]:
    """What a part says of itself, and its columns, all or those named, once its hash has been compared.

    Raises:
        FileNotFoundError: not there.
        FileError: damaged, or no part.
    """
    with reading(path, "a part of a run", FileError):
        data = read_bytes(path, most_bytes())
        pa = arrow()
        file = pa.parquet.ParquetFile(pa.BufferReader(data))
        facts = _facts(file)
        seal = file.metadata.metadata.get(SEAL, b"")
        if (
            len(seal) != len(UNSEALED)
            or hashlib.sha256(data.replace(seal, UNSEALED)).hexdigest().encode() != seal
        ):
            raise FileError("it is not what was written (its checksum differs)")
        known = file.schema_arrow.names
        names = known if columns is None else list(columns)
        if unknown := [name for name in names if name not in known]:
            raise FileError(f"it has no column {unknown[0]!r}; there are {known}")
        groups = [file.metadata.row_group(i) for i in range(file.metadata.num_row_groups)]
        if sum(group.total_byte_size for group in groups) > most_bytes():
            raise FileError(f"it unpacks to more than {most_bytes()} bytes")
        table = file.read(names, use_threads=False)
        return facts, {name: _to_numpy(table.column(name), facts["shapes"].get(name, [])) for name in names}


def _to_numpy(column: Any, shape: list[int]) -> np.ndarray:
    if column.null_count:
        raise FileError("it has rows without a value")
    pa = arrow()
    column = column.combine_chunks()
    if pa.types.is_fixed_size_list(column.type):
        return np.ascontiguousarray(column.flatten().to_numpy(zero_copy_only=False)).reshape(-1, *shape)
    if pa.types.is_dictionary(column.type):
        texts = np.array(column.dictionary.to_pylist() or [""], dtype=str)
        return texts[column.indices.to_numpy(zero_copy_only=False)]
    return np.ascontiguousarray(column.to_numpy(zero_copy_only=False))
