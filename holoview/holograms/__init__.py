"""Holograms: found for a picture, read from anyone's files, seen as an observer does, and judged.

files       decoders: bytes of files to numbers, with what a file says of them
targets     pictures with depth as focal stacks with natural defocus
fields      complex fields without a modulator: other programs' holograms, recordings of cameras
hologram    a hologram with the bench that shows it, and its file
load_field  a field of a file or of an array as a hologram
view        `simulate`: what an observer sees of a hologram
optimise    patterns, laser amplitudes and wavelengths for a focal stack
metrics     PSNR, colour difference, speckle contrast, eyebox uniformity
"""
