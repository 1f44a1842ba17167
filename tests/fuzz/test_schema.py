"""Schemas of files: what they allow is read, whatever else is refused by its name, and nothing else happens."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from safetensors.numpy import save_file

from holoview.bench.calibrate.train import _format
from holoview.bench.captures.capture_file import CAMERA_NUMBERS, IMAGES, LEVELS, PER_CAPTURE, SLM_NUMBERS
from holoview.holograms.hologram import _FILE
from holoview.holograms.optimise import checkpoint
from holoview.holograms.optimise.settings import Settings
from holoview.light.model.effects.learned_maps import MapLayout, map_schemas, map_sizes
from holoview.util.errors import UserError
from holoview.util.safetensors_file import TensorFormat
from holoview.util.tables import MAX_DEPTH, ArraySchema, NumberSchema, parse_json, parse_toml, read_record

LAYOUT = MapLayout(2, 5e-7, (4e-7, 6e-7), knots=4, source_nodes=(2, 3), warp_nodes=(2, 2), noll1=(4,), noll2=(4, 5))
FORMATS = {"hologram": _FILE, "checkpoint": checkpoint._FORMAT, "calibration": _format(LAYOUT)}
CHECKED = [*_FILE.tensors, *checkpoint._FORMAT.tensors, *map_schemas(LAYOUT), *LEVELS, IMAGES, *PER_CAPTURE]
SCHEMAS = list({schema.name: schema for schema in CHECKED}.values())
FEW = settings(max_examples=8, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def array_of(schema: ArraySchema, sizes: dict[str, int]) -> st.SearchStrategy[np.ndarray]:
    """Arrays that a schema allows, with these sizes of its axes."""
    shape = tuple(axis if isinstance(axis, int) else sizes.setdefault(axis, 2) for axis in schema.axes or ())
    kind = st.sampled_from(schema.types).map(np.dtype)

    def values(dtype: np.dtype[Any]) -> st.SearchStrategy[np.ndarray]:
        if dtype.kind == "f":
            most = float(np.finfo(dtype).max)
            low, high = max(schema.low, -most), min(schema.high, most)
            width: Any = dtype.itemsize * 8
            low, high = (float(dtype.type(x)) for x in (low, high))
            elements = st.floats(low, high, width=width).filter(lambda x: schema.low <= x <= schema.high)
            return arrays.arrays(dtype, shape, elements=elements)
        limits = np.iinfo(dtype)
        low, high = max(limits.min, schema.low), min(limits.max, schema.high)
        return arrays.arrays(dtype, shape, elements=st.integers(int(max(low, -(2**60))), int(min(high, 2**60))))

    return kind.flatmap(values)


def wrong_of(schema: ArraySchema, good: np.ndarray) -> st.SearchStrategy[np.ndarray]:
    """Arrays that the schema refuses, made from one that it allows."""
    wrong = [st.just(np.zeros(shape, dtype)) for shape in (good.shape,) for dtype in (np.complex64, bool)]
    wrong.append(st.just(good[..., None]))
    if good.ndim > 1 and good.size:
        wrong.append(st.just(good.ravel()))
    if good.size and good.dtype.kind == "f":
        bad = [math.nan, *([] if schema.may_be_infinite else [math.inf, -math.inf])]
        bad += [x for x in (schema.low - abs(schema.low) - 1, 2 * schema.high + 1) if math.isfinite(x)]

        def spoilt(x: float) -> np.ndarray:
            out = good.copy()
            with np.errstate(over="ignore"):
                out.flat[-1] = x
            return out

        wrong.append(st.sampled_from(bad).map(spoilt))
    return st.one_of(wrong)


@pytest.mark.parametrize("schema", SCHEMAS, ids=lambda schema: schema.name)
@FEW
@given(data=st.data())
def test_an_array_is_allowed_or_refused_by_its_name(schema: ArraySchema, data: st.DataObject) -> None:
    sizes: dict[str, int] = {}
    good = data.draw(array_of(schema, sizes))
    schema.check_header(good.dtype.name, good.shape, dict(sizes))
    schema.check_values(good)
    bad = data.draw(wrong_of(schema, good))
    with pytest.raises(UserError) as caught:
        schema.check_header(bad.dtype.name, bad.shape, dict(sizes))
        schema.check_values(bad)
    assert caught.value.where == schema.name


@pytest.mark.parametrize("kind", ["hologram", "checkpoint", "calibration"])
@FEW
@given(data=st.data())
def test_a_file_is_read_as_it_was_written_or_refused_with_its_name(
    kind: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    file_format: TensorFormat = FORMATS[kind]
    path, sizes = tmp_path_factory.mktemp("files") / "f.safetensors", map_sizes(LAYOUT)
    tensors = {schema.name: data.draw(array_of(schema, sizes)) for schema in file_format.tensors}
    texts = {"format": file_format.name, "version": file_format.version} | dict.fromkeys(file_format.metadata_keys, "")
    save_file(tensors, path, metadata=texts)
    with file_format.open(path) as file:
        read = file.tensors(sizes)
    assert all(np.array_equal(read[name], tensors[name]) for name in tensors)
    chosen = data.draw(st.sampled_from([s for s in file_format.tensors if tensors[s.name].size]))
    bad = np.ascontiguousarray(data.draw(wrong_of(chosen, tensors[chosen.name])))
    save_file(tensors | {chosen.name: bad}, path, metadata=texts)
    with pytest.raises(UserError, match=chosen.name.replace(".", r"\.")) as caught, file_format.open(path) as file:
        file.tensors(sizes)
    assert caught.value.where.startswith(str(path))


@pytest.mark.parametrize("schema", [*SLM_NUMBERS, *CAMERA_NUMBERS], ids=lambda schema: schema.name)
@given(value=st.one_of(st.floats(), st.integers(), st.text(max_size=3), st.none(), st.lists(st.floats(), max_size=3)))
def test_a_number_is_finite_and_in_range_or_refused(schema: NumberSchema, value: Any) -> None:
    try:
        read = schema.read(value, "here")
    except UserError as error:
        assert error.where == "here"
    else:
        assert math.isfinite(read) and schema.low <= read <= schema.high and (not schema.whole or read == int(read))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(changes=st.dictionaries(st.sampled_from([f.name for f in dataclasses.fields(Settings)]), JSON, max_size=2))
def test_a_record_is_what_its_class_allows_or_refused(changes: dict[str, Any]) -> None:
    import json

    text = json.dumps(dataclasses.asdict(Settings()) | changes)
    try:
        read = read_record(Settings, text, "here", "settings")
    except UserError as error:
        assert error.where.startswith("here")
    else:
        assert read == read_record(Settings, json.dumps(dataclasses.asdict(read)), "here", "settings")


@pytest.mark.parametrize("depth", [2, MAX_DEPTH - 1, MAX_DEPTH + 1, 3000, 100_000])
def test_depth_is_bounded(depth: int) -> None:
    texts = ["[" * depth + "]" * depth, '{"a":' * depth + "1" + "}" * depth]
    tables = ["a = " + texts[0], ".".join("a" * depth) + " = 1", "a = " + "{a=" * depth + "1" + "}" * depth]
    for parse, text in [(parse_json, t) for t in texts] + [(parse_toml, t) for t in tables]:
        if depth < MAX_DEPTH:
            parse(text, "here", "a text")
        else:
            with pytest.raises(UserError, match="inside each other"):
                parse(text, "here", "a text")


@given(number=st.integers())
def test_whole_numbers_have_64_bits(number: int) -> None:
    texts = ((parse_json, f"[{number}]"), (parse_toml, f"a = {number}"), (parse_toml, f"a = {abs(number):#x}"))
    for parse, text in texts:
        if -(2**63) <= number < 2**63 and abs(number) < 2**63:
            parse(text, "here", "a text")
        elif abs(number) > 2**63:
            with pytest.raises(UserError, match="64 bits"):
                parse(text, "here", "a text")


def test_metadata_and_bytes_of_any_kind_are_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for size in (0, 1, 8, 9, 100, 1000):
        (tmp_path / "f").write_bytes(rng.bytes(size))
        with pytest.raises(UserError):
            _FILE.read(tmp_path / "f")
