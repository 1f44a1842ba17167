"""Measures how fast frames and edits are on this machine: `holoview bench`, and the contents of its reports.

frame_jobs           jobs that are timed, interleaved: a frame, a scrub, edits of the gap and of the lasers
frame_benchmark      a frame and its edits beside torch's fastest loops, by the device's clock, from a process's start
optimiser_iteration  an iteration of the optimiser on the processor and on a card
autograd_loop        the optimiser's rival: the same loss by autograd, with torch's Adam
time_to_quality      the time until a hologram is as good as it gets, of the optimiser and of its rival
machine              adapter, processor, versions; bandwidth of a copy; the power that a card draws
report_run           the measurements of a report, one after the other; the error of each stage beside torch
report_text          the report as Markdown with its numbers as JSON
"""
