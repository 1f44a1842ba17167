"""WebGPU utilities: devices, shaders and FFTs. Nothing in this package knows optics.

adapter           loads wgpu's native backend fast, finds and ranks the graphics adapters, checks their limits
device            an open device: checked allocation, upload and download, compiled pipelines
recorder          records dispatches, copies and clears, submits them at once or in slices, and measures their time
shader            links WGSL files by #include, maps compiler errors back to file and line; structs shared with Python
line_fft          FFTs along one axis, with caller-defined WGSL for load, store and between two transforms
fft_codegen       WGSL of one pass of an FFT, of a small DFT in registers, and the factors of a length
spectrum_order    which frequencies of a line are stored, in which order, and which a transform needs
fft               complex 2-D FFTs, in place in a buffer
tune              finds the fastest FFT strategy in the background, and stores measured times
tune_worker       the helper process that measures

Besides the viewer's window, only this package imports wgpu. Importing it needs no graphics driver: adapters are first
enumerated by `open_device`.
"""
