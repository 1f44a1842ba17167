"""What the viewer edits, computes in the background and remembers; the same for notebooks. No window, no GPU.

session      the one place where a bench, its patterns and the way they are looked at are edited
state look   the document and the way it is looked at, as frozen data
history      undo and redo; a drag is one step
wanted       a target as a recipe; targets built in the background for the bench as it is
jobs         work on a thread with progress, pause and cancel; its end is delivered to the owner
optimising   an optimisation that the view follows, kept or thrown away
opening      what a file is, by its content, and what a session makes of it
watching     a file that another program writes again
messages     what the user is told
measure      figures of a region, a line, a pixel; gamut: chromaticities to draw
showcase     simultaneous colour beside HoloChrome, with their speckle contrasts
export       pictures, focal sweeps, labelled figures
folder       where all of it is kept between starts: autosave, recovery, preferences, recent files
"""
