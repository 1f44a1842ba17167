"""Image quality metrics on arrays: PSNR, CIEDE2000, perceptual scores, speckle contrast, eyebox uniformity, gamut area.

No metric fits the brightness of the image to that of the target.

fidelity           peak signal-to-noise ratio, mean CIEDE2000 colour difference
perceptual_scores  names of the perceptual scores, and which of them are installed
perceptual         MS-SSIM, FLIP and ColorVideoVDP; contrast in a band of frequencies; SNR, SSIM, VIFp of fields, views
speckle            contrast σ/μ of a region, its histogram, independent patterns, contrast on the retina
grains             independent grains of a region, and the standard error of its contrast
colour_speckle     scatter of chromaticity, measured and of independent lasers; Jzazbz
speckle_measurement  luminance, lasers, groups and colours of a region together, and whether they are visible
photograph         photographs of a bench as light: black, noise, saturation, encoding
sharpness          contrast ratios, MTF of edges and line pairs
gamut              chromaticities and the area that the lasers span
image_quality      fidelity, speckle and eyebox of a hologram: at its planes, between them, from places of the pupil
"""
