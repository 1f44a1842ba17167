"""WebGPU plumbing: everything that speaks to a graphics adapter, and nothing that knows optics.

adapter.py       which adapters there are, which one is best, and whether its limits are enough
device.py        an open device: checked allocation, upload and download, cached pipelines
recorder.py      passes recorded into one submission
timer.py         time that passes take on the device
lines.py         transforms along one axis between functions of the caller
lines_workgroup.py WGSL of such a transform in workgroup memory
lines_subgroup.py WGSL of such a transform in the registers of a subgroup
shader.py        linking WGSL files, and errors that name file and line
layout.py        one definition for a struct in WGSL and its bytes on the host
fft.py           complex 2-D FFTs in a buffer
fft_radices.py   radices of a length, and the order they leave a spectrum in
fft_codegen.py   WGSL of one FFT pass
fft_butterfly.py WGSL of a small DFT in registers
tune.py          which strategy of a transform is the fastest here, found out in the background
tune_store.py    remembering it
tune_process.py  the helper process that finds out, from outside
tune_worker.py   and from inside
warm.py          shaders compiled ahead

Only this package imports wgpu. Importing it needs no driver: adapters are first looked for in `open_device`.
"""
