"""Target images: pictures, depth maps and focal stacks as linear sRGB, on a bench's planes and grid.

target_source    a target file, read once and built for any planes and places of the pupil
target           from a bench and a picture to the focal stack that is optimised for
focal_stack      `Target`; a focal stack rendered with incoherent defocus from a picture and a depth map
viewing_pupil    a target as an eye sees it: a round pupil off the axis, a focus for each wavelength
light_field      views from a grid of viewpoints, and what a pupil sees of them
view_folder      a light field from a folder of pictures
moving_pupil     a picture from any place of the pupil, blurred once and then moved
eye_targets      targets of a bench whose eye moves: from views, and for any place
scene_layers     a picture with depth as layers, continued beneath nearer ones
defocus          light cones, their blur kernels (square or disc), and FFT convolution without wrap-around
rendered_stacks  focal stacks rendered elsewhere: a folder, TIFF pages, OpenEXR parts or layers
picture          a picture or a depth map as linear light, and resizing to the simulation grid
image_reader     decodes PNG, JPEG, TIFF and OpenEXR files, recognised by their first bytes
deep_png         decodes PNG files of 16 bits a sample
raster           the decoded image (`Raster`), and helpers that all decoders share
exr              parts and layers of OpenEXR files as rasters
tiff             pages of TIFF files as rasters
colour_spaces    float images (linear sRGB, CIE XYZ, other primaries) to linear sRGB
saturation       chroma scaled in CIE LCHuv at constant lightness and hue
"""
