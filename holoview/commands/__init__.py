"""The subcommands of `holoview`: they parse arguments, call the library and print its results; no physics.

Each subcommand is a module of its name. `configure(parser)` adds its arguments, `run(args)` carries it out and returns
the exit code; the module's docstring is what `--help` prints.

presets             list the shipped presets
info                print numbers derived from a bench
system_info         the numbers that `info` prints
view                open the interactive viewer
render              render what an observer sees, as PNG
optimise            find patterns and laser amplitudes for a target
optimise_options    arguments of `optimise`: settings, and how to run
optimise_target     the target of `optimise`: a picture, a focal stack or a light field
optimise_score      image quality of an optimised hologram
pupil_places        places of the eye's pupil for `optimise`
place_scores        targets and scores from these places and from others
export              write a hologram's patterns as PNG
captures            make, check, show and import capture files
captures_plan       `captures plan`: laser powers and exposure times
diagnose            name the causes of the difference between captures and simulation
calibrate           dispatch to the next two
calibrate_captures  learn maps of a bench from captures
calibrate_lut       `calibrate lut`: fit a look-up table to a diffraction-efficiency sweep
bench               time frames and edits
study               reproduce a figure of the paper
contrast            measure speckle contrast
demo                optimise, render and compare two displays

What they share:

arguments           arguments of several subcommands, and the bench that they describe
number_options      numbers as values of options: finite and in range
output_files        files that are read and written: declared, checked before the work, saved at the end
default_output      the file that is written when none is named
console             messages, progress bars, JSON and signals
streams             standard output and error that neither fail nor act on the terminal
exit_codes          exit codes besides 0
supervisor          the viewer in a process of its own, started again after a crash
"""
