"""Finds where modulators and camera are, from patterns that it sends.

probes          patterns that make dots: lenslets with a carrier, gratings
dots            finds dots in pictures
pictures        takes the pictures, with exposure search, progress and cancellation
rough           orientation and rough place of a modulator, from single dots
geometry        where dots fall, as a function of all that is unknown; its fit with uncertainties
planes          to which distances the stage goes for it
dot_bias        by how much a model of captures sees dots beside where rays say
alignment       from the first dot to the geometry
result          the placement that follows, and sentences
record_check    whether a few captures, taken as placed, belong together
"""
