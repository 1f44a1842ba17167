"""A closed loop: the next capture is the one that tells most about the cause in a second on the bench.

closed_loop          takes captures until the cause is certain, or a budget is spent
loop_context         the captures so far, as fits need them
hypotheses           what may be the cause, with posterior probabilities
hypothesis_fits      the fits of hypotheses, from capture to capture
evidence             evidence of a fit by Laplace's approximation; probabilities
separation           expected Δχ² between two hypotheses, and the expected information
proposals            captures that could be taken: pattern, plane, wavelength, exposure
proposal_prediction  what hypotheses predict of proposals
planners             who chooses: information, chance, or a plan
capture_choice       the proposal of most information per second, and why
pattern_ascent       a proposal's pattern improved by gradient
bench_time           how long a capture takes
kept_captures        the captures of a loop on the disk
"""
