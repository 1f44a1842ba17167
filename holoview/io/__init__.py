"""Files of holograms, pictures and modulator patterns.

hologram  the hologram file: patterns and the system that shows them
png       PNG files: rendered views with metadata, and modulator patterns
plm       the bits of a phase light modulator's memory cells for a picture of levels (TI DLP6750)
"""
