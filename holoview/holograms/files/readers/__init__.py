"""Readers of holograms' files, one module for each format; laboratories add their own as entry points.

contents           the contents of a file: arrays, numbers, what the format states; the protocol `Reader`
registry           the reader of a file, by its content first and its name second; readers of other packages
numpy_file         NumPy .npy and .npz
matlab5            MATLAB's files up to version 7.2
hdf5_file          HDF5, and MATLAB's files of version 7.3
tiff_file          TIFF with integers, floats or complex numbers, and stacks
exr_file           OpenEXR
picture_file       PNG, BMP, JPEG, GIF and PGM as stored numbers
openholo           OpenHolo's .ohc
safetensors_reader safetensors
torch_file         torch's pickles, which are refused
text_table         tables of numbers as text
tile_set           one field in many files, the tiles of JPEG Pleno's holograms for printing
binary_dump        plain numbers whose layout the user states
"""
