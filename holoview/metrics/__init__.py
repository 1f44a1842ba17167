"""Image quality metrics on arrays: PSNR, CIEDE2000, perceptual scores, speckle contrast, eyebox uniformity, gamut area.

No metric fits the brightness of the image to that of the target.

psnr                peak signal-to-noise ratio of any channels, linear sRGB, XYZ or luminance
delta_e             mean CIEDE2000 colour difference
ms_ssim             multi-scale structural similarity
flip                FLIP, the error that flipping between two images shows
color_video_vdp     ColorVideoVDP, quality in just-objectionable differences
perceptual_scores   the names of these three, and which of them are installed
perceptual_quality  these three by name
plane_scores        a score of each plane, and images as stacks
speckle             speckle contrast σ/μ of a region, with the picture's own structure divided out
laser_patterns      independent patterns that lasers, frames and sources contribute
retinal_speckle     speckle contrast on the retina, against the diameter of the pupil
speckle_histogram   histogram of speckle intensity and the gamma distribution that it should follow
eyebox              uniformity of the light in the eyebox, to be read beside every PSNR
band_contrast       contrast in a band of visual spatial frequencies
gamut               chromaticities and the area that the lasers span
image_quality       fidelity, speckle and eyebox for a view of a hologram
hologram_scores     all scores of a hologram: at its planes, between them, from places of the eye's pupil
"""
