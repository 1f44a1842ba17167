"""Measures how fast frames and edits are on this machine: `holoview bench`, and what its reports hold.

timing                 interleaved timing of jobs, with medians and minima
frame_jobs             the jobs that are timed: a frame, a scrub, edits of the gap and of the lasers
frame_benchmark        a frame and its edits as ratios to a reference, with limits
frame_cases            the jobs at a size, a number of lasers and a strategy
torch_baseline         the same frame as the fastest loop in PyTorch
pruned_torch_baseline  and as the fastest one that computes only what the stops pass
fft_benchmark          a 2-D FFT beside torch.fft
device_probe           bandwidth of a copy, times of a submission and of a dispatch
device_time            time of a frame by the device's own clock, and the share of the memory bandwidth
first_image            time from the start of a process to its first image, with empty caches
strategy_choice        which FFT strategy is measured
machine_facts          adapter, limits, features, processor, memory, versions
stage_parity           the error of each stage beside torch in complex128
parity_benches         the small benches on which stages are compared
optimiser_iteration    an iteration of the optimiser on the processor and on a card
power                  the power that a card draws
report_run             the measurements of a report, one after the other
report_goals           what a graphics card should reach
report_text            the report as Markdown with its numbers as JSON
"""
