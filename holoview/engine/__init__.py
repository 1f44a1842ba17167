"""Two executors of one Plan, and the frame that both run.

frame    the graph of stages: which stage follows which, for every wavelength, frame, source and plane
torch    the reference: complex64 and complex128, differentiable
wgpu     WGSL compute shaders on any WebGPU adapter
session  a hologram that is edited: only what is stale is computed again
results  what a session has computed, and how it computes what is stale
pace     which strategy of the transforms it uses
fused    the five fused kernels of a frame, bound to `inputs`, whose numbers are `values`
kernels  their shaders, and which variants of them a plan needs
shelf    what a session keeps on the device
display  intensities to XYZ and to a picture
"""
