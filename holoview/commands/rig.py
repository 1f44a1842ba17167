"""`holoview rig new | show | test | align`: a rig to start from, what a rig is, whether it answers, where it is."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from holoview.bench.rig import RigDescription, open_rig, read_rig
from holoview.bench.rig.align import (
    check_rig_records,
    find_geometry,
    laser_for_alignment,
    misfit_warning,
    registration_of,
    sentences,
)
from holoview.bench.rig.camera_pictures import take_exposed
from holoview.bench.rig.devices import Counts, Devices, limit_devices
from holoview.bench.rig.registration import register_devices, registration_path, write_registration
from holoview.commands.console import print_stderr, progress_bar
from holoview.commands.output_files import add_input, add_output_folder, hold_outputs
from holoview.light.model.effects.registry import EffectTable
from holoview.util.errors import UserError
from holoview.util.file_writer import check_writable, make_folder, write_file
from holoview.util.files import data_dir
from holoview.util.units import format_rounded

_FIRST_EXPOSURE_S = 1e-2


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the subcommands."""
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    new = commands.add_parser("new", help="a virtual rig to start from", description=_new.__doc__)
    add_output_folder(new, "folder", metavar="FOLDER", help="where rig.toml is written")
    new.set_defaults(run=_new)
    for name, summary, run_it in (
        ("show", "what the description says", _show),
        ("test", "whether the devices answer", _test),
        ("align", "find where modulators and camera are", _align),
    ):
        command = commands.add_parser(name, help=summary, description=run_it.__doc__)
        add_input(command, "rig", metavar="RIG.toml", help="description of the rig")
        command.set_defaults(run=run_it)
        if name == "align":
            command.add_argument(
                "--no-check", action="store_true", help="don't take captures afterwards to check their records"
            )


def run(args: argparse.Namespace) -> int:
    """Never called: each subcommand sets its own `run`."""
    raise AssertionError


def _new(args: argparse.Namespace) -> int:
    """Writes rig.toml of a small virtual rig, and hidden.toml with what is really there; overwrites nothing."""
    for file in sorted(data_dir("assets").joinpath("rig").glob("*.toml")):
        target = args.folder / file.name
        if target.exists():
            raise UserError(str(target), "is there already", remedy="choose another folder")
    make_folder(args.folder)
    for file in sorted(data_dir("assets").joinpath("rig").glob("*.toml")):
        write_file(args.folder / file.name, file.read_bytes())
    print(args.folder / "rig.toml")
    return 0


def _show(args: argparse.Namespace) -> int:
    """Says what rig.toml states, and where the devices are if `rig align` has found it."""
    rig = _read(args)
    described = rig.as_described
    camera, limits = described.bench.camera, described.limits
    bench = "near field" if described.bench.focal_length_m is None else "Fourier bench"
    print(f"{rig.name}: {bench}, {len(rig.bench.slms)} modulator{'s' if len(rig.bench.slms) > 1 else ''}")
    for name, spec in rig.devices.items():
        print(f"  {name}: {spec.kind}")
    rows, columns = described.slm_shape
    print(f"  modulators of {rows} × {columns} pixels of {_um(described.bench.slms[0].pitch_m)}")
    rows, columns = described.camera_shape
    print(f"  camera of {rows} × {columns} pixels of {_um(camera.pitch_m)}, {camera.bit_depth} bits")
    print(f"  lasers of {', '.join(f'{λ * 1e9:g}' for λ in rig.wavelengths_m)} nm, power up to {limits.power:g}")
    print(f"  exposures of {limits.exposures_s[0]:g} … {limits.exposures_s[1]:g} s")
    print(f"  stage at {' … '.join(format_rounded(z, 'mm') for z in limits.stage_m)}")
    if rig.registration is None:
        print("  nominal places; `holoview rig align` finds the real ones")
    for sentence in () if rig.registration is None else sentences(rig.registration):
        print(f"  {sentence}")
    return 0


def _test(args: argparse.Namespace) -> int:
    """Opens every device, takes a dark and a lit picture, and switches the lasers off."""
    rig = _read(args)
    with open_rig(rig) as devices:
        devices.lasers.switch_off()
        low, high = devices.camera.exposures_s
        devices.camera.set_exposure(float(np.clip(_FIRST_EXPOSURE_S, low, high)))
        print(f"dark picture: {_counts(devices.camera.take())}")
        lit, exposure_s = _lit_picture(rig, devices)
        print(f"lit picture at {exposure_s:.3g} s: {_counts(lit)}")
    print("all devices answer; the lasers are off")
    return 0


def _read(args: argparse.Namespace) -> RigDescription:
    """The rig, registered if its registration is known."""
    return read_rig(args.rig, is_registered=registration_path(Path(args.rig)).exists())


def _lit_picture(rig: RigDescription, devices: Devices) -> tuple[Counts, float]:
    """A picture of flat modulators and its exposure time (s)."""
    devices.stage.move_to(rig.limits.stage_m[0])
    devices.lasers.switch_on(laser_for_alignment(rig), min(rig.limits.power, 1.0))
    for modulator in devices.modulators:
        modulator.show(np.zeros(modulator.shape, np.uint8))
    devices.clock.wait(max(modulator.settle_s for modulator in devices.modulators))
    return take_exposed(devices.camera, rig.bench.camera, _FIRST_EXPOSURE_S)


def _align(args: argparse.Namespace) -> int:
    """Finds orientation and place of modulators, camera and planes, from dots; writes RIG.placement.toml."""
    rig = read_rig(args.rig, is_registered=False)
    output = registration_path(rig.path)
    check_writable(output)
    hold_outputs(args, [output])
    with open_rig(rig) as devices:
        with progress_bar("aligning") as report:
            found = find_geometry(rig, devices, report)
        registration = registration_of(rig, found)
        write_registration(output, registration)
        used, of = found.geometry.used
        print(f"{output}: {used} of {of} dots at {found.wavelength_m * 1e9:.0f} nm, ", end="")
        print(f"{found.geometry.residual_px:.2g} pixels from where it puts them (r.m.s.)")
        for sentence in sentences(registration):
            print(sentence)
        if doubtful := misfit_warning(found):
            print(doubtful)
        known = registration.known_effects()
        if known:
            print(f"a diagnosis knows by `--known {output}`: {_words(known)}")
        if not args.no_check:
            registered = rig.registered(registration)
            at_their_places = limit_devices(register_devices(devices, registration), registered.limits)
            with progress_bar("checking the records") as report:
                findings = check_rig_records(registered, at_their_places, report)
            for line in findings.lines:
                print(f"records: {line}")
            if findings.corrections:
                print_stderr("the records of captures would be wrong: look at the levels and the lasers of rig.toml")
    return 0


def _words(known: Mapping[str, Mapping[str, float]]) -> str:
    """Effects as options state them."""
    table = EffectTable().to_toml(EffectTable().parse(known, "known"))
    return " ".join(f"{name}.{key}={str(x).replace(' ', '')}" for name, own in table.items() for key, x in own.items())


def _counts(picture: Counts) -> str:
    return f"{int(picture.min())} to {int(picture.max())} counts, mean {picture.mean():.1f}"


def _um(value_m: float) -> str:
    return format_rounded(value_m, "um")
