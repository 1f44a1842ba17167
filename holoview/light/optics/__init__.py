"""Optical elements as torch functions, and what effects do to light.

bench          the bench element by element: plane waves, modulators, spectra of pixels, relays
frame_inputs   the inputs of a frame: optical paths, sampled transmissions, pupils; without torch where that is possible
slm            phase modulator: drive → quantised optical path → transmission; pixels on the simulation grid; the eyebox
propagate      what a relay does to a spectrum: free space with the relay's stops, and pupils
torch_effects  active effects applied to modulators, pupils and camera images
free_space     a field over any distance into any window: angular spectrum, Fresnel and Fourier transforms
"""
