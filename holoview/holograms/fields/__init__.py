"""Complex fields on a plane, without a modulator: other programs' holograms and recordings of cameras.

wavefield           the field with its sampling, wavelengths and distance, and where each property is known from
reading             a hologram from anyone's file: a field, or a camera's recording
interpret           what the arrays of a file mean: axes, quantities, scales, pitch, wavelengths
imaging             far images brought near, for a bench to show
field_bench         the bench that shows a field
field_file          holoview's own file of a field
exchange            fields from other running programs: a listener on this machine and `push`
source_field        the effect that lights modulator 1 with a field
field_target        a field as the target of a hologram: its light at any plane
propagation         a field at any distance, by a method that is chosen by a stated criterion
focus               the distance of best focus by two published measures, with its curve
demodulation        the field of a camera's recording: off-axis, in-line, phase-shifting sets
synthetic_aperture  a hologram through a part of itself: viewpoints of JPEG Pleno, and its 8-bit pictures
"""
