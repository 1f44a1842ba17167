"""Readers of holograms' files, one module for each format; laboratories add their own as entry points.

contents     what a reader finds in a file: arrays, numbers, what the format states; the protocol `Reader`
registry     the reader of a file, by its content first and its name second; readers of other packages
numpy_file   NumPy .npy and .npz
"""
