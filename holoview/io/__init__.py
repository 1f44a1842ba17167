"""Files of holograms, pictures, modulator patterns and pupil paths.

hologram          the hologram file: patterns and the system that shows them
png               PNG files: rendered views with metadata, and modulator patterns
animation         animated PNG, GIF and MP4
pupil_path_file   the path of a pupil through the eyebox as a table
plm               the bits of a phase light modulator's memory cells for a picture of levels (TI DLP6750)
"""
