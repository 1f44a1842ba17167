"""Finding hologram patterns and laser amplitudes for a focal stack.

model       intensities of every laser and frame, and the hand-written adjoint that gives pattern gradients
amplitudes  laser amplitudes in closed form
memory      what it all takes
settings    how to optimise
checkpoint  all that goes on from where it stopped, in a file
objective   target, colour space and loss
solve       the iteration: patterns by Adam, amplitudes by least squares; an iterator of states
"""
