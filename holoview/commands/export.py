"""`holoview export HOLOGRAM`: as a page that any browser shows live, or as patterns that drive real modulators.

`--html` writes one file for one hologram, or for several to compare (`holoview.page`). `--png` writes a PNG for each
frame and modulator. A pixel holds one of three things: a grey value from 0 to the maximum for an optical path from 0 to
the stroke; with `--levels` the number of its level, in rising order of optical path, which drivers call the state
index; with `--cells p67` the memory cells of a device, black for 0 and white for 1, in the order of `holoview.io.pictures`.
