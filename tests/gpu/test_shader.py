"""Linked shaders contain each file once, and compile errors name the file and line."""

from __future__ import annotations

from pathlib import Path

import pytest

from holoview.gpu.device import Device
from holoview.gpu.shader import GeneratedWgsl, ShaderError, link

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
