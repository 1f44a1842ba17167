"""Computer-generated holography: patterns, laser amplitudes and wavelengths for a focal stack, by gradient descent.

solve                the optimisation loop, a generator of states
settings             options of the optimiser
iteration_state      what the loop yields after each iteration
variables            patterns, amplitudes and wavelengths, their Adam steps and their checkpoint form
patterns             the modulator patterns: initial values, quantisation, the Adam step
level_gradients      secants to the neighbouring level, for modulators with few phase levels
wavelengths          projection onto the allowed range and spacing; derivatives of colour
amplitudes           laser amplitudes by non-negative least squares
adam                 Adam's moments and step, and two learning-rate schedules
optimised_eyes       for which eyes a hologram is optimised: options of the command line and the viewer
pupil_places         places of the pupil: a grid of them, or drawn ones
drawn_pupils         places of the pupil that are drawn anew in each iteration
problem              one evaluation of the loss and of the requested gradients
row_evaluation       rows of a focal plane: image, loss and the gradients of the fields, in one pass
objective            the loss of an image stack and its derivative
loss_spaces          the colour spaces in which image and target are compared
srgb_curve           the curve of encoded sRGB and its derivative
forward_model        wave propagation from patterns to intensities, and its hand-written adjoint
modulator_light      from the modulators' pixels to the spectrum behind the last one, and back
plane_propagation    from this spectrum to the fields at a focal plane, and back
spectral_axes        the frequencies that stops pass, and the transforms between them and samples
beam_fields          spectra and lines of a group of beams, as they are stored
beam_blocks          parts that fit the processor's cache, or a GPU's memory
autograd_model       the same with torch's autograd, where effects change the modulators' light
transfer_functions   precomputed transfer functions, pupils and spectra of pixels
wavelength_gradient  derivative of the loss with respect to a laser's wavelength
eyebox_penalty       penalty on an unevenly filled eyebox
lasers               the lasers of a plan that are on
memory               estimate of the memory needed, and an error that says what to reduce
process_group        the lasers of one optimisation split over several processes or GPUs
threads              one CPU thread where fields are small, and parts computed in several
torch_device         choice of the torch device
checkpoint           an optimisation saved in a safetensors file
"""
