"""Simulates one frame of a hologram: two interchangeable executors, PyTorch and WebGPU, of the same stages.

backend            opens an executor by name; estimates the memory that a simulation takes
frame              the sequence of stages from the laser to the intensity, independent of the executor
torch_executor     the reference executor: PyTorch in complex64 or complex128, differentiable; the field at each stage
point_light        the light through one point: sections along the axis, directions, contributing areas of modulators
wgpu_executor      the WebGPU executor: fused kernels, and each stage by itself for comparison with PyTorch
fused              records the fused kernels of a frame; their inputs and results in device memory
fused_kernels      the WGSL of the fused kernels, the layout of the rows that they store, the variants of a plan
shader_structs     the structs that Python and WGSL share, filled from the numbers of a plan
compositor         weighted sum of intensities in CIE XYZ, and 8-bit sRGB of it, on the device
incremental        IncrementalRenderer: recomputes only what an edit has made stale; the FFT strategy it computes with
"""
