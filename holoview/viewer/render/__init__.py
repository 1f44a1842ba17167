"""Images of a scene, kept up to date while it is edited; it knows neither a window nor undo.

scene                 what an image is rendered from; an image on the device
view_settings         how an image is shown: focal plane, exposure, channel, comparison, measured region
progressive_renderer  a quick image at once, the full one when editing pauses; one renderer for each compared side
light_by_gap          the light behind the stops by the gap, by which a quick image is as bright as the full one
planes                images of focal planes and along a pupil's path; previews of planes
page_images           the phase of a pattern; a complex field; the eyebox
point_probe           sections through a point of the image, and where its light comes from
tone_mapping          XYZ to 8-bit sRGB; colour maps of single channels; pictures of complex fields
"""
