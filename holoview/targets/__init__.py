"""What the display should show: pictures, depths and focal stacks, in linear sRGB and SI units.

samples.py       Raster: decoded samples of one picture, and what all decoders share
tiff.py exr.py   files that may hold several pictures: pages; parts and layers
raster.py        decode a picture file into samples, without deciding what they mean
spaces.py        what float samples mean: linear sRGB, CIE XYZ, other primaries
picture.py       read_picture, read_depth, fit: a user's files as linear light and as depth
defocus.py       how wide and how shaped the blur of a point out of focus is; convolution without wrap-around
focal_stack.py   picture_stack and the Target that the optimiser aims at
saturation.py    more or less colourful targets
build.py         target_for: a bench and a picture to the Target on its planes
stacks.py        stack_for: focal stacks that were rendered elsewhere
"""
