"""Optical elements as torch functions, and what effects do to light.

source           tilted plane waves that illuminate the first modulator
slm              phase modulator: drive → quantised optical path → transmission; pixels on the simulation grid
propagate        what a relay does to a spectrum: free space with the relay's stops, and pupils
first_order      the first diffraction order of the modulator, which is the eyebox, in blocks
torch_effects    active effects applied to modulators, pupils and camera images
frame_inputs     the inputs of a frame: optical paths, sampled transmissions, pupils
plain_inputs     the same without torch, for systems without levels, pupils and effects
"""
