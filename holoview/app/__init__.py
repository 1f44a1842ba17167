"""The viewer: panels over a session, drawn by Dear ImGui on the device that computes the holograms.

run          opens it: on a screen, off screen by a script, in a browser
app          what panels are given; frames, and computing in between in slices
window       Dear ImGui on rendercanvas and wgpu; keys, commands: what keys mean
layout       where windows are at first; menus, status, theme, toasts, overlays
panel        what a panel is, and how one that fails leaves the others alone; panels: a file each
fields       widgets made from parameters' metadata
feed         an image kept up to date: quick while a hand drags, in full when it rests; sides: all that are compared
viewport     images of the device into a texture: zoom, exposure, palette, comparison
stack        small images of all planes; tiles, thumbnails, contact: showing them
pages        phases and the eyebox; readout: values under the pointer
hand script  synthetic events, and scripts made of them
serve        to a browser, behind a token
"""
