"""Complex fields on a plane, without a modulator: other programs' holograms and recordings of cameras.

wavefield   the field with its sampling, wavelengths and distance, and what is known of it and why
exchange    fields from other running programs: a listener on this machine and `push`
"""
