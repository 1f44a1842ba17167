"""What the viewer edits, computes in the background and remembers; the same for notebooks. No window, no GPU.

session      the one place where a bench, its patterns and the way they are looked at are edited
state look   the document and the way it is looked at, as frozen data
history      undo and redo; a drag is one step
wanted       a target as a recipe; targets built in the background for the bench as it is
newest       work of which only the newest request counts
jobs         work on a thread with progress, pause and cancel; its end is delivered to the owner
optimising   an optimisation that the view follows, kept or thrown away
opening      what a file is, by its content; loading: what a session makes of it
watching     a file that another program writes again
messages     what the user is told
measure      figures of a region, a line, a pixel; live: kept up to date; gamut: chromaticities to draw
tone         XYZ to what is on the screen; palettes: false colours
rendering    images for exports, on a device of their own
showcase     simultaneous colour beside HoloChrome, with their speckle contrasts
export       pictures, focal sweeps, labelled figures
autosave     saved as it changes, found again after a crash; archive: the format; folder: preferences, recent files
"""
