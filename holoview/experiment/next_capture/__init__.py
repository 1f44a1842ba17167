"""The next capture is the one that tells most about the cause in a second on the bench.

closed_loop      takes captures until the cause is certain, or a budget is spent; planners
hypotheses       what may be the cause: fits, evidence, probabilities
proposals        captures that could be taken: pattern, plane, wavelength, exposure
capture_choice   the proposal of most information per second, its pattern improved by gradient, and the reason
"""
