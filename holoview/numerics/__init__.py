"""Numerical methods that know nothing of displays.

fft_grid           FFT lengths 2^a·3^b·5^c, the order of frequency bins, positions counted from a grid's centre
pruned_fft         FFTs between a window of samples and a band of frequencies
pixel_spectrum     the discrete spectrum of the equal samples of one pixel
chirp_z            Fourier sums at any equally spaced frequencies (Bluestein's algorithm)
phasor             exp(2πi·turns), with the turns reduced to one period first
resample           Gaussian blur, affine warp and interpolation of two-dimensional maps, differentiable
subpixel_shift     images shifted by fractions of a pixel, and their gradients, by a windowed sinc
image_region       rectangles of an image as slices, and setting everything outside to zero
structural_similarity  multi-scale structural similarity (MS-SSIM) of images, differentiable
taper              a window that falls to zero at both ends
knots              linear interpolation in tables with equidistant knots
power_law          powers of numbers from 0 on, with finite gradients
thin_plate_spline  thin-plate splines through values at equidistant nodes
zernike            Zernike polynomials in Noll's order
least_squares      Levenberg–Marquardt inside bounds, minimisation along one axis, profile likelihood intervals
nelder_mead        the downhill simplex for cost functions without a gradient at their minimum
"""
