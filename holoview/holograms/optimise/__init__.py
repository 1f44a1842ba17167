"""Computer-generated holography: patterns, laser amplitudes and wavelengths for a focal stack, by gradient descent.

hologram_job         a whole optimisation: when it ends, and the checkpoint and preview that it writes
film                 holograms for the pictures of a film, each starting from the hologram before
field_loss           the loss of complex fields, for targets whose phases count
solve                the optimisation loop, a generator of states; on a card its iterations are recorded as CUDA graphs
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
lasers               the lasers of a plan that are on
checkpoint           what the loop yields, and a file from which an optimisation continues
memory               estimate of the memory needed, and an error that says what to reduce
parallel             processes or GPUs that share the lasers, CPU threads, choice of the torch device

The number itself, from patterns to intensities and back, in the order in which it is read:

forward_model        the plain pair of forward and adjoint; the model that computes it, by hand and by torch's autograd
propagation          its parts by torch: through the modulators, to a plane, to the image
beams                frequencies, groups that are computed together, fields as they are stored, transfer functions
kernel_choice        torch or compiled kernels, the faster on this machine; compiles them in another process
compiled_model       the parts of `propagation` in compiled passes
vector_kernels       these passes over fields, each around an FFT
vector_fft           FFTs of many lines side by side in the processor's vectors, compiled by numba

The same of chains of elements:

chain_loop           the optimisation loop of a chain
chain_executor       its stages, by torch
compiled_chain       its stages in compiled passes, each with its adjoint
chain_kernels        these passes
"""
