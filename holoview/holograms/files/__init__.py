"""Files of holograms, pictures, modulator patterns and pupil paths.

hologram          the hologram file: patterns and the system that shows them, or a field
load_field        complex fields as holograms: of arrays, and of files of holoview and of other programs
pictures          PNG of views and patterns, animations (APNG, GIF, MP4), memory cells of a phase light modulator
pupil_path_file   the path of a pupil through the eyebox as a table
"""
