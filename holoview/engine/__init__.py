"""Two executors of one Plan, and the frame that both run.

frame    the graph of stages: which stage follows which, for every wavelength, frame, source and plane
torch    the reference: complex64 and complex128, differentiable
wgpu     WGSL compute shaders on any WebGPU adapter
"""
