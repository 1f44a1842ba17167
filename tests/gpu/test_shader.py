"""Linked shaders contain each file once, and compile errors name the file and line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from holoview.light.gpu.device import Device
from holoview.light.gpu.recorder import CommandRecorder, Dispatch
from holoview.light.gpu.shader import GeneratedWgsl, ShaderError, WgslStruct, link

GENERAL_SHADERS = ["lib/complex.wgsl", "lib/fixed.wgsl"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "one.wgsl").write_text("// one\nfn one() -> f32 { return 1.0; }\n")
    (tmp_path / "lib" / "two.wgsl").write_text('//#include "lib/one.wgsl"\nfn two() -> f32 { return one() + one(); }\n')
    (tmp_path / "main.wgsl").write_text(
        '//#include "lib/two.wgsl"\n//#include "lib/one.wgsl"\n\nfn three() -> f32 { return two() + one(); }\n'
    )
    return tmp_path


def test_an_included_file_appears_once_and_before_its_use(folder: Path) -> None:
    text = link("main.wgsl", root=folder).text
    assert [text.count(f"fn {name}()") for name in ("one", "two", "three")] == [1, 1, 1]
    assert text.index("fn one()") < text.index("fn two()") < text.index("fn three()")


def test_each_linked_line_knows_its_file_and_line(folder: Path) -> None:
    source = link("main.wgsl", GeneratedWgsl("made", "// made\nfn four() {}"), root=folder)
    found = {source.source_location(number): line for number, line in enumerate(source.text.splitlines(), start=1)}
    assert found["lib/one.wgsl", 2].startswith("fn one")
    assert found["lib/two.wgsl", 2].startswith("fn two")
    assert found["main.wgsl", 4].startswith("fn three")
    assert found["made", 2] == "fn four() {}"


def test_files_that_include_each_other_are_linked_once_each(folder: Path) -> None:
    (folder / "lib" / "one.wgsl").write_text('//#include "lib/two.wgsl"\nfn one() -> f32 { return 1.0; }\n')
    assert link("lib/two.wgsl", root=folder).text.count("fn two()") == 1


@pytest.mark.parametrize("name", ["lib/none.wgsl", "../outside.wgsl"])
def test_a_missing_or_outside_file_is_blamed_on_the_including_line(folder: Path, name: str) -> None:
    (folder.parent / "outside.wgsl").touch()
    (folder / "main.wgsl").write_text(f'\n//#include "{name}"\n')
    with pytest.raises(ShaderError, match=f"main.wgsl:2: no shader file '{name}'") as caught:
        link("main.wgsl", root=folder)
    assert (caught.value.file, caught.value.line) == ("main.wgsl", 2)


@pytest.mark.gpu
@pytest.mark.parametrize(
    ("broken", "complaint"),
    [
        ("fn one() -> f32 {\n    return nothing;\n}", "no definition in scope"),
        ("fn one() -> f32 {\n    return (;\n}", "expected expression"),
        ("fn one() -> f32 {\n    return vec2f(1.0);\n}", "return"),
    ],
)
def test_a_compile_error_names_file_line_source_and_complaint(
    device: Device, folder: Path, broken: str, complaint: str, wgpu_log: list[str]
) -> None:
    (folder / "lib" / "one.wgsl").write_text(f"// a line before\n{broken}\n")
    entry = GeneratedWgsl("entry", "@compute @workgroup_size(1) fn main() { _ = three(); }")
    with pytest.raises(ShaderError, match=complaint) as caught:
        device.pipeline(link("main.wgsl", entry, root=folder))
    assert caught.value.file == "lib/one.wgsl"
    assert caught.value.line in (2, 3)  # the line, or the function that a check of types blames
    assert str(caught.value).startswith(f"lib/one.wgsl:{caught.value.line}: ")
    assert f"\n{caught.value.line} │" in str(caught.value)
    wgpu_log.clear()


@pytest.mark.gpu
def test_a_constant_that_the_shader_lacks_is_our_fault_too(device: Device) -> None:
    source = link(GeneratedWgsl("entry", "@compute @workgroup_size(1) fn main() {}"))
    with pytest.raises(ShaderError, match=r"^entry: "):
        device.pipeline(source, {"no_such_constant": 1})


@pytest.mark.gpu
@pytest.mark.parametrize("name", GENERAL_SHADERS)
def test_every_general_shader_compiles_by_itself(device: Device, name: str) -> None:
    source = link(name, GeneratedWgsl("entry", "@compute @workgroup_size(1) fn nothing() {}"))
    device.raw.create_shader_module(code=source.text)


MIXED = WgslStruct(
    "Mixed",
    [
        ("count", "u32"),
        ("offset", "vec3<f32>"),
        ("scale", "f32"),  # fits into the fourth word of the vec3 before it
        ("shift", "i32"),
        ("corner", "vec2<u32>"),
        ("weights", "vec4<f32>"),
        ("bias", "f32"),
        ("table", "array<vec4<f32>, 3>"),
        ("direction", "vec3i"),
        ("last", "vec2f"),
    ],
)
WORDS = {"u32": 1, "i32": 1, "f32": 1, "vec3<f32>": 3, "vec2<u32>": 2, "vec4<f32>": 4, "vec3i": 3, "vec2f": 2}


def _expressions(struct: WgslStruct) -> list[str]:
    """A WGSL f32 expression for every number in the struct, in order of fields."""
    found = []
    for name, wgsl_type in struct.fields:
        if wgsl_type.startswith("array"):
            found += [f"f32(given.{name}[{i}].{c})" for i in range(3) for c in "xyzw"]
        elif WORDS[wgsl_type] == 1:
            found.append(f"f32(given.{name})")
        else:
            found += [f"f32(given.{name}.{c})" for c in "xyzw"[: WORDS[wgsl_type]]]
    return found


def _numbered(struct: WgslStruct) -> tuple[dict[str, np.ndarray], int]:
    """Values for the fields that count up from 1 through the whole struct."""
    values, total = {}, 0
    for name, _ in struct.fields:
        dtype = struct.dtype[name]
        size = int(np.prod(dtype.shape))
        values[name] = np.arange(total + 1, total + 1 + size).reshape(dtype.shape)
        total += size
    return values, total


@pytest.mark.gpu
@pytest.mark.parametrize("space", ["uniform", "storage"])
def test_a_shader_reads_back_every_field_as_packed(device: Device, space: str) -> None:
    values, total = _numbered(MIXED)
    lines = [f"    echo[{i}] = {expression};" for i, expression in enumerate(_expressions(MIXED))]
    access = "uniform" if space == "uniform" else "storage, read"
    text = "\n".join(
        [
            MIXED.wgsl,
            f"@group(0) @binding(0) var<{access}> given: Mixed;",
            "@group(1) @binding(0) var<storage, read_write> echo: array<f32>;",
            "@compute @workgroup_size(1)",
            "fn main() {",
            *lines,
            "}",
        ]
    )
    packed = MIXED.pack(**values)
    given = device.uniform(packed, "given") if space == "uniform" else device.upload(np.frombuffer(packed), "given")
    echo = device.buffer(4 * total, "echo")
    pipeline = device.pipeline(link(GeneratedWgsl("echo", text)))
    recorder = CommandRecorder(device)
    recorder.add(Dispatch.bind(device, pipeline, [[given], [echo]], (1, 1, 1)))
    recorder.submit()
    assert device.download(echo, np.float32, (total,)).tolist() == list(range(1, total + 1))


def test_the_size_is_rounded_up_to_the_widest_alignment() -> None:
    assert WgslStruct("A", [("a", "f32"), ("b", "vec4f"), ("c", "f32")]).size == 48
    assert WgslStruct("B", [("a", "vec3f"), ("b", "f32")]).size == 16
    assert WgslStruct("C", [("a", "f32"), ("b", "u32"), ("c", "i32")]).size == 12


def test_an_array_of_structs_is_packed_at_the_size_of_the_struct() -> None:
    struct = WgslStruct("Pair", [("a", "vec2f"), ("b", "u32")])
    packed = np.frombuffer(struct.pack_array([{"a": (1, 2), "b": 3}, {"a": (4, 5), "b": 6}]), struct.dtype)
    assert packed["b"].tolist() == [3, 6]
    assert packed["a"].tolist() == [[1, 2], [4, 5]]


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"n": 1}, r"missing or unknown fields \['v'\]"),
        ({"n": 1, "v": (1, 2), "w": 0}, r"missing or unknown fields \['w'\]"),
        ({"n": 1, "v": 2.0}, r"P.v: expected the shape \(2,\)"),
        ({"n": 1.5, "v": (1, 2)}, "P.n: expected whole numbers"),
    ],
)
def test_values_that_do_not_fit_the_struct_are_refused(values: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        WgslStruct("P", [("n", "u32"), ("v", "vec2f")]).pack(**values)


@pytest.mark.parametrize("wgsl_type", ["f64", "vec5f", "array<f32, 4>", "array<vec2f, 4>", "bool"])
def test_a_type_that_a_uniform_cannot_hold_is_refused(wgsl_type: str) -> None:
    with pytest.raises(ValueError, match=r"expected|must be"):
        WgslStruct("P", [("a", wgsl_type)])
