"""Image quality metrics on arrays: PSNR, CIEDE2000, MS-SSIM, speckle contrast, eyebox uniformity, gamut area.

No metric fits the brightness of the image to that of the target.

psnr               peak signal-to-noise ratio of any channels, linear sRGB, XYZ or luminance
delta_e            mean CIEDE2000 colour difference
ms_ssim            multi-scale structural similarity
speckle            speckle contrast σ/μ of a region, with the picture's own structure divided out
speckle_histogram  histogram of speckle intensity and the gamma distribution that it should follow
eyebox             uniformity of the light in the eyebox, to be read beside every PSNR
band_contrast      contrast in a band of visual spatial frequencies
gamut              chromaticities and the area that the lasers span
image_quality      all of these for a view of a hologram
"""
