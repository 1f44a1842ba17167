"""Writes files from a session; each is complete or isn't written at all.

png_images      PNG of the displayed image and of all planes, bytes for the clipboard
hologram_files  hologram files and presets
sweep           an animated focal sweep as GIF or MP4
figure          a labelled figure with a scale bar as PNG or PDF
suffix          suffixes of files
"""
