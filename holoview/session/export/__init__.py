"""Files that a session writes, each whole or not at all.

pictures   PNG of what is seen, of every plane, and for the clipboard
documents  hologram files and presets
sweep      an animated focal sweep as GIF or MP4
figure     a labelled figure with a scale bar as PNG or PDF
"""
