"""How fast this machine is: what `holoview bench` measures.

torch_loop   the same frame as the fastest loop that torch allows, to compare with
timing       interleaved runs, medians and minima
frame_bars   a frame and its edits, against their bars
choices      which strategy of the transforms is measured
fft_bar      a 2-D FFT beside torch's
device_time  time on the device by its own clock, and the share of memory bandwidth
first_image  from the start of a process to its first picture, with nothing cached
"""
