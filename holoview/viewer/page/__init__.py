"""A hologram as one HTML file, live in the reader's browser.

page              writes the file, and reads it again as data
frame_recording   what the page knows of a hologram: its bench in numbers, its patterns; a frame as buffers, pipelines
                  and dispatches, for a program without Python to replay
link              the state of a page as the end of its address, applied to a hologram

replay.js     replays a recording on a browser's device
open.js       opens the device and compiles while the rest of the file is read
bench.js      the numbers that change with a slider: the twin of the plan
measure.js    speckle contrast and PSNR
hologram.js   what of a frame is stale after a change
link.js       the state of the page as the end of its address
strip.js      the drawing of the bench, whose numbers are shown and changed in it
page.js       what a reader changes and sees; page.html and page.css are its layout
"""
