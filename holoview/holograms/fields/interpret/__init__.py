"""The meaning of a file's arrays: which of them are the field, their axes and quantities, pitch and wavelengths.

Everything that a file doesn't state is guessed with a reason, which the results name.

candidates   the arrays that can be a field, alone or as parts of a field, and the choice among them
axes         which axes of an array are frames, colours, y and x
arrangement  how the arrays of one or several files make a field or a recording; whether real numbers are amplitude,
             phase, intensity, a bilevel pattern or a camera's picture
strips       parts of arrays as complex amplitudes, strip by strip
properties   pitch, wavelengths, distance: given, remembered, of the file, or guessed
known_files  published test sets: the properties of a file of this name (jpeg_pleno.toml)
remembered   the notes beside a file, FILE.holoview.toml
"""
