"""Files of pictures, fields and patterns: bytes to numbers, with what a file says of them.

readers           readers of holograms' files, one module for each format; other packages can add their own
request           what a user knows of a file and wants from it
image_reader      decodes pictures, recognised by their first bytes: TIFF by `tiff_picture`, OpenEXR by `exr_picture`
raster            decoded samples of a picture: range, alpha, limits of memory
light_file        light that holoview wrote as numbers, with `light_arrays`; `light_writer` writes it
colour_profile    what an embedded profile says of a picture's colours
pictures          PNG of views and patterns, animations (APNG, GIF, MP4), memory cells of a phase light modulator
pupil_path_file   the path of a pupil through the eyebox as a table
"""
