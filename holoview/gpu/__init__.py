"""WebGPU utilities: devices, shaders and FFTs. Nothing in this package knows optics.

binding             loads wgpu's native backend fast
adapter             finds and ranks the machine's graphics adapters, and checks their limits
device              an open device: checked allocation, upload and download, compiled pipelines
recorder            records dispatches, copies and clears, and submits them at once or in slices
timer               measures the device's time of compute passes by timestamp queries
shader              links WGSL files by #include and maps compiler errors back to file and line
wgsl_struct         declaration, byte layout and packing of a WGSL struct from one definition
rounding            integer division that rounds up
line_fft            FFTs along one axis, with caller-defined WGSL for load, store and what is in between
line_fft_workgroup  WGSL of such an FFT in workgroup memory
line_fft_subgroup   WGSL of such an FFT in registers, with subgroup shuffles
fft                 complex 2-D FFTs, in place in a buffer
line_step           what a transform does: its direction, and the points and frequencies that it needs
spectrum_order      which frequencies of a line are stored, and in which order
fft_radices         factorises a length
fft_codegen         WGSL of one pass of an FFT
fft_butterfly       WGSL of a small DFT in registers
precompile          compiles shaders ahead of their first use
tune                finds the fastest FFT strategy in the background
tune_store          caches measured times in a JSON file
tune_process        starts and reads the helper process that measures
tune_worker         the helper process itself

Besides the viewer's window, only this package imports wgpu. Importing it needs no graphics driver: adapters are first
enumerated by `open_device`.
"""
