"""Light on a bench: the bench as data, the physics of it, and the two executors that compute what it shows.

numerics    FFT lengths, Zernike polynomials, resampling, least squares
observers   who looks: eyes by age and field, people, cones or cameras from a table
colour      cone fundamentals, CIE XYZ, sRGB, white balance
gpu         WebGPU: adapters, devices, WGSL linking, FFTs in shaders
model       the bench as data: `System`, presets, colour schemes, `Plan`; the framework of effects
optics      source, modulator, propagation and pupil as torch functions; effects applied to light
effects     imperfections of real benches: physical causes
engine      the graph of stages of a frame, evaluated by torch and by shaders; incremental rendering
"""
