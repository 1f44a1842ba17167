"""Numbers that say how good an image is: arrays in, floats out, no fitting of brightness.

psnr.py       peak signal-to-noise ratio at fixed brightness: any channels, linear sRGB, XYZ, luminance
delta_e.py    mean CIEDE2000 colour difference
speckle.py    speckle contrast σ/μ of a region, with the picture's own structure divided out
histogram.py the histogram of speckle, and the law that it should follow
eyebox.py     how evenly the light fills the eyebox, to be read beside every PSNR
gamut.py      chromaticities and the area that the lasers span
"""
