"""Writes files from a session; each is complete or isn't written at all.

png_images      PNG of the displayed image and of all planes, bytes for the clipboard
hologram_files  hologram files and presets
web_page        a page that any browser shows live
sweep           an animated focal sweep as PNG, GIF or MP4
figure          a labelled figure with a scale bar as PNG or PDF
pupil_sheet     what an eye sees from nine places of the eyebox
pupil_path      the path of the pupil, and what is seen along it
suffix          suffixes of files
"""
