"""When the model stops being true: limits of a bench's plan, each with what is measured, its threshold and its reason.

limit             `Limit`: what is measured and against which threshold; `Reading`: the figure of a plan
sampling_limits   what the grid can't hold: band limit, wrap-around, samples a pixel, stops, oblique light
scalar_limits     what scalar diffraction can't describe: pixels near the wavelength, evanescent orders, the near field
source_limits     what the observer or the samples of broad lines and extended sources can't resolve
eye_limits        a pupil beside the eyebox or beyond the samples
checks            `LIMITS`: all of them; reads them, and refuses a plan that leaves nothing to see

The table in docs/physics.md states each limit with its threshold.
"""
