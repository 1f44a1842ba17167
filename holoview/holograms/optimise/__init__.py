"""Computer-generated holography: patterns, laser amplitudes and wavelengths for a focal stack, by gradient descent.

hologram_job         a whole optimisation: when it ends, and the checkpoint and preview that it writes
film                 holograms for the pictures of a film, each starting from the hologram before
field_loss           the loss of complex fields, for targets whose phases count
kernels              image and gradients of a plane's fields, by torch or compiled by numba
kernel_choice        torch or compiled kernels, whichever are faster on this machine, measured once
vector_fft           FFTs of many lines side by side in the processor's vectors, compiled by numba
vector_kernels       compiled passes of an iteration over fields, each around such an FFT
compiled_model       `propagation` by these passes
solve                the optimisation loop, a generator of states; one stack after the other
graphed_step         iterations on a card, recorded as CUDA graphs
named_methods        double phase and Gerchberg–Saxton, to compare with
settings             options of the optimiser; the colour spaces in which image and target are compared
eyes                 for which eyes a hologram is optimised: places of the pupil, fixed or drawn, chromatic aberration
variables            patterns, amplitudes and wavelengths, their Adam steps and their checkpoint form
adam                 Adam's moments and step, and two learning-rate schedules
level_gradients      secants to the neighbouring level, for modulators with few phase levels
wavelengths          projection onto the allowed range and spacing; derivatives of colour and of the loss
problem              one evaluation of the loss and of the requested gradients
objective            the loss of an image stack and its derivative; laser amplitudes in closed form
eyebox_penalty       penalty on an unevenly filled eyebox
forward_model        wave propagation from patterns to intensities, and its hand-written adjoint
propagation          its parts: through the modulators, and to a plane
autograd_model       the same model by torch's autograd, where effects change the modulators' light
transfer_functions   precomputed transfer functions, pupils and spectra of pixels
beams                the frequencies of the beams, groups that are computed together, fields as they are stored
lasers               the lasers of a plan that are on
checkpoint           what the loop yields, and a file from which an optimisation continues
memory               estimate of the memory needed, and an error that says what to reduce
parallel             processes or GPUs that share the lasers, CPU threads, choice of the torch device
"""
