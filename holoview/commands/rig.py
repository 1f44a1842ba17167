"""`holoview rig new | show | test | align | settling | lut`: a rig to start from, what a rig is, whether it answers,
where it is, how fast its modulators settle, and the look-up table of one.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import tomli_w

from holoview.bench.calibrate.amplitude_table import FORMAT, VERSION, fit_amplitudes
from holoview.bench.calibrate.lut_fit import fit_labelled, known_labels
from holoview.bench.calibrate.lut_table import format_lut, levels_of_phases, lut_table, save_lut, verify_turn
from holoview.bench.experiment.lut_sweep import DEVIATION, TRANSMITTED, LutMeasurement, SweepPlan, SweepReadings
from holoview.bench.rig import RigDescription, open_rig, read_rig
from holoview.bench.rig.align import (
    check_rig_records,
    find_geometry,
    laser_for_alignment,
    misfit_warning,
    registration_of,
    require_dots,
    sentences,
)
from holoview.bench.rig.camera_pictures import SettlingTime, measure_settling, share_deviation, take_exposed
from holoview.bench.rig.description import virtual_rig_of, with_settle
from holoview.bench.rig.devices import Counts, Devices, limit_devices
from holoview.bench.rig.rays import arms_beside, mask_in_the_light
from holoview.bench.rig.registration import register_devices, registration_path, write_registration
from holoview.bench.rig.signal_check import SignalCheck, check_signals, signal_lines
from holoview.commands.arguments import whole
from holoview.commands.console import EXIT_FAILED, print_json, print_stderr, progress_bar
from holoview.commands.output_files import add_input, add_output, add_output_folder, hold_outputs
from holoview.light.model import preset
from holoview.light.model.effects.registry import EffectTable
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.file_writer import check_writable, make_folder, write_file
from holoview.util.files import data_dir
from holoview.util.units import format_duration, format_rounded

_FIRST_EXPOSURE_S = 1e-2
_SETTLING_BLUR_PX = 1.0  # of the random patterns whose steps are followed
_LEFT = 0.01  # of the pattern before
_LARGEST_DEVIATION = 0.1  # of a share of it, with which its decay can be followed
_PERIODS_PX = (2, 4, 8, 16, 32)  # of these the three coarsest that fit
_LEAST_PERIODS = 4  # on the modulator


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the subcommands."""
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    new = commands.add_parser("new", help="a virtual rig to start from", description=_new.__doc__)
    add_output_folder(new, "folder", metavar="FOLDER", help="where rig.toml is written")
    add_input(new, "--preset", help="a chain of elements, a preset's name or a TOML file (default: two modulators)")
    new.set_defaults(run=_new)
    for name, summary, run_it in (
        ("show", "what the description says", _show),
        ("test", "whether the devices answer", _test),
        ("align", "find where modulators and camera are", _align),
        ("settling", "measure how fast the modulators settle", _settling),
        ("lut", "measure the look-up table of a modulator", _lut),
    ):
        command = commands.add_parser(name, help=summary, description=run_it.__doc__)
        add_input(command, "rig", metavar="RIG.toml", help="description of the rig")
        command.set_defaults(run=run_it)
        if name == "test":
            command.add_argument("--no-signal", action="store_true", help="don't show gratings")
        if name == "align":
            command.add_argument(
                "--no-check", action="store_true", help="don't take captures afterwards to check their records"
            )
        if name == "settling":
            command.add_argument("--write", action="store_true", help="write the time to wait into RIG.toml")
        if name == "lut":
            _add_lut_options(command)


def _add_lut_options(command: argparse.ArgumentParser) -> None:
    add_output(
        command,
        "-o",
        "--output",
        metavar="TOML",
        suffix=".toml",
        required=True,
        help="the table; readings stand beside it as NAME.sweep.csv, with which the same command goes on",
    )
    command.add_argument(
        "--slm", default="1", metavar="NAME", help="whose table: 1, 2, or an element's name (default 1)"
    )
    command.add_argument(
        "--wavelength", action="append", metavar="LENGTH", help="of a laser of the rig; again for more (default: all)"
    )
    command.add_argument(
        "--period",
        action="append",
        type=whole(2, 1024),
        metavar="PIXELS",
        help="of a grating, even; again for more (default: 8, 16 and 32, or as many as the modulator holds four times)",
    )
    command.add_argument("--levels", type=whole(12, 4096), default=64, help="how many are shown (default 64)")
    command.add_argument("--along", choices=("x", "y"), default="x", help="where bars follow each other (default x)")
    command.add_argument("--verify", action="store_true", help="sweep once more, through the table")
    command.add_argument("--json", action="store_true", help="machine-readable figures on stdout")


def run(args: argparse.Namespace) -> int:
    """Never called: each subcommand sets its own `run`."""
    raise AssertionError


def _new(args: argparse.Namespace) -> int:
    """Writes rig.toml of a small virtual rig, or of one around a chain of elements, and hidden.toml with what is really
    there; overwrites nothing."""
    if args.preset is None:
        files = {file.name: file.read_bytes() for file in sorted(data_dir("assets").joinpath("rig").glob("*.toml"))}
    else:
        chain = preset.load(args.preset)
        tables, hidden = virtual_rig_of(chain, "chain.toml"), "# What is really there on the virtual rig.\nseed = 5\n"
        texts = {"chain.toml": preset.dumps(chain), "hidden.toml": hidden, "rig.toml": tomli_w.dumps(tables)}
        files = {name: text.encode("utf-8") for name, text in texts.items()}
    for name in files:
        if (args.folder / name).exists():
            raise UserError(str(args.folder / name), "is there already", remedy="choose another folder")
    make_folder(args.folder)
    for name, content in files.items():
        write_file(args.folder / name, content)
    print(args.folder / "rig.toml")
    return 0


def _show(args: argparse.Namespace) -> int:
    """Says what rig.toml states, and where the devices are if `rig align` has found it."""
    rig = _read(args)
    described = rig.as_described
    camera, limits = described.bench.camera, described.limits
    bench = "near field" if described.bench.focal_length_m is None else "Fourier bench"
    bench = bench if described.bench.chain is None else f"chain of elements, {described.bench.chain.name}"
    print(f"{rig.name}: {bench}, {len(rig.bench.slms)} modulator{'s' if len(rig.bench.slms) > 1 else ''}")
    for name, spec in rig.devices.items():
        print(f"  {name}: {spec.kind}")
    for words, (rows, columns), pitch_m in _modulators(described):
        print(f"  {words} of {rows} × {columns} pixels of {_um(pitch_m)}")
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


def _modulators(rig: RigDescription) -> list[tuple[str, tuple[int, int], float]]:
    """Words, shape and pitch (m) of the modulators: of one or two alike together, of a chain each by its name."""
    if rig.bench.chain is None:
        return [("modulators", rig.slm_shape, rig.bench.slms[0].pitch_m)]
    pitches_m = [slm.pitch_m for slm in rig.bench.slms]
    return list(zip(rig.modulator_names, rig.slm_shapes, pitches_m, strict=True))


def _test(args: argparse.Namespace) -> int:
    """Opens every device, takes a dark and a lit picture, checks by gratings that patterns arrive unscaled and with all
    their levels, and switches the lasers off. Exits with 1 where they don't.
    """
    rig = _read(args)
    with open_rig(rig) as devices:
        devices.lasers.switch_off()
        low, high = devices.camera.exposures_s
        devices.camera.set_exposure(float(np.clip(_FIRST_EXPOSURE_S, low, high)))
        print(f"dark picture: {_counts(devices.camera.take())}")
        lit, exposure_s = _lit_picture(rig, devices, rig.limits.stage_m[0])
        print(f"lit picture at {exposure_s:.3g} s: {_counts(lit)}")
        checks: tuple[SignalCheck, ...] = ()
        if not args.no_signal:
            with progress_bar("signals") as report:
                checks = check_signals(rig, devices, report)
    for line in (line for check in checks for line in signal_lines(check)):
        print(line)
    print("all devices answer; the lasers are off")
    return EXIT_FAILED if any(check.faults for check in checks) else 0


def _read(args: argparse.Namespace) -> RigDescription:
    """The rig, registered if its registration is known."""
    return read_rig(args.rig, is_registered=registration_path(Path(args.rig)).exists())


def _lit_picture(rig: RigDescription, devices: Devices, place_m: float) -> tuple[Counts, float]:
    """A picture of flat, transparent modulators at a place of the stage, and its exposure time (s)."""
    devices.stage.move_to(place_m)
    devices.lasers.switch_on(laser_for_alignment(rig), min(rig.limits.power, 1.0))
    devices.show(rig.clear_levels)
    devices.clock.wait(max(modulator.settle_s for modulator in devices.modulators))
    return take_exposed(devices.camera, rig.bench.camera, _FIRST_EXPOSURE_S)


def _align(args: argparse.Namespace) -> int:
    """Finds orientation and place of modulators, camera and planes, from dots; writes RIG.placement.toml."""
    rig = read_rig(args.rig, is_registered=False)
    require_dots(rig)
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
            at_their_places = limit_devices(register_devices(devices, registration, rig.dotted[-1]), registered.limits)
            with progress_bar("checking the records") as report:
                findings = check_rig_records(registered, at_their_places, report)
            for line in findings.lines:
                print(f"records: {line}")
            if findings.corrections:
                print_stderr("the records of captures would be wrong: look at the levels and the lasers of rig.toml")
    return 0


def _settling(args: argparse.Namespace) -> int:
    """Shows steps of a pattern, takes pictures after increasing delays, and says how long a modulator needs until less
    than 1 % of the pattern before is left."""
    rig = _read(args)
    waits: dict[str, float] = {}
    with open_rig(rig) as devices:
        near, far = rig.limits.stage_m
        light = _lit_picture(rig, devices, near if rig.bench.focal_length_m else (near + far) / 2)
        facts, levels = rig.bench.camera, rig.random_levels(np.random.default_rng(0), _SETTLING_BLUR_PX)
        for number, modulator in enumerate(devices.modulators):
            name, (rows, columns) = rig.modulator_names[number], rig.slm_shapes[number]
            devices.show(levels)
            devices.clock.wait(devices.settle_s)
            devices.camera.set_exposure(light[1])
            sent, num_levels = levels[number, :rows, :columns], rig.bench.slms[number].num_levels
            seen_by = modulator, devices.camera, facts, devices.clock, sent, num_levels
            if share_deviation(*seen_by) > _LARGEST_DEVIATION:
                found_is = "pictures hardly change with the pattern"
                remedy = "more light, or [limits] that let the stage go where the pattern shows"
                raise UserError(name, found_is, expected="a picture of it", remedy=remedy)
            found = measure_settling(*seen_by)
            waits[name] = found.wait_until(_LEFT)
            print(f"{name}: {_settling_words(found, waits[name], modulator.settle_s)}")
    if args.write:
        text = rig.path.read_text(encoding="utf-8")
        for name, wait_s in waits.items():
            text = with_settle(text, name, wait_s)
        write_file(rig.path, text)
        print(f"written: {rig.path}")
    return 0


def _settling_words(found: SettlingTime, wait_s: float, stated_s: float) -> str:
    if found.constant_s == 0:
        return f"settled in its first picture; settle = {stated_s:g} s is enough"
    verdict = "is enough" if wait_s <= stated_s else "is too short"
    return (
        f"settles with a time constant of {found.constant_s * 1e3:.3g} ± {found.deviation_s * 1e3:.2g} ms; less than "
        f"1 % of the pattern before is left after {format_duration(wait_s)}, less than 0.1 % after "
        f"{format_duration(found.wait_s)}; settle = {stated_s:g} s {verdict}"
    )


def _lut(args: argparse.Namespace) -> int:
    """Sweeps the grey level of binary gratings, reads their orders with the camera, and fits the look-up table as
    `holoview calibrate lut` does. What was measured is kept, and the same command goes on."""
    rig = _read(args)
    plan = _lut_plan(args, rig)
    table, through_table = args.output.with_suffix(".sweep.csv"), args.output.with_suffix(".verify.csv")
    check_writable(table)
    hold_outputs(args, [table, through_table])
    readings = SweepReadings.at(table, plan)
    with open_rig(rig) as devices:
        measurement = LutMeasurement(rig, devices, print_stderr)
        try:
            with progress_bar("sweeping") as progress:
                measurement.run(plan, readings, progress)
        except (UserError, KeyboardInterrupt):
            print_stderr(f"{readings.count} of {plan.captures} readings are in {table}; the same command goes on")
            raise
        if not plan.periods_px[0]:
            return _save_amplitudes(args, rig.modulator_names[plan.modulator], readings, table.name)
        fitted = fit_labelled(readings.sweeps())
        wavelengths_m, periods = known_labels(fitted.sweeps)
        lut = fitted.lut
        figures = lut_table(lut, table.name, wavelengths_m, periods) | {"readings": str(table)}
        lines = format_lut(lut, wavelengths_m, periods) + fitted.notes
        if args.verify and lut.explains:
            first = fitted.sweeps[0]
            assert first.wavelength_m is not None and first.period_px is not None
            laser_m = min(plan.wavelengths_m, key=lambda own: abs(own - (first.wavelength_m or 0)))
            target = min(lut.stroke, 2 * math.pi)
            levels = levels_of_phases(lut, np.linspace(0, target, len(plan.levels)))
            again = dataclasses.replace(
                plan,
                wavelengths_m=(laser_m,),
                periods_px=(round(first.period_px),),
                levels=levels,
                is_through=True,
            )
            through = SweepReadings(through_table)
            with progress_bar("verifying") as progress:
                measurement.run(again, through, progress)
            checked = verify_turn(fit_labelled(through.sweeps()).lut, target)
            lines.append(str(checked))
            figures["verification"] = {
                "target_pi": checked.target / math.pi,
                "rms_pi": checked.rms / math.pi,
                "greatest_pi": checked.greatest / math.pi,
                "step": checked.step,
            }
    if args.json:
        print_json(figures | ({"left_out": fitted.notes} if fitted.notes else {}))
    else:
        print("\n".join(lines))
    lut.check()
    save_lut(args.output, lut, table.name, wavelengths_m, periods)
    return 0


def _save_amplitudes(args: argparse.Namespace, element: str, readings: SweepReadings, source: str) -> int:
    """Writes and prints the table of an amplitude modulator."""
    light, deviation = (readings.mean_over_lasers(order) for order in (TRANSMITTED, DEVIATION))
    found = fit_amplitudes(light, deviation, source)
    figures = {"format": FORMAT, "version": VERSION, "source": source, "element": element, **found.as_toml}
    if args.json:
        print_json(figures)
    else:
        print("\n".join(found.lines))
    write_file(args.output, tomli_w.dumps(figures))
    return 0


def _slm_number(text: str, rig: RigDescription) -> int:
    """The number of the modulator that is meant, from 0. Raises UserError for another name."""
    names = rig.modulator_names
    numbers = [str(number + 1) for number in range(len(names))]
    for known in (names, numbers):
        if text in known:
            return known.index(text)
    raise UserError("--slm", text, expected=f"1 … {len(names)}" if rig.bench.chain is None else ", ".join(names))


def _lut_plan(args: argparse.Namespace, rig: RigDescription) -> SweepPlan:
    """What the options ask for. Raises UserError for a laser, a modulator or gratings that the rig can't have."""
    modulator, axis = _slm_number(args.slm, rig), 1 if args.along == "x" else 0
    is_amplitude = not rig.bench.slms[modulator].opd_range_m
    _check_lut_light(args, rig, modulator)
    wavelengths = [units.parse(text, "--wavelength") for text in args.wavelength or ()]
    for value in wavelengths:
        if not any(abs(value - own) < 1e-12 for own in rig.wavelengths_m):
            lasers = ", ".join(format_rounded(own, "nm") for own in rig.wavelengths_m)
            raise UserError("--wavelength", format_rounded(value, "nm"), expected=f"one of {lasers}")
    own = [λ for λ in rig.wavelengths_m if not wavelengths or any(abs(λ - value) < 1e-12 for value in wavelengths)]
    num_levels = rig.bench.slms[modulator].num_levels
    levels = np.unique(np.linspace(0, num_levels - 1, min(args.levels, num_levels)).round().astype(np.int64))
    if is_amplitude:
        return SweepPlan(modulator, tuple(own), (0,), levels)
    largest = rig.slm_shapes[modulator][axis] // _LEAST_PERIODS
    usual = [period for period in _PERIODS_PX if period <= largest][-3:]
    periods = sorted(set(args.period or usual or [2]))
    odd = next((period for period in periods if period % 2 or period > largest), None)
    if odd is not None:
        raise UserError(
            "--period", f"{odd}", expected=f"an even number up to {largest}, so that {_LEAST_PERIODS} are on it"
        )
    return SweepPlan(modulator, tuple(own), tuple(periods), levels, axis)


def _check_lut_light(args: argparse.Namespace, rig: RigDescription, modulator: int) -> None:
    """Raises UserError for a modulator whose table can't be read where it stands, and for options that it lacks."""
    name, mask = rig.modulator_names[modulator], mask_in_the_light(rig)
    if rig.bench.slms[modulator].opd_range_m:
        if mask:
            remedy = "`holoview calibrate` learns its table from captures of random patterns"
            found = f"{name} behind or before {mask}"
            raise UserError("--slm", found, expected="gratings that no speckle hides", remedy=remedy)
        return
    for flag, is_stated in (("--period", args.period), ("--verify", args.verify), ("--along", args.along == "y")):
        if is_stated:
            expected = "none of it: an amplitude modulator shows one level everywhere, and its light is read"
            raise UserError(flag, f"with {name}, of amplitude", expected=expected)
    if arms := " and ".join(arms_beside(rig, name)):
        found, expected = f"{name} beside {arms}", "a modulator that all light passes"
        remedy = f"block the light of {arms} and describe the rig without it, or `holoview calibrate`"
        raise UserError("--slm", found, expected=expected, remedy=remedy)


def _words(known: Mapping[str, Mapping[str, float]]) -> str:
    """Effects as options state them."""
    table = EffectTable().to_toml(EffectTable().parse(known, "known"))
    texts = [f"{name}.{key}={_told(key, x)}" for name, own in table.items() for key, x in own.items()]
    return " ".join(f"'{text}'" if " " in text else text for text in texts)


def _told(key: str, value: object) -> str:
    """A value without the space before its unit; the name of an element as it is."""
    return str(value) if key == "element" else str(value).replace(" ", "")


def _counts(picture: Counts) -> str:
    return f"{int(picture.min())} to {int(picture.max())} counts, mean {picture.mean():.1f}"


def _um(value_m: float) -> str:
    return format_rounded(value_m, "um")
