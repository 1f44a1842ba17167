"""The subcommands of `holoview`: they parse arguments, call the library and print its results; no physics.

Each subcommand is a module of its name. `configure(parser)` adds its arguments, `run(args)` carries it out and returns
the exit code; the module's docstring is what `--help` prints.

presets       list the shipped presets
info          print numbers derived from a bench
view          open the interactive viewer
render        render what an observer sees, as PNG
optimise      find patterns and laser amplitudes for a target
export        write a hologram's patterns as PNG
rig           show, test and align a rig
measure       take captures with a rig
captures      make, check, show, import and plan captures
diagnose      name the causes of the difference between captures and simulation
calibrate     learn maps of a bench from captures, or fit a modulator's look-up table
bench         time frames and edits
bench_report  `bench --report`: one file with all measurements; needs fewer libraries than `bench`
study         reproduce a figure of the paper
contrast      measure speckle contrast
focus         find the distance at which a hologram is sharpest
conformance   check propagation against closed forms and other programs
demo          optimise, render and compare two displays

What they share:

arguments     arguments of several subcommands, and the bench that they describe
hologram_files  FILE… of the commands that show a hologram, and what was read
output_files  files that are read and written: declared, checked before the work, saved at the end
console       exit codes, messages, progress bars, JSON and signals
supervisor    the viewer in a process of its own, started again after a crash
"""
