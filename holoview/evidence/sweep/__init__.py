"""Sweeps: measures of a hologram against any parameter of its bench, its effects and the optimiser.

axes       parameters and their values from text, the points of a sweep, a bench's own value of a parameter
measures   what is measured of a hologram on a bench, by the functions that the other commands print
points     the points as jobs of a study: shown as they are, or optimised anew
tolerance  how far each parameter may be off, by the roots of its curve, and the worst pairs
results    the points as CSV and as a figure
in_viewer  sweeps of the document that the viewer shows
"""
