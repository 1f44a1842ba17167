"""Measures how fast frames and edits are on this machine: `holoview bench`.

timing           interleaved timing of jobs, with medians and minima
frame_benchmark  a frame and its edits as ratios to a reference, with limits
torch_baseline   the same frame as the fastest loop in PyTorch
fft_benchmark    a 2-D FFT beside torch.fft
device_time      time of a frame by the device's own clock, and the share of the memory bandwidth
first_image      time from the start of a process to its first image, with empty caches
strategy_choice  which FFT strategy is measured
"""
