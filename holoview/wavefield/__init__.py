"""Complex fields on a plane, without a modulator: other programs' holograms and recordings of cameras.

wavefield    the field with its sampling, wavelengths and distance, and what is known of it and why
propagation  a field at any distance, by a method that is chosen by a stated criterion
"""
