"""What the display should show: pictures, depths and focal stacks, in linear sRGB and SI units.

raster.py        decode a picture file into samples, without deciding what they mean
picture.py       read_picture, read_depth, fit: a user's files as linear light and as depth
defocus.py       how wide and how shaped the blur of a point out of focus is; convolution without wrap-around
focal_stack.py   picture_stack and the Target that the optimiser aims at
stacks.py        read_stack, stack_for: focal stacks that were rendered elsewhere
saturation.py    more or less colourful targets
build.py         target_for: a bench and a picture to the Target on its planes
"""
