"""Finds where modulators and camera are, from patterns that it sends.

dots        patterns that make dots (lenslets with a carrier, gratings); dots in pictures, and their bias
geometry    where dots fall, as a function of all unknowns; its fit with uncertainties
alignment   from the first dot to the geometry
result      the registration that follows, sentences, and a check with a few captures
"""
