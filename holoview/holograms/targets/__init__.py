"""Target images: pictures, depth maps and focal stacks as linear sRGB, on a bench's planes and grid.

target         from a bench and a picture to the focal stack that is optimised for
focal_stack    `Target`; focal stacks rendered here with incoherent defocus, or read from files; films
framing        how a picture of another aspect is placed on the modulators: fill, fit, crop
defocus        light cones, their blur kernels (square or disc), layers of a scene, FFT convolution without wrap-around
light_field    a scene through a pupil; views from a grid of viewpoints, also from a folder
moving_pupil   a picture from any place of the pupil, blurred once and then moved; targets of a bench whose eye moves
live_pictures  pictures that change: a film in turn, the newest one of a folder, a camera
picture        a picture or a depth map as linear light of sRGB primaries, its saturation, and resizing to the grid
target_source  a target file, read once and built for any planes and places of the pupil
"""
