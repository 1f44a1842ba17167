"""Images of a scene, kept up to date while it is edited; it knows neither a window nor undo.

scene                 what an image is rendered from; an image on the device
view_settings         how an image is shown: focal plane, exposure, channel, comparison, measured region
progressive_renderer  a quick image at once, the full one when editing pauses
quick_system          the simplified system of quick images and previews
side_renderers        one renderer for each side of a comparison
plane_previews        preview images of all focal planes
page_images           the phase of a pattern; the eyebox
plane_images          images of focal planes on a job's thread, for exports and comparisons
tone_mapping          XYZ to 8-bit sRGB; colour maps of single channels
"""
