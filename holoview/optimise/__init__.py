"""Finding hologram patterns, laser amplitudes and wavelengths for a focal stack.

solve        the iteration: an iterator of states
settings     how to optimise
state        what is shown after each iteration
unknowns     all that is sought, how it moves, what a checkpoint keeps of it
patterns     where patterns begin, what a modulator shows of them
quantise     slopes towards neighbouring levels
wavelengths  range and spacing of free wavelengths; how colours depend on them
amplitudes   laser amplitudes in closed form
adam         moments and step
problem      one evaluation of the loss: model, objective and eyebox together
objective    target, region and weights of planes; the loss of an image and its slope
losses       colour spaces by name
model        intensities of every laser and frame plane by plane, and the hand-written adjoint
responses    what spectra are multiplied by, made once
chromatic    the gradient with respect to wavelengths
eyebox       how evenly the eyebox is filled, and a penalty
memory       what it all takes, and a clear word when there is less
team         processes that share the lasers
threads      as many as the size deserves
device       which torch device
checkpoint   all that goes on from where it stopped, in a file
"""
