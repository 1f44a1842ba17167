"""Numerical methods that know nothing of displays.

sampling        FFT lengths 2^a·3^b·5^c, order of frequency bins, positions from a grid's centre, tapers, rounding up;
                operations by tensor methods: regions of images, interpolation in knots, powers
fourier         FFTs between a window of samples and a band of frequencies; chirp-z sums; exp(2πi·turns)
resample        Gaussian blur, affine warps and interpolation of two-dimensional maps, differentiable
turned_grid     the power of a sum of waves at the points of a turned grid
subpixel_shift  images shifted by fractions of a pixel, and their gradients, by a windowed sinc
surfaces        Zernike polynomials in Noll's order, thin-plate splines through values at equidistant nodes
minimise        Levenberg–Marquardt inside bounds, minimisation along one axis, likelihood intervals, downhill simplex
structural_similarity  multi-scale structural similarity (MS-SSIM) of images, differentiable
"""
