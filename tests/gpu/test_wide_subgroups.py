"""The transforms in subgroups of 16, 32 and 64 lanes, as on graphics cards, executed in Python line by line.

The software adapter of the tests has 4 or 8 lanes. The generated code has no branches or loops but stores under a
condition, so that each statement is one of numpy on all invocations of a workgroup.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.light.gpu.line_fft import can_access_fours, generate_subgroup_shader, lanes_per_line
from holoview.light.gpu.spectrum_order import LineTransform, SpectrumOrder
from tests.explored import explored

Values = NDArray[Any]
HOOKS = ("load", "store", "load_four", "store_four", "subgroupShuffle", "subgroupShuffleXor")
TOLERANCE = 1e-10
"""Relative L2: constants have 12 digits, and everything else is float64."""


class Workgroup:
    """Runs a shader for all invocations of one workgroup, with `subgroup` lanes in a subgroup.

    data: the lines (line, n); the hooks load from it, double the spectrum in between, and store to `stored`.
    """

    def __init__(self, shader: str, subgroup: int, data: Values) -> None:
        size = int(re.findall(r"@workgroup_size\((\d+)\)", shader)[0])
        self._local = np.arange(size)
        self._first = self._local - self._local % subgroup  # of the invocation's subgroup
        self._data, self.stored = data, np.full(data.shape, np.nan, complex)
        self._active = np.ones(size, bool)
        self.offsets: list[Values] = []  # of all points from the numbers of their lanes
        self._names: dict[str, Any] = {
            **{name: getattr(self, f"_{name}") for name in HOOKS},
            "local": self._local,
            "invocation": self._local % subgroup,
            "workgroup_number": 0,
            "field": 0,
            "lines_first": 0,
            "lines_count": len(data),
            "begin": lambda line, field: None,
            "shared_value": self._load,
            "load_shared": lambda position, value: value,
            "middle": lambda position, value: 2 * value,
            "middle_shared": lambda position, value, shared: 2 * value,
            "vec2f": lambda x, y=None: x + 1j * (x if y is None else y),
            "vec3u": lambda *parts: parts,
            "mat4x2f": lambda *columns: columns,
            "f32": lambda x: x * 1.0,
            "min": np.minimum,
            "cis": lambda turns: np.exp(2j * np.pi * turns),
            "cmul": lambda a, b: a * b,
            "cmul_conj": lambda a, b: a * np.conj(b),
            "select": lambda no, yes, condition: np.where(condition, yes, no),
        }
        for statement in _statements(shader):
            self._run(statement)

    def _run(self, statement: str) -> None:
        """A statement: a definition, a call, or the beginning or end of a condition."""
        if statement == "}":
            self._active = np.ones_like(self._active)
        elif found := re.fullmatch(r"if \((.*)\) {", statement):
            self._active = np.broadcast_to(self._value(found[1]), self._active.shape)
        elif found := re.fullmatch(r"(?:let )?(\w+) = (.*);", statement):
            self._names[found[1]] = self._value(found[2])
        else:
            self._value(statement.rstrip(";"))

    def _value(self, expression: str) -> Any:
        """The value of a WGSL expression, by Python's own parser."""
        text = re.sub(r"\b(\d+)u\b", r"\1", expression).replace("lines.", "lines_").replace(" / ", " // ")
        text = re.sub(r"\(workgroup\.y \* workgroups\.x \+ workgroup\.x\)|workgroup\.z", "workgroup_number", text)
        text = re.sub(r"(\w+)\.x\b", r"\1.real", re.sub(r"(\w+)\.y\b", r"\1.imag", text))
        text = re.sub(r"([^&]+) && (.+)", r"(\1) & (\2)", text)
        return eval(text, {"__builtins__": {}}, self._names)

    def _load(self, position: tuple[Any, ...]) -> Values:
        self.offsets.append(position[0] - self._names["lane_point"])
        return self._data[position[1], position[0]]

    def _store(self, position: tuple[Any, ...], value: Values) -> None:
        self.offsets.append(position[0] - self._names["lane_point"])
        along, line = (np.broadcast_to(part, self._active.shape)[self._active] for part in position[:2])
        assert np.isnan(self.stored[line, along]).all(), "stored twice"
        self.stored[line, along] = value[self._active]

    def _load_four(self, position: tuple[Any, ...]) -> tuple[Values, ...]:
        assert np.all(position[0] % 4 == 0)
        return tuple(self._load((position[0] + i, *position[1:])) for i in range(4))

    def _store_four(self, position: tuple[Any, ...], values: tuple[Values, ...]) -> None:
        assert np.all(position[0] % 4 == 0)
        for i, value in enumerate(values):
            self._store((position[0] + i, *position[1:]), value)

    def _subgroupShuffle(self, value: Values, lane: Values) -> Values:
        return np.broadcast_to(value, self._local.shape)[self._first + lane]

    def _subgroupShuffleXor(self, value: Values, mask: int) -> Values:
        return np.broadcast_to(value, self._local.shape)[self._first + (self._names["invocation"] ^ mask)]


def _statements(shader: str) -> list[str]:
    """The statements of the entry point."""
    body = shader.partition(") {\n")[2].rstrip().removesuffix("}")
    return [line.strip() for line in body.splitlines() if line.strip()]


def _lines(n: int, count: int) -> Values:
    parts = np.random.default_rng(n).standard_normal((2, count, n))
    return parts[0] + 1j * parts[1]


def _error(found: Values, expected: Values) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


@pytest.mark.parametrize("subgroup", [8, 16, 32, 64])
@pytest.mark.parametrize("n", explored([64, 240, 768, 1024, 1080, 4096], [64, 240, 1080]))
@pytest.mark.parametrize("direction", ["forward", "inverse"])
def test_a_transform_is_that_of_numpy(n: int, subgroup: int, direction: Any) -> None:
    lanes = lanes_per_line(n, subgroup)
    if lanes is None:
        pytest.skip("no number of lanes divides this length")
    data = _lines(n, 2)
    run = Workgroup(generate_subgroup_shader("x", n, lanes, [LineTransform(direction)]), subgroup, data)
    expected = np.fft.fft(data) if direction == "forward" else np.fft.ifft(data, norm="forward")
    assert _error(run.stored, expected) < TOLERANCE
    if n % lanes**2 == 0:  # then the frames' kernels add up indices from that of the lane and a constant
        assert all(np.ptp(offset) == 0 and offset[0] % lanes == 0 for offset in run.offsets)


@pytest.mark.parametrize(
    ("n", "lanes", "band"), [(256, 4, None), (256, 8, None), (1024, 8, (-256, 255)), (4096, 16, (-300, 200))]
)
def test_four_values_at_a_time_give_the_same(n: int, lanes: int, band: Any) -> None:
    assert can_access_fours(n, lanes)
    data, kept = _lines(n, 2), np.arange(n)
    for steps in (
        [LineTransform("inverse", None, band)],
        [LineTransform("inverse", None, band), LineTransform("forward", None, band)],
    ):
        if band is not None:
            kept = SpectrumOrder.natural(n, lanes, band).frequencies() % n
        spectrum = np.zeros_like(data)
        spectrum[:, kept] = data[:, : len(kept)]
        expected = np.fft.ifft(spectrum, norm="forward")
        if len(steps) > 1:
            expected = np.fft.fft(2 * expected)[:, kept]
        run = Workgroup(generate_subgroup_shader("x", n, lanes, steps, fours=True), lanes, data)
        assert _error(run.stored[:, : expected.shape[1]], expected) < TOLERANCE
        assert all(np.ptp(offset) == 0 and offset[0] % (4 * lanes) == 0 for offset in run.offsets[::4])


@pytest.mark.parametrize("subgroup", [16, 32, 64])
@pytest.mark.parametrize(("shared_hook", "shared_points"), [(None, 1), ("load", 2), ("load", 3), ("middle", 2)])
@pytest.mark.parametrize("n", explored([768, 1080], 1))
def test_a_pair_of_transforms_with_shared_values(
    n: int, subgroup: int, shared_hook: str | None, shared_points: int
) -> None:
    lanes = lanes_per_line(n, subgroup)
    assert lanes is not None
    data = np.repeat(_lines(n // shared_points, 2), shared_points, axis=1)
    steps = (
        [LineTransform("inverse"), LineTransform("forward")]
        if shared_hook == "middle"
        else [LineTransform("forward"), LineTransform("inverse")]
    )
    shader = generate_subgroup_shader("x", n, lanes, steps, shared_hook, shared_points)
    assert _error(Workgroup(shader, subgroup, data).stored, 2 * n * data) < TOLERANCE
